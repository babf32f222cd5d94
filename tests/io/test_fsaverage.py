"""The named sulci of fsaverage5: the rule that chose them, the paths between them, both sides
against each other."""

import json
import warnings
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
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.mobius import best_mobius, mobius
from qclearn.registration.curves import fundus_metric, fundus_path, sample_curve
from qclearn.surfaces.conformal import disk_conformal_map
from qclearn.surfaces.surface import SurfaceError, mirror

SIDES = ("left", "right")
RECORD, WALL = (
    json.loads(files("qclearn.io").joinpath(f"fsaverage5_{name}.json").read_text()) for name in ("sulci", "wall")
)
ANNOTATION = Path(nilearn.surface.__file__).parent / "tests" / "data" / "test.annot"


def array(kind, side, number=0):
    return np.asarray(nibabel.load(fetch_surf_fsaverage("fsaverage5")[f"{kind}_{side}"]).darrays[number].data)


@cache
def opened(side):
    """The pial surface without its medial wall, and its vertices' old indices."""
    surface = fsaverage5(side)
    return surface, surface.original_vertices


@cache
def paths(side):
    surface, kept = opened(side)
    metric = fundus_metric(surface)
    return {name: fundus_path(surface, *ends, metric) for name, ends in named_sulci(side, kept).items()}


@cache
def samples(side):
    """Ten points a curve in the conformal disk, the right side mirrored: dict name -> (10,)
    complex."""
    surface = opened(side)[0] if side == "left" else mirror(opened(side)[0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)  # the rim of the right side needs raised boundary steps
        z = disk_conformal_map(surface)
    return {name: sample_curve(surface, path) @ z for name, path in paths(side).items()}


def residual(p, q):
    """Mean distance of each curve (K,) that the best Möbius map leaves between (K, 10) points."""
    return abs(mobius(p, *best_mobius(p.ravel(), q.ravel())) - q).mean(axis=1)


def test_the_record_is_complete():
    for side in SIDES:
        vertices = [v for entry in RECORD["sulci"].values() for v in entry[side]["vertices"]]
        assert len(set(vertices)) == 2 * 11 and min(vertices) >= 0 and max(vertices) < 10242


def test_the_wall_is_what_the_annotation_leaves_out():
    labels, _, names = nibabel.freesurfer.read_annot(ANNOTATION)
    wall = np.isin(labels, [names.index(b"unknown"), names.index(b"corpuscallosum")])
    assert WALL["left"] == np.flatnonzero(wall).tolist()


@pytest.mark.parametrize("side", SIDES)
def test_both_walls_leave_one_medial_gap(side):
    """The right wall against the left one: as many vertices, in the same place."""
    cortex, wider = (fsaverage5(side, wall=wall) for wall in ("cortex", "thickness"))
    assert set(cortex.original_vertices) < set(wider.original_vertices)
    assert 0.085 < 1 - cortex.area / whole_fsaverage5(side, "pial").area < 0.1
    cut = np.setdiff1d(np.arange(10242), cortex.original_vertices)
    assert set(cut) >= set(WALL[side]) and len(cut) <= len(WALL[side]) + 1
    rim, other = (abs(fsaverage5(name).vertices[fsaverage5(name).boundary]).mean(0) for name in SIDES)
    assert np.linalg.norm(rim - other) < 3


@pytest.mark.parametrize("side", SIDES)
def test_endpoints_follow_the_stated_rule(side):
    pial, sulc = array("pial", side), array("sulc", side)
    for name, entry in RECORD["sulci"].items():
        for place, vertex in zip(entry[side]["mni305"], entry[side]["vertices"]):
            around = np.flatnonzero(np.linalg.norm(pial - place, axis=1) < RECORD["radius_mm"])
            assert vertex == around[sulc[around].argmax()], name


@pytest.mark.parametrize("side", SIDES)
def test_paths_lie_in_sulci_apart_and_off_the_rim(side):
    surface, kept = opened(side)
    sulc = array("sulc", side)[kept]  # FreeSurfer's sign: positive in sulci
    lengths = np.linalg.norm(np.diff(surface.vertices[surface.edges], axis=1)[:, 0], axis=1)
    graph = coo_array((lengths, surface.edges.T), (len(surface.vertices),) * 2).tocsr()
    rim, *apart = (
        dijkstra(graph, directed=False, indices=sources, min_only=True)
        for sources in (surface.boundary, *paths(side).values())
    )
    for name, path in paths(side).items():
        assert sulc[path].mean() > 0.7 and sulc[path].min() > 0.1, name
        assert rim[path].min() > (7 if name == "sylvian fissure" else 15), name  # its anterior end
    for (one, name), (_, other) in combinations(zip(apart, paths(side)), 2):
        assert one[paths(side)[other]].min() > 5, (name, other)


def test_both_sides_agree_up_to_a_mobius_map():
    p, q = (np.stack(list(samples(side).values())) for side in ("right", "left"))
    errors = residual(p, q)
    assert errors.mean() < 0.025 and errors.max() < 0.045
    for k, name in enumerate(samples("left")):  # a curve that runs the other way on one side would show
        turned = p.copy()
        turned[k] = turned[k, ::-1]
        assert residual(turned, q)[k] > 1.5 * errors[k], name


def test_both_sides_have_the_same_anatomy_in_space():
    for name, entry in RECORD["sulci"].items():
        left, right = (array("pial", side)[entry[side]["vertices"]] for side in SIDES)
        apart = np.linalg.norm(left * [-1, 1, 1] - right, axis=1)
        assert apart.max() < 10, name
        assert np.linalg.norm(left * [-1, 1, 1] - right[::-1], axis=1).min() > 15, name


def test_indices_are_those_of_the_opened_surface():
    kept = opened("right")[1]
    for name, ends in named_sulci("right", kept).items():
        assert kept[list(ends)].tolist() == RECORD["sulci"][name]["right"]["vertices"]
    closed = named_sulci("left", np.arange(10242))
    assert closed["central sulcus"] == tuple(RECORD["sulci"]["central sulcus"]["left"]["vertices"])


def test_the_demo_names_the_same_places_on_the_surfaces_it_registers():
    moving, control = fsaverage5("right"), fsaverage5("left")
    curves = demo_landmarks()["curves"]
    assert [curve["name"] for curve in curves] == list(RECORD["sulci"])
    for curve in curves:
        entry = RECORD["sulci"][curve["name"]]
        for surface, ends, side in ((moving, curve["moving"], "right"), (control, curve["control"], "left")):
            np.testing.assert_array_equal(surface.vertices[ends], array("pial", side)[entry[side]["vertices"]])


def test_refusals():
    lost = RECORD["sulci"]["sylvian fissure"]["left"]["vertices"][1]
    with pytest.raises(SurfaceError, match=f"sylvian fissure.*{lost}"):
        named_sulci("left", np.delete(np.arange(10242), lost))
    with pytest.raises(SurfaceError, match="hemisphere"):
        named_sulci("lh", np.arange(10242))
