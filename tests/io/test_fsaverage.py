"""The named sulci of fsaverage5: the rule that chose them, the paths between them, both sides against each other."""

import json
from functools import cache
from importlib.resources import files
from itertools import combinations
from pathlib import Path

import nibabel
import nilearn.surface
import numpy as np
import pytest
from nilearn.datasets import fetch_surf_fsaverage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from qclearn.io.fsaverage import demo_landmarks, fsaverage5, named_sulci, whole_fsaverage5
from qclearn.registration.curves import fundus_metric, fundus_path
from qclearn.surfaces.surface import SurfaceError

SIDES = ("left", "right")
each_side = pytest.mark.parametrize("side", SIDES)
RECORD, WALL = (
    json.loads(files("qclearn.io").joinpath(f"fsaverage5_{name}.json").read_text()) for name in ("sulci", "wall")
)
ANNOTATION = Path(nilearn.surface.__file__).parent / "tests" / "data" / "test.annot"


def array(kind, side, number=0):
    return np.asarray(nibabel.load(fetch_surf_fsaverage("fsaverage5")[f"{kind}_{side}"]).darrays[number].data)


@cache
def opened(side):
    """The pial surface without its medial wall, and the paths (dict) of its sulci."""
    surface = fsaverage5(side)
    metric = fundus_metric(surface)
    ends = named_sulci(side, surface.original_vertices)
    return surface, {name: fundus_path(surface, *pair, metric) for name, pair in ends.items()}


def test_the_wall_is_what_the_annotation_leaves_out():
    labels, _, names = nibabel.freesurfer.read_annot(ANNOTATION)
    wall = np.isin(labels, [names.index(b"unknown"), names.index(b"corpuscallosum")])
    assert WALL["left"] == np.flatnonzero(wall).tolist()


@each_side
def test_both_walls_leave_one_medial_gap(side):
    """The right wall against the left one: as many vertices, in the same place."""
    cortex, wider = (fsaverage5(side, wall=wall) for wall in ("cortex", "thickness"))
    assert set(cortex.original_vertices) < set(wider.original_vertices)
    assert 0.085 < 1 - cortex.area / whole_fsaverage5(side, "pial").area < 0.1
    cut = np.setdiff1d(np.arange(10242), cortex.original_vertices)
    assert set(cut) >= set(WALL[side]) and len(cut) <= len(WALL[side]) + 1
    rim, other = (abs(fsaverage5(name).vertices[fsaverage5(name).boundary]).mean(0) for name in SIDES)
    assert np.linalg.norm(rim - other) < 3


@each_side
def test_endpoints_follow_the_stated_rule_and_are_distinct(side):
    pial, sulc = array("pial", side), array("sulc", side)
    for name, entry in RECORD["sulci"].items():
        for place, vertex in zip(entry[side]["mni305"], entry[side]["vertices"]):
            around = np.flatnonzero(np.linalg.norm(pial - place, axis=1) < RECORD["radius_mm"])
            assert vertex == around[sulc[around].argmax()], name
    assert len({v for entry in RECORD["sulci"].values() for v in entry[side]["vertices"]}) == 2 * 11


@each_side
def test_paths_lie_in_sulci_apart_and_off_the_rim(side):
    surface, paths = opened(side)
    sulc = array("sulc", side)[surface.original_vertices]  # FreeSurfer's sign: positive in sulci
    lengths = np.linalg.norm(np.diff(surface.vertices[surface.edges], axis=1)[:, 0], axis=1)
    graph = coo_array((lengths, surface.edges.T), (len(surface.vertices),) * 2).tocsr()
    rim, *apart = (
        dijkstra(graph, directed=False, indices=sources, min_only=True)
        for sources in (surface.boundary, *paths.values())
    )
    for name, path in paths.items():
        assert sulc[path].mean() > 0.7 and sulc[path].min() > 0.1, name
        assert rim[path].min() > (7 if name == "sylvian fissure" else 15), name  # its anterior end
    for (one, name), (_, other) in combinations(zip(apart, paths), 2):
        assert one[paths[other]].min() > 5, (name, other)


def test_the_demo_names_the_same_places_on_the_opened_surfaces_it_registers():
    moving, control = fsaverage5("right"), fsaverage5("left")
    curves = demo_landmarks()["curves"]
    assert [curve["name"] for curve in curves] == list(RECORD["sulci"])
    for curve in curves:
        entry = RECORD["sulci"][curve["name"]]
        for surface, ends, side in ((moving, curve["moving"], "right"), (control, curve["control"], "left")):
            assert surface.original_vertices[ends].tolist() == entry[side]["vertices"]
            np.testing.assert_array_equal(surface.vertices[ends], array("pial", side)[entry[side]["vertices"]])
    closed = named_sulci("left", np.arange(10242))
    assert closed["central sulcus"] == tuple(RECORD["sulci"]["central sulcus"]["left"]["vertices"])


def test_refusals():
    lost = RECORD["sulci"]["sylvian fissure"]["left"]["vertices"][1]
    with pytest.raises(SurfaceError, match=f"sylvian fissure.*{lost}"):
        named_sulci("left", np.delete(np.arange(10242), lost))
    with pytest.raises(SurfaceError, match="hemisphere"):
        named_sulci("lh", np.arange(10242))
