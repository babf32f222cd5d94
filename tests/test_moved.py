"""What version 0.1 had elsewhere names its new place in one line."""

from importlib import import_module

import pytest

from qclearn.cli import main


@pytest.mark.parametrize(
    "old, new",
    [
        ("qclearn.exercises", "qcbook.exercises"),
        ("qclearn.exercises.grading", "qcbook.exercises"),
        ("qclearn.pages", "qcbook, plots and scenes are qclearn.plot and qcbook.scenes"),
        ("qclearn.methods.harmonic", "qclearn.benchmark.methods"),
        ("qclearn.files.meshes", "qclearn.io"),
    ],
)
def test_an_old_module_names_the_new_one(old, new):
    with pytest.raises(ImportError) as refused:
        import_module(old)
    assert str(refused.value) == f"{'.'.join(old.split('.')[:2])} of version 0.1 is now {new}"
    for name in new.partition(",")[0].split():
        import_module(name)


def test_the_old_option_names_the_new_one(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["register", "moving.npz", "control.npz", "--out", "out", "--sure"])
    message = capsys.readouterr().err
    assert stop.value.code == 2 and message.count("\n") == 1
    assert message.startswith("qclearn: --sure of version 0.1 is now --uncertainty")
