"""Cortical surfaces in the browser's modules, run by node, against the library: points, paths, distances."""

import numpy as np
import pytest
from reference import pairs, run_engine

from qcbook.examples import cortices
from qcbook.explore_landmarks import Landmarks, fundus_terms
from qcbook.livefiles import hemisphere_file
from qcbook.liveproblems import unfolded
from qclearn.registration.curves import curve_distance, curves_in_space

WEIGHTS = (0.5, 2.0), (0.0, 0.0), (1.5, 0.0)


@pytest.fixture(scope="module")
def states():
    """The calcarine sulcus of fsaverage5 with three choices of the weights, and ends of the reader's own."""
    start = Landmarks.initial | {"hemisphere": "cortex", "sulcus": 3}
    made = [start | {"curvature": curvature, "depth": depth} for curvature, depth in WEIGHTS]
    return [*made, start | {"ends": {"0": 17, "1": 4000}}]


@pytest.fixture(scope="module")
def found(states, tmp_path_factory):
    pair, rng = cortices("cortex"), np.random.default_rng(4)
    curvature, depth, deep = fundus_terms(pair.moving.surface)
    file = tmp_path_factory.mktemp("surfaces") / "moving.bin"
    file.write_bytes(hemisphere_file(pair.moving, curvature=curvature, depth=depth, deep=deep))
    points = 0.99 * np.sqrt(rng.random(300)) * np.exp(2j * np.pi * rng.random(300))
    asked = [{name: state[name] for name in ("curvature", "depth")} for state in states]
    ends = [Landmarks().ends(state) for state in states]
    paths = [one | {"ends": two} for one, two in zip(asked, ends)]
    return points, run_engine("surface", file=str(file), points=pairs(points), paths=paths)


def test_points_are_lifted_to_where_the_library_lifts_them(found):
    points, answer = found
    there = cortices("cortex").moving.lift(points)
    assert np.linalg.norm(np.array(answer["lifted"]) - there, axis=1).max() < 0.05  # mm: numbers in two bytes


def test_paths_are_the_librarys(found, states):
    """They may differ where two ways cost the same: so their costs are compared, and most of their vertices."""
    live, surface = Landmarks(), cortices("cortex").moving.surface
    for state, answer in zip(states, found[1]["paths"]):
        path, cost = live.path(state)
        assert answer["cost"] == pytest.approx(cost, rel=1e-4)
        assert [answer["path"][0], answer["path"][-1]] == live.ends(state)
        assert len(set(answer["path"]) & set(path.tolist())) > 0.8 * len(path)
        length = np.linalg.norm(np.diff(surface.vertices[answer["path"]], axis=0), axis=1).sum()
        assert answer["length"] == pytest.approx(length, rel=1e-4)
    assert found[1]["paths"][1]["length"] < 0.99 * found[1]["paths"][0]["length"]  # without weights it is the shortest


def test_distances_of_curves_are_the_librarys(found):
    side = cortices("cortex").moving
    curves = [side.disk.z[answer["path"]] for answer in found[1]["paths"][:2]]
    assert found[1]["apart"] == pytest.approx(curve_distance(*curves_in_space(side, curves)), rel=2e-3)


def test_an_unfolded_surface_keeps_its_area_and_loses_its_folds():
    surface = cortices("cortex").control.surface
    x = unfolded(surface)

    def area_and_bend(vertices):
        a, b, c = (vertices[surface.faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        size = np.linalg.norm(normal, axis=1)
        total = np.zeros_like(vertices)
        np.add.at(total, surface.faces.ravel(), np.repeat(normal, 3, axis=0))
        spread = np.linalg.norm(total, axis=1) / np.bincount(surface.faces.ravel(), np.repeat(size, 3))
        return (size.sum() / 2, 1 - spread.mean())  # how far the triangles around a vertex point the same way

    (area, bend), (area_after, bend_after) = area_and_bend(surface.vertices), area_and_bend(x)
    assert area_after == pytest.approx(area, rel=1e-9) and bend_after < 0.2 * bend
