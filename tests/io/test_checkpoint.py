"""Stopped runs go on from their folder, and a folder of another run is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from book.studies.parts import Parts
from qclearn.io.checkpoint import Checkpoint, require_home


class RunError(ValueError):
    pass


def test_a_finished_part_is_made_once(tmp_path):
    made = []
    for _ in range(2):
        run = Parts(tmp_path / "run", {"steps": 3}, RunError)
        arrays = run.arrays("one.npz", lambda: made.append(1) or {"a": np.arange(3.0), "name": np.array("x")})
        assert arrays["a"].tolist() == [0, 1, 2] and str(arrays["name"]) == "x"
        assert run.json("two.json", lambda: {"n": len(made)}) == {"n": 1}
    assert run.names() == ["one.npz", "two.json"] and made == [1]


def test_settings_that_differ_are_named(tmp_path):
    Checkpoint(tmp_path, {"network": {"size": 1, "rate": 2}, "steps": 3}, RunError)
    with pytest.raises(RunError, match=r"other settings \(network.rate, steps differ\): give the same"):
        Checkpoint(tmp_path, {"network": {"size": 1, "rate": 5}, "steps": 4}, RunError)
    assert json.loads((tmp_path / "settings.json").read_text())["steps"] == 3


def test_files_of_others_are_refused_unless_the_folder_is_shared(tmp_path):
    (tmp_path / "notes.txt").touch()
    with pytest.raises(RunError, match="holds files, but no settings.json of a run"):
        Checkpoint(tmp_path, {}, RunError)
    Checkpoint(tmp_path, {}, RunError, record="config.json", shared=True)
    assert (tmp_path / "config.json").is_file()
    with pytest.raises(RunError, match=r"notes.txt: cannot be used .*give another folder"):
        Checkpoint(tmp_path / "notes.txt", {}, RunError)


def test_the_cache_lies_in_a_home_folder_that_is_known(tmp_path):
    """platformdirs leaves ~ where there is no HOME and the user has no name, as in containers."""
    assert require_home(tmp_path / "cohort") == tmp_path / "cohort"
    with pytest.raises(OSError, match="~/.cache/qclearn/cohort: no home folder is known; set HOME"):
        require_home(Path("~/.cache/qclearn/cohort"))
