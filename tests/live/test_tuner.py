"""What the tuner has its reader copy, a command line and lines of Python, is run, and makes the picture's map."""

import json
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from reference import numbers, pairs, run_engine

import qclearn as qc
from book.studies import fold_grid
from data_synth import make_cortex
from qcbook import Tuner
from qcbook.examples import cortices, courses
from qcbook.explore_tuner import surface_file
from qcbook.livefiles import packed
from qcbook.liveproblems import FSAVERAGE, as_json, example
from qclearn.plane.grids import polar
from qclearn.registration import curve_distance, curves_in_space
from qclearn.registration.curves import curves_of_both

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
    tuned = tmp_path / "tuned-1-0.02-500-without-2-4-6-8-10"
    report = json.loads((tuned / "report.json").read_text(encoding="utf-8"))
    names = cortices("cortex").names
    assert [report[weight] for weight in ("alpha", "beta", "gamma")] == [1, 0.02, 500] and not report["features"]
    assert sorted(report["held_out_mm"]) == sorted(names[1::2])
    maps, made = np.load(tuned / "registration.npz"), {}
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


def test_the_folds_command_has_the_weights_of_register_and_not_those_of_landmarks_alone(tmp_path):
    weights = {"alpha": 0.5, "beta": 0.1, "gamma": 500, "delta": 2, "eta": 5}
    found = copied(tmp_path, "cortex", landmarks="sliding", **weights)
    words = "--alpha 0.5 --beta 0.1 --gamma 500 --no-features --sliding --out tuned-0.5-0.1-500-sliding"
    assert found["command"].endswith(words)
    of_folds = "--delta 2 --eta 5 --sliding --out tuned-2-5-folds-sliding"
    assert found["folds"] == found["command"].replace(words, of_folds)


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


def test_the_sentence_says_where_a_fit_has_not_converged():
    measures = {"mean": 0.2, "largest": 0.999, "folds": 0}
    settled, creeping, stuck, of_folds = run_engine(
        "said", maps=[measures | {"left": 1e-4}, measures | {"left": 0.11}, measures | {"left": 0.28}, measures]
    )
    assert "CLOSE TO A FOLD" in settled["words"] and settled == creeping == of_folds
    assert "NOT CONVERGED, the next step promises 28 % less loss: lower γ" in stuck["words"] and stuck["loud"] == 2


def test_maps_of_folds_lie_between_those_of_the_grid_and_are_certified(tmp_path):
    """Twists that grow with delta and eta, the last one so strong that halfway to it the map folds."""
    z, nodes = polar(24).z, list(Tuner.grid.values())
    turns = [[0.1 * i + 0.05 * j + (3.2 if i == j == 4 else 0) for j in range(5)] for i in range(5)]
    maps = [[z * np.exp(1j * turn * (1 - abs(z) ** 2)) for turn in row] for row in turns]
    maps = np.array(maps, np.complex64).astype(complex)  # as they travel
    (tmp_path / "folds.bin").write_bytes(packed({}, {"maps": maps}))
    points = pairs(np.array([0.1, 0.4j, -0.5]))
    request = {"moving": points, "target": points, "curve": [0, 0, 0], "alpha": 1, "beta": 0.01, "gamma": 1e3}
    middle = np.sqrt(nodes[1][2] * nodes[1][3])
    asked = [(nodes[0][1], nodes[1][2]), (nodes[0][1], middle), (nodes[0][4], nodes[1][4] / 1.4)]
    places = [{"delta": delta, "eta": eta} for delta, eta in asked]
    node, between, folded = run_engine("folds", folder=str(tmp_path), request=request, places=places)
    assert abs(numbers(node["map"]) - maps[1][2]).max() < 1e-12 and node["folds"] == 0
    assert abs(numbers(between["map"]) - (maps[1][2] + maps[1][3]) / 2).max() < 1e-12 and between["folds"] == 0
    assert folded["folds"] > 0


def test_the_grid_has_registers_maps_and_the_page_reads_its_file():
    """On tiny surfaces; the tuner then has the maps as a file, and the state that shows them."""
    sides = [make_cortex(seed, 1500).surface for seed in (1, 2)]
    curves = curves_of_both(*sides)
    pair = courses("tiny", *sides, curves)
    held, mesh = [curves[0]["name"]], polar(12)
    ((f,),) = fold_grid.grid(pair, curves, held, mesh, [3], [3.5])
    found = qc.register(*sides, curves, hold_out=held)
    there = mesh.interpolate(numbers(f), mesh.locate(pair.moving.disk.z))
    assert abs(there - found.disk_map).mean() < 0.01 and abs(there - pair.moving.disk.z).mean() > 0.03
    assert abs(abs(numbers(f)[-36:]) - 1).max() < 1e-5
    grid = {"weights": fold_grid.USUAL, "held": [0], "maps": [[f]]}
    files = Tuner().fold_files({"cortex": {}}, grid)
    state = json.loads(files["problems.json"])["cortex"]["folds"]
    assert state["held"] == [0] and (state["gamma"], state["delta"], state["eta"]) == (1e3, 3, 3.5)
    assert files["folds.bin"] == packed({}, {"maps": [[f]]})
