"""What version 0.1 called otherwise names its new name in one line."""

import pytest

from qclearn.cli import main


def test_the_old_option_names_the_new_one(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["register", "moving.npz", "control.npz", "--out", "out", "--sure"])
    message = capsys.readouterr().err
    assert stop.value.code == 2 and message.count("\n") == 1
    assert message.startswith("qclearn: --sure of version 0.1 is now --uncertainty")
