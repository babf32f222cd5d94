"""The folder of `qclearn register` in the tuner: what it shows of each kind, and what it says instead."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from qcbook import Tuner, ownmap
from qclearn.reports.finished import ReportError

OF_0_2 = Path(__file__).resolve().parents[1] / "run_of_0_2"
FOLDS = "the folder's map also fits folds (δ = 3, η = 3.5)"


@pytest.fixture
def folder(request, tmp_path):
    """A run of 0.2 with other entries in its report."""
    shutil.copytree(OF_0_2, tmp_path / "map")
    path = tmp_path / "map" / "report.json"
    report = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(report | request.param), encoding="utf-8")
    return tmp_path / "map"


@pytest.mark.parametrize(
    "folder, drawn, says",
    [
        ({}, 20_000, FOLDS),
        ({"features": {}, "held_out_mm": {}}, 20_000, "Landmarks alone, on your own surfaces."),
        ({}, 100, "drawn on 100 of 581 vertices"),
        ({"held_out_mm": {"one": [1, 1], "two": [1, 1]}}, 20_000, FOLDS),
        ({"eta": 0.0}, 20_000, "the folder's map also fits folds (δ = 3, η = 0)"),
    ],
    ids=["of 0.2", "landmarks alone", "large", "all held out", "no areal term"],
    indirect=["folder"],
)
def test_the_tuner_says_what_it_does_not_show_of_a_folder(folder, drawn, says, monkeypatch):
    monkeypatch.setattr(ownmap, "DRAWN", drawn)
    tuner = Tuner(folder)
    assert says in tuner.folder.note
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    state = tuner.initial
    weights = {name: report[name] for name in ("alpha", "beta", "gamma")}
    assert weights.items() <= state.items()
    with_folds = [*(weights | {name: report[name] for name in ("delta", "eta")}).items()]
    assert tuner.folder.again.get("withFolds") == (with_folds if report["features"] else None)
    assert state["held"] == ([1] if list(report["held_out_mm"]) == ["two"] else [])
    # The landmarks lie on the curves in the disks of registration.npz, whose ends are theirs.
    maps, problem = np.load(folder / "registration.npz"), tuner.folder.example.problem
    (curve, *_) = report["landmarks"]["curves"]
    for side, points in (("moving", problem.moving), ("control", problem.target)):
        ends = [list(maps[f"table_{side}"]).index(v) for v in curve[side]]
        np.testing.assert_allclose(points[problem.curve == 0][[0, -1]], maps[f"disk_{side}"][ends], atol=1e-12)
    faces = len(tuner.folder.drawn_control().surface.faces)
    assert faces < 400 if drawn == 100 else faces == len(maps["faces_control"])


@pytest.mark.parametrize(
    "folder, says",
    [
        (
            {"landmarks": {"curves": []}},
            "registered by folds alone.*register rh.pial lh.pial --cortex .* --delta 3 --eta 3.5",
        ),
        (
            {"curves": [], "command": ["qclearn", "register", "a.npz", "b.npz", "--no-landmarks", "--hold-out", "two"]},
            "leave out --no-landmarks .* register a.npz b.npz --no-landmarks --hold-out .*two.* --delta 3 --eta 3.5",
        ),
        ({"landmarks": {"curves": []}, "command": ["python"]}, "register with --landmarks to tune them$"),
        ({"mean_abs_mu": 0.5}, "report.json is of another run"),
        (
            {"stopped": "nothing was fitted", "suspect": ["reversed: the curve 'one' runs backwards"]},
            "fitted nothing to tune; reversed: the curve 'one' runs backwards",
        ),
    ],
    ids=["folds alone", "folds alone of files with curves", "folds alone, by no command", "of two runs", "stopped"],
    indirect=["folder"],
)
def test_a_folder_without_a_landmark_fit_is_refused_in_a_sentence(folder, says):
    with pytest.raises(ReportError, match=says) as refused:
        Tuner(folder)
    assert str(folder) in str(refused.value) and "\n" not in str(refused.value)


def test_what_is_no_result_is_refused(tmp_path):
    with pytest.raises(ReportError, match="give a folder that `qclearn register` wrote"):
        Tuner(tmp_path)
    with pytest.raises(ReportError, match=f"no/map: is no folder in {Path.cwd()}; give"):
        Tuner("no/map")
