"""What the tuner has its reader copy, a command line and lines of Python, is run, and makes the picture's map."""

import json
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from reference import numbers, run_engine

import qclearn as qc
from qcbook import Tuner
from qcbook.examples import cortices
from qcbook.explore_tuner import surface_file
from qcbook.liveproblems import FSAVERAGE, as_json, example
from qclearn.plane.grids import polar
from qclearn.registration import curve_distance, curves_in_space

PROGRAMS = {"python": [sys.executable], "qclearn": [sys.executable, "-m", "qclearn"]}


def copied(tmp_path, name, **changes):
    """The engine's answer to a state of a problem: the texts to copy, map and distances."""
    pair = cortices(name) if name == "cortex" else None
    problems = {name: as_json(example(name), pair, FSAVERAGE if pair else None)}
    if pair:
        problems[name]["surface"] = "control.bin"
        (tmp_path / "control.bin").write_bytes(surface_file(pair.control))
    (tmp_path / "problems.json").write_text(json.dumps(problems), encoding="utf-8")
    state = Tuner.initial | {"problem": name} | changes
    return run_engine("copied", folder=str(tmp_path), state=state)


def test_the_command_and_python_make_the_pictures_map(tmp_path):
    found = copied(tmp_path, "cortex", gamma=500.0, beta=0.02, held=[1, 3, 5, 7, 9])
    for line in re.split(r"\n(?=qclearn)", found["command"]):
        program, *words = shlex.split(line)
        subprocess.run([*PROGRAMS[program], *words], cwd=tmp_path, check=True, capture_output=True)
    report = json.loads((tmp_path / "tuned" / "report.json").read_text(encoding="utf-8"))
    names = cortices("cortex").names
    assert [report[weight] for weight in ("alpha", "beta", "gamma")] == [1, 0.02, 500] and not report["features"]
    assert sorted(report["held_out_mm"]) == sorted(names[1::2])
    maps, made = np.load(tmp_path / "tuned" / "registration.npz"), {}
    exec(found["python"], made)
    np.testing.assert_allclose(made["result"].points, maps["points"], atol=1e-6)
    # The picture's mesh is coarse and has half the landmarks. Moebius maps align the disk of
    # `register` by the fitted curves alone, so the two are compared on the surface.
    pair, disk = cortices("cortex"), polar(24)
    there = pair.control.lift(disk.interpolate(numbers(found["map"]), disk.locate(pair.moving.disk.z)))
    best = qc.best_mobius(*(np.array(found[side]) @ [1, 1j] for side in ("moving", "target")))
    before = pair.control.lift(qc.mobius(pair.moving.disk.z, *best))
    apart, moved = (np.linalg.norm(one - maps["points"], axis=1).mean() for one in (there, before))
    assert apart < 1 and moved > 2


def test_the_folds_command_differs_by_the_folds_alone(tmp_path):
    found = copied(tmp_path, "cortex", delta=2.0, eta=5.0, landmarks="sliding")
    assert "--sliding" in shlex.split(found["command"])
    assert found["command"].replace("--no-features", "--delta 2 --eta 5") == found["folds"]


@pytest.mark.parametrize("changes", [{}, {"targets": {"4": [0.3, 0.1]}, "held": [1], "landmarks": "sliding"}])
def test_without_surfaces_python_fits_on_the_disk(tmp_path, changes):
    found, made = copied(tmp_path, "twist", gamma=1e3, **changes), {}
    assert found["command"].startswith("No command makes this map") and '"Copy as Python"' in found["command"]
    exec(found["python"], made)
    assert abs(made["fit"].f - numbers(found["map"])).max() < 5e-3 and abs(made["fit"].f - made["z"]).max() > 0.1


def test_distances_are_the_reports(tmp_path):
    """Of fitted landmarks from their targets, of held-out curves from theirs, through space."""
    found, pair = copied(tmp_path, "cortex", gamma=1e4, held=[1, 3]), cortices("cortex")
    disk, problem, w = polar(24), example("cortex").problem, numbers(found["map"])
    reached = disk.interpolate(w, disk.locate(problem.moving))
    off = np.linalg.norm(pair.control.lift(reached) - pair.control.lift(problem.target), axis=1)
    assert found["fitted"] == pytest.approx(off[~np.isin(problem.curve, [1, 3])].mean(), abs=0.01)
    lines, targets = pair.sample_landmarks(100)
    mapped = [disk.interpolate(w, disk.locate(line)) for line in lines]
    for label in (1, 3):
        wanted = curve_distance(*curves_in_space(pair.control, [mapped[label], targets[label]]))
        assert found["curves"][label] == pytest.approx(wanted, rel=0.05)
