"""Commands run in the test's own process, and the small surfaces that they read."""

import json
from functools import partial

import nibabel
import numpy as np
import pytest

import meshes
import qclearn as qc
from freesurfer import GEOMETRY
from known_surfaces import sphere
from qclearn.cli import main

BALL = sphere()
WALL = BALL.vertices[:, 2] < -0.8
NAMES = ["unknown", "front", "back"]
SPOKES = {name: np.arange(1 + start, 1 + start + 24 * 6, 24) for name, start in (("east", 0), ("north", 6))}
CURVES = {
    "curves": [
        {"name": "east", "moving": list(range(1, 145, 24)), "control": list(range(2, 146, 24))},
        {"name": "north", "moving": list(range(7, 151, 24)), "control": list(range(6, 150, 24))},
    ]
}
bowl = partial(meshes.bowl, lean=0.4, curves=SPOKES)


def run(*arguments):
    main([str(argument) for argument in arguments])


def everything(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def refused(capsys, folder, *arguments):
    """The one line that a refused command prints, behind a bar of progress; nothing else is printed or written."""
    before = everything(folder)
    capsys.readouterr()
    with pytest.raises(SystemExit) as stop:
        run(*arguments)
    output = capsys.readouterr()
    assert stop.value.code == 2
    line = output.err.rpartition("\r")[2]
    assert output.out == "" and output.err.count("\n") == 1 and line.startswith("qclearn: ")
    assert everything(folder) == before
    return line


def label(path, vertices):
    rows = [f"{vertex} 0 0 0 0" for vertex in vertices]
    path.write_text("\n".join(["#!ascii label", str(len(rows)), *rows, ""]))


def bumpy(height):
    """A whole hemisphere of 642 vertices, in mm, with some folds."""
    x, y, z = BALL.vertices.T
    return 50 * BALL.vertices * (1 + height * np.sin(4 * x + 1) * np.cos(5 * y) * np.cos(3 * z))[:, None]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """FreeSurfer's files of two whole surfaces, lh and rh, a cortex label and a landmarks file in whole numbers."""
    folder = tmp_path_factory.mktemp("subject")
    rng = np.random.default_rng(0)
    turn = rng.permutation(642)  # so that the cut-open numbers are others
    back = np.argsort(turn)
    for side, height in (("lh", 0.1), ("rh", 0.12)):
        whole = qc.Surface(bumpy(height)[turn], back[BALL.faces])
        whole = qc.mirror(whole) if side == "rh" else whole
        nibabel.freesurfer.write_geometry(folder / f"{side}.pial", whole.vertices, whole.faces, volume_info=GEOMETRY)
        label(folder / f"{side}.cortex.label", np.flatnonzero(~WALL[turn]))
        sulc = np.where(WALL[turn], np.nan, np.sin(4 * BALL.vertices[turn, 0]) + BALL.vertices[turn, 1])
        nibabel.freesurfer.write_morph_data(folder / f"{side}.sulc", sulc)
        regions = np.where(WALL[turn], -1, np.where(BALL.vertices[turn, 0] > 0, 1, 2))
        table = np.array([[25, 5, 25, 0, 0], [100, 20, 30, 0, 0], [20, 220, 60, 0, 0]])
        nibabel.freesurfer.write_annot(folder / f"{side}.aparc.annot", regions, table, NAMES, fill_ctab=True)
    curves = []
    for name, axis in (("one", 0), ("two", 1)):
        ends = [int(back[(BALL.vertices @ np.insert([1.0, s], axis, 0)).argmax()]) for s in (0.2, -0.6)]
        curves.append({"name": name, "moving": ends, "control": ends, "detect": False})
    (folder / "landmarks.json").write_text(json.dumps({"curves": curves}))
    return folder
