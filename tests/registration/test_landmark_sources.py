"""Curves put in order from sets of vertices, and fsaverage5's: their ends, and what is refused."""

from types import SimpleNamespace

import numpy as np
import pytest

from known_surfaces import sheet
from qclearn.io.fsaverage import demo_landmarks, fsaverage5
from qclearn.registration import landmark_sources
from qclearn.registration.landmark_sources import ordered, threaded
from qclearn.registration.problem import LandmarkError

N = 31


@pytest.fixture(scope="module")
def flat():
    return sheet(N, 30.0, lambda x, y: 0.01 * x * y)[0]


def grown(surface, vertices, times):
    """The vertices and those at most so many edges away."""
    near = np.isin(np.arange(len(surface.vertices)), vertices)
    for _ in range(times):
        near[surface.edges[near[surface.edges].any(1)].ravel()] = True
    return np.flatnonzero(near)


def test_a_drawn_line_may_be_thick_and_bent(flat):
    corner = [*range(5 * N + 5, 5 * N + 26), *range(6 * N + 25, 26 * N + 25, N)]
    path = ordered(flat, np.random.default_rng(1).permutation(grown(flat, corner, 1)))
    ends = flat.vertices[path[[0, -1]]]
    assert np.linalg.norm(ends - flat.vertices[[corner[0], corner[-1]]], axis=1).max() < 2 or (
        np.linalg.norm(ends[::-1] - flat.vertices[[corner[0], corner[-1]]], axis=1).max() < 2
    )
    edges = {tuple(edge) for edge in flat.edges.tolist()}
    assert all(tuple(sorted(pair)) in edges for pair in zip(path.tolist(), path[1:].tolist()))


def row(first, last, at=15):
    return [at * N + k for k in range(first, last)]


RING = [k for k in range(N * N) if 9 < np.hypot(k % N - 15, k // N - 15) < 10.5]


@pytest.mark.parametrize(
    "vertices, message",
    [
        ([], "0 vertices on this surface"),
        ([7, 7], "1 vertex on this surface"),
        ([*row(2, 12), *row(14, 20)], r"in 2 pieces \(of 10, 6 vertices\)"),
        ([k for k in range(N * N) if np.hypot(k % N - 15, k // N - 15) < 8], "no curve: its .* mm beside a path"),
        ([k for at in range(10, 20) for k in row(2, 29, at)], "no curve"),  # three times as long as wide
        ([*row(5, 26), *[at * N + 15 for at in range(16, 28)]], "no curve"),
        (RING, "no curve"),
    ],
)
def test_what_is_no_curve_is_refused(flat, vertices, message):
    with pytest.raises(LandmarkError, match=message):
        ordered(flat, np.array(vertices, int))


def test_points_are_joined_in_their_order(flat):
    stops = np.array([3, 3, 10 * N + 3, 10 * N + 20])
    path = threaded(flat, stops)
    assert path[0] == 3 and path[-1] == stops[-1] and stops[2] in path and (path[1:] != path[:-1]).all()
    np.testing.assert_array_equal(threaded(flat, stops[:2]), [3, 3])


def test_the_hemisphere_that_agrees_better_is_carried_and_refused_where_it_is_suspect(flat, monkeypatch):
    def run(moving, *_):
        r = 0.8 if np.array_equal(moving.vertices, fsaverage5("right").vertices) else 0.5
        return SimpleNamespace(report={"r": {"depth": [0.3, r]}, "suspect": [f"features: {r}"]})

    monkeypatch.setattr(landmark_sources, "register", run)
    for given, told in ((None, "right hemisphere does not fit: features: 0.8"), ("left", "left .* features: 0.5")):
        with pytest.raises(LandmarkError, match=told):
            landmark_sources.carried(flat, given)


def test_fsaverage5s_own_curves_are_those_of_the_demo():
    ends, off, hemisphere = landmark_sources.carried(fsaverage5("right"))
    assert {name: list(pair) for name, pair in ends.items()} == {
        curve["name"]: curve["moving"] for curve in demo_landmarks()["curves"]
    }
    assert hemisphere == "right" and set(off.values()) == {None}
