"""The disk conformal map on real cortex and on 30 ways to make it hard: no triangle is flipped."""

import warnings

import numpy as np
import pytest
import pyvista
from scipy import sparse

from meshes import boundary_loop, random_disk, strip
from qclearn.io.fsaverage import fsaverage5
from qclearn.plane.bijectivity import RepairWarning, check_embedding
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.plane.linear import cotangent_stiffness
from qclearn.surfaces import conformal
from qclearn.surfaces.conformal import angle_distortion, disk_conformal_map
from qclearn.surfaces.surface import Surface, SurfaceError, mirror


def mapped(surface):
    """The map, whatever it warns of, after every promise that its docstring makes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)
        z = disk_conformal_map(surface)
    disk = Disk(z, surface.faces)
    assert len(disk.maybe_flipped) == 0 and disk.certificate.bijective
    np.testing.assert_allclose(abs(z[surface.boundary]), 1, rtol=1e-12)
    assert (abs(np.delete(z, surface.boundary)) < 1).all()
    assert z[surface.boundary[0]] == pytest.approx(1, abs=1e-14)
    assert abs(surface.vertex_areas @ z) < 1e-12 * surface.area
    return z


@pytest.mark.parametrize("kind", ["pial", "white"])
@pytest.mark.parametrize("hemisphere", ["left", "right"])
def test_fsaverage5(hemisphere, kind):
    surface = fsaverage5(hemisphere, kind)
    z = mapped(surface)
    assert abs(angle_distortion(surface, z)).mean() <= 2.55


# Surfaces whose conformal map is known.


def curved(z, height=0.4):
    """A surface over a disk mesh, curved in both directions."""
    return np.stack([z.real, z.imag, height * (z**2).real + 0.3 * z.imag], 1)


def test_flat_disk_is_left_alone_but_for_the_gauge():
    z, faces = polar_disk(12, 36)
    first = boundary_loop(faces)[0]
    f = mapped(Surface(np.stack([z.real, z.imag, 0 * z.real], 1), faces))
    np.testing.assert_allclose(f, z / z[first], atol=2e-3)
    assert abs(angle_distortion(Surface(np.stack([z.real, z.imag, 0 * z.real], 1), faces), f)).max() < 0.6


def test_spherical_cap_is_mapped_by_stereographic_projection():
    errors = []
    for n in (8, 16):
        z, faces = polar_disk(n, 3 * n)
        cap = np.stack([2 * z.real, 2 * z.imag, 1 - abs(z) ** 2], 1) / (1 + abs(z) ** 2)[:, None]
        f = mapped(Surface(cap, faces))
        errors.append(abs(f - z / z[boundary_loop(faces)[0]]).max())
    assert errors[1] < 2e-3 and np.log2(errors[0] / errors[1]) > 1.7


def test_surface_turned_scaled_and_mirrored():
    z, faces = random_disk(seed=8)
    surface = Surface(curved(z), faces)
    f = mapped(surface)
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    for scale in (1.0, 1e-4, 1e4):
        moved = Surface(scale * (surface.vertices @ rotation.T + [1, 2, 3]), faces)
        np.testing.assert_allclose(mapped(moved), f, atol=1e-9)
    np.testing.assert_allclose(mapped(mirror(surface)), f.conj(), atol=1e-11)


@pytest.mark.digits
def test_result_is_discrete_harmonic_where_nothing_was_repaired():
    """Up to the Möbius map of the gauge, of which only a turn remains on a mesh with a symmetry."""
    z, faces = polar_disk(10, 30)
    surface = Surface(np.stack([z.real, z.imag, 0.5 * abs(z) ** 2], 1), faces)
    residual = cotangent_stiffness(surface.vertices, faces) @ mapped(surface)
    assert abs(np.delete(residual, surface.boundary)).max() < 1e-12


def test_smallest_disks():
    for n, height in ((3, 0.4), (5, 3.0)):
        z, faces = polar_disk(1, n)
        mapped(Surface(curved(z, height), faces))


@pytest.mark.parametrize("length", [10, 15, 40])
def test_long_strip(length):
    """Its ends cover exp(-pi length / 2) of the circle: less than rounding resolves, from a length of 15 on."""
    w, faces = strip(4 * length, 4)
    surface = Surface(np.stack([length * w.real, w.imag, 0.1 * np.sin(5 * length * w.real)], 1), faces)
    z = mapped(surface)
    if length <= 10:
        assert abs(angle_distortion(surface, z)).mean() < 16


# Stress: what acquisition, cutting and remeshing do to a hemisphere.


def largest_disk(vertices, faces):
    """The largest piece without bow-ties of what is left of a disk after faces at its rim were taken away."""
    n = len(vertices)
    while True:
        tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        edge = np.unique(np.minimum(tails, heads) * n + np.maximum(tails, heads), return_inverse=True)[1]
        nodes = len(faces) + edge.max() + 1  # faces and edges
        link = sparse.coo_array(
            (np.ones(edge.size), (np.repeat(np.arange(len(faces)), 3), len(faces) + edge)), shape=(nodes, nodes)
        )
        piece = sparse.csgraph.connected_components(link, directed=False)[1][: len(faces)]
        kept = piece == np.bincount(piece).argmax()
        rim = tails[(np.bincount(edge)[edge] == 1) & np.repeat(kept, 3)]
        bow_ties = np.bincount(rim, minlength=n) > 1
        faces = faces[kept]
        if not bow_ties.any():
            used, corner = np.unique(faces, return_inverse=True)
            return Surface(vertices[used], corner.reshape(-1, 3))
        faces = faces[~bow_ties[faces].any(1)]


def at_rim(surface):
    return np.isin(surface.faces, surface.boundary).any(1)


def without_rings(surface, rng, rings):
    for _ in range(rings):
        surface = largest_disk(surface.vertices, surface.faces[~at_rim(surface)])
    return surface


def ragged(surface, rng, rounds, share=0.4):
    for _ in range(rounds):
        gone = at_rim(surface) & (rng.uniform(size=len(surface.faces)) < share)
        surface = largest_disk(surface.vertices, surface.faces[~gone])
    return surface


def noisy(surface, rng, amount):
    """Every vertex moved at random by up to `amount` of the mean edge length."""
    ends = surface.vertices[surface.edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean()
    shift = rng.normal(size=surface.vertices.shape)
    shift *= amount * length * rng.uniform(size=(len(shift), 1)) / np.linalg.norm(shift, axis=1, keepdims=True)
    return Surface(surface.vertices + shift, surface.faces)


def with_slivers(surface, rng, count, flatness):
    """A new vertex in each of `count` faces, at `flatness` of the height over the middle of a side."""
    chosen = rng.choice(len(surface.faces), count, replace=False)
    a, b, c = surface.faces[chosen].T
    weights = np.array([(1 - flatness) / 2, (1 - flatness) / 2, flatness])
    points = np.einsum("k,fkc->fc", weights, surface.vertices[surface.faces[chosen]])
    new = len(surface.vertices) + np.arange(count)
    parts = np.concatenate([np.stack(part, 1) for part in ((a, b, new), (b, c, new), (c, a, new))])
    return Surface(
        np.concatenate([surface.vertices, points]), np.concatenate([np.delete(surface.faces, chosen, axis=0), parts])
    )


def decimated(surface, rng, kept):
    mesh = pyvista.PolyData.from_regular_faces(surface.vertices, surface.faces).decimate(1 - kept)
    return largest_disk(np.asarray(mesh.points, float), mesh.regular_faces.astype(np.int64))


def peninsula(surface, rng, steps):
    """A corridor cut out on both sides along a path into the surface, left attached at its inner end only."""
    graph = sparse.coo_array((np.ones(len(surface.edges)), surface.edges.T), shape=(len(surface.vertices),) * 2)
    depth = sparse.csgraph.dijkstra(graph, directed=False, indices=surface.boundary, unweighted=True, min_only=True)
    start = surface.boundary[int(rng.integers(len(surface.boundary)))]
    away, previous = sparse.csgraph.dijkstra(graph, False, start, return_predecessors=True, unweighted=True)
    inside = np.flatnonzero(depth >= steps)
    path = [inside[away[inside].argmin()]]
    while path[-1] != start:
        path.append(previous[path[-1]])
    distance = sparse.csgraph.dijkstra(graph, directed=False, indices=path, unweighted=True, min_only=True)
    wall = (distance[surface.faces].min(1) >= 1) & (distance[surface.faces].max(1) <= 2)
    wall &= away[surface.faces].max(1) <= steps - 2
    return largest_disk(surface.vertices, surface.faces[~wall])


STRESS = [(without_rings, k) for k in (1, 2, 4, 8)] + [(ragged, k) for k in (1, 2, 3, 5, 8)]
STRESS += [(noisy, amount) for amount in (0.1, 0.25, 0.5, 0.5, 0.5)]
STRESS += [(with_slivers, 600, flatness) for flatness in (0.1, 0.01, 1e-3, 1e-5)]
STRESS += [(decimated, kept) for kept in (0.5, 0.3, 0.2, 0.1, 0.05)] + [(peninsula, steps) for steps in (6, 10, 14)]
COMBINED = [
    ((ragged, 3), (noisy, 0.5)), ((decimated, 0.2), (ragged, 3)), ((decimated, 0.2), (noisy, 0.3)),
    ((ragged, 4), (with_slivers, 600, 1e-3)), ((noisy, 0.3), (with_slivers, 300, 1e-2)),
]  # fmt: skip
VARIANTS = [(step,) for step in STRESS] + COMBINED
HARDEST = {3, 8, 13, 17, 22, 25, *range(len(STRESS), len(VARIANTS))}  # of each kind, and all combined
FOUR = [(hemisphere, kind) for hemisphere in ("left", "right") for kind in ("pial", "white")]


def stressed(surface, variant, seed):
    rng = np.random.default_rng(seed)
    for change, *arguments in variant:
        surface = change(surface, rng, *arguments)
    return surface


@pytest.mark.parametrize(
    "number",
    [number if number in HARDEST else pytest.param(number, marks=pytest.mark.slow) for number in range(len(VARIANTS))],
    ids=lambda number: "-".join(f"{change.__name__} {arguments[-1]}" for change, *arguments in VARIANTS[number]),
)
def test_stressed_cortex_has_no_flipped_triangle(number):
    mapped(stressed(fsaverage5(*FOUR[number % 4]), VARIANTS[number], number))


def test_repair_is_reported():
    with pytest.warns(RepairWarning, match=r"rows switched to mean-value weights: [1-9]"):
        disk_conformal_map(stressed(fsaverage5("left", "pial"), [(with_slivers, 600, 1e-5)], 0))


def test_the_last_resort_is_positive_weights_everywhere(monkeypatch):
    monkeypatch.setattr(conformal, "repair", lambda matrix, picture, lengths, before: (picture, [], None, 0))
    surface = stressed(fsaverage5("left", "pial"), [(with_slivers, 600, 1e-5)], 0)
    with pytest.warns(RepairWarning, match="Tutte's weights everywhere: not conformal"):
        z = disk_conformal_map(surface)
    assert check_embedding(surface.faces, z).bijective


def test_disk_without_interior_vertex():
    with pytest.raises(SurfaceError, match="no interior vertex"):
        disk_conformal_map(Surface([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]))
