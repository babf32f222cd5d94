"""Blind tubes on a surface: the disk map stays a bijection, and elsewhere what it was."""

from itertools import pairwise

import numpy as np
import pytest

import qclearn as qc
from qclearn.plane.bijectivity import BijectivityError
from qclearn.plane.grids import polar_disk
from qclearn.surfaces import conformal, fingers
from qclearn.surfaces.conformal import parameterize

LEFT = qc.fsaverage5("left")
RADIUS = 1.2  # mm
AT = 500  # a vertex of the convexity


def ring_around(surface, vertex):
    """The neighbours of an inner vertex in their order around it."""
    used, corners = np.unique(surface.faces[(surface.faces == vertex).any(1)], return_inverse=True)
    return used[qc.Surface(surface.vertices[used], corners.reshape(-1, 3)).boundary]


def with_finger(surface, vertex, radii, radius=RADIUS):
    """The surface with a blind tube, so many radii long, that ends in the vertex."""
    ring = ring_around(surface, vertex)
    centre, count = surface.vertices[ring].mean(0), len(ring)
    axis = np.cross(surface.vertices[ring], np.roll(surface.vertices[ring], -1, axis=0)).sum(0)
    axis /= np.linalg.norm(axis)
    first = surface.vertices[ring[0]] - centre
    first -= axis * (axis @ first)
    first /= np.linalg.norm(first)
    turns = 2 * np.pi * np.arange(count)[:, None] / count
    circle = radius * (np.cos(turns) * first + np.sin(turns) * np.cross(axis, first))
    step = radius * 2 * np.pi / count
    rows = round(radii * radius / step)
    tube = [centre + circle + axis * step * row for row in range(1, rows + 1)]
    rings = [ring, *np.arange(len(surface.vertices), len(surface.vertices) + rows * count).reshape(rows, count)]
    faces = [surface.faces[(surface.faces != vertex).all(1)]]
    for outer, inner in pairwise(rings):
        after = np.roll(outer, -1), np.roll(inner, -1)
        faces += [np.stack([outer, after[0], after[1]], 1), np.stack([outer, after[1], inner], 1)]
    faces.append(np.stack([inner, np.roll(inner, -1), np.full(count, vertex)], 1))
    vertices = np.concatenate([surface.vertices, *tube])
    vertices[vertex] = centre + axis * step * (rows + 0.7)
    return qc.Surface(vertices, np.concatenate(faces))


@pytest.fixture(scope="module")
def plain():
    return parameterize(LEFT)


@pytest.mark.parametrize("radii", [5, 10, 20, 40, 150])
def test_a_finger_moves_nothing_else(radii, plain):
    side = parameterize(with_finger(LEFT, AT, radii))
    assert side.disk.certificate.bijective
    others = np.delete(np.arange(len(LEFT.vertices)), AT)
    assert abs(side.disk.z[others] - plain.disk.z[others]).max() < 1e-3
    if radii > 5:  # so short a one the disk holds as it is
        (message,) = side.messages
        length = float(message.split(", ")[1].split()[0])
        assert message.startswith("a finger of") and 0.7 * radii * RADIUS < length < radii * RADIUS + 1
        tip = side.surface.vertices[AT]
        assert np.linalg.norm(side.surface.vertices[side.fingers].mean(0) - tip) < 0.7 * radii * RADIUS
        assert AT in side.fingers and not side.vertex_shares[side.fingers].any()


def test_two_fingers_and_one_at_the_rim():
    by_rim = 103  # two edges from it
    side = parameterize(with_finger(with_finger(LEFT, AT, 20), by_rim, 30))
    assert side.disk.certificate.bijective and len(side.messages) == 2
    assert set(side.fingers) > {AT, by_rim}


def test_a_finger_on_a_finger():
    """Shortest paths from the second one to the root meet where it leaves the first."""
    first = with_finger(LEFT, AT, 30)
    middle = len(LEFT.vertices) + (len(first.vertices) - len(LEFT.vertices)) // 2
    side = parameterize(with_finger(first, middle, 100, RADIUS / 2))
    assert side.disk.certificate.bijective and len(side.messages) == 1
    assert set(side.fingers) > {AT, middle}


def test_a_short_edge_is_no_finger(plain):
    """Edges that are short in space are short in the disk, and nothing is left out there."""
    one, two = LEFT.edges[~np.isin(LEFT.edges, LEFT.boundary).any(1)][5000]
    vertices = LEFT.vertices.copy()
    vertices[two] = vertices[one] + 1e-5 * (vertices[two] - vertices[one])
    side = parameterize(qc.Surface(vertices, LEFT.faces))
    assert abs(side.disk.z[one] - side.disk.z[two]) < fingers.SMALLEST
    assert side.messages == () and not len(side.fingers)
    assert abs(side.disk.z - plain.disk.z)[np.arange(len(vertices)) != two].max() < 1e-3


@pytest.mark.parametrize("radii", [30, 100, 300])
def test_a_finger_and_little_else(radii, monkeypatch):
    """With the usual weights the map of a long one would fold."""
    z, faces = polar_disk(4, 12)
    surface = with_finger(qc.Surface(np.stack([3 * z.real, 3 * z.imag, 0 * z.real], 1), faces), 0, radii)
    side = parameterize(surface)
    assert side.disk.certificate.bijective and "a finger" in side.messages[0]
    if radii == 100:
        monkeypatch.setattr(conformal, "find_fingers", lambda surface, z: [])
        with pytest.raises(BijectivityError, match="in double precision"):
            parameterize(surface)


def test_the_fit_leaves_a_finger_out():
    """Of a surface onto itself: the other vertices stay, and the report says where the finger is."""
    found = qc.register(with_finger(LEFT, AT, 20), LEFT, [])
    others = np.delete(np.arange(len(LEFT.vertices)), AT)
    off = np.linalg.norm(found.points[others] - LEFT.vertices[others], axis=1)
    assert found.report["bijective"] and not found.report["suspect"] and off.mean() < 0.1  # mm
    assert any(message.startswith("moving: a finger of") for message in found.report["fallbacks"])
