"""What went answers in one line that says what stands in its place."""

import pytest

import qclearn
from qclearn.cli import main
from qclearn.moved import GONE

COMMANDS = [name for name in GONE if name.startswith(("qclearn ", "--"))]
NAMES = [name for name in GONE if name.startswith("qclearn.")]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_or_an_option_that_went_names_what_stands_in_its_place(name, capsys):
    words = name.replace("FOLDER", "out").split()[1:] or ["register", "a.npz", "b.npz", name, "c", "d"]
    with pytest.raises(SystemExit) as stop:
        main([*words, "--out", "page.html"])
    line = capsys.readouterr().err
    assert stop.value.code == 2 and line.count("\n") == 1
    assert line.startswith(f"qclearn: {name} went with version 0.3: {GONE[name]}")


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_went_names_what_stands_in_its_place(name):
    package, short = name.split(".")
    for use in (f"{package}.{short}", f"from {package} import {short}"):
        with pytest.raises(ImportError, match=f"^{name} went with version 0.3: "):
            exec(use, {"qclearn": qclearn})
