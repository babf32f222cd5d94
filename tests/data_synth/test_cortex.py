"""The grown hemisphere: a folded disk with curves in its sulci, the same for the same seed, and files of it."""

import json
from dataclasses import asdict, replace
from functools import cache
from itertools import pairwise

import numba
import numpy as np
import pytest

from data_synth import CortexError, correspondence, load_cortex, make_cortex, save_cortex, unfolded
from data_synth.compiled import compiled
from data_synth.correspondence import depth_correlation, locate_on_sphere
from data_synth.fundus import trim
from data_synth.generations import GENERATION, GENERATIONS
from data_synth.growth import depth_below, grow, hull_distance, neighbour_table
from data_synth.individual import Individual
from data_synth.intersections import self_intersections
from data_synth.pattern import FILE, pattern, template_folds
from data_synth.template import (
    CENTRE,
    SULCI,
    AreaKeeping,
    Diffeomorphism,
    area_vectors,
    fibonacci_sphere,
    hull_radius,
    sulcus_course,
    unit,
    wall_level,
)
from data_synth.tessellation import interior_edges
from data_synth.untangle import untangle
from known_surfaces import sphere
from qclearn import mean_curvature, read_surface, sulcal_depth
from qclearn.registration.curves import curve_distance
from qclearn.registration.report import log2_distortions
from qclearn.surfaces.surface import Surface, SurfaceError, require_disk, require_outward
from subjects import grown

SIZE = 2500


@cache
def subject(seed=1, hemisphere="left"):
    return grown(seed, SIZE, hemisphere)


@pytest.mark.parametrize("hemisphere", ["left", "right"])
def test_a_hemisphere_is_an_outward_disk_in_millimetres(hemisphere):
    surface = subject(1, hemisphere).surface
    require_disk(surface)
    require_outward(surface)
    assert len(surface.vertices) == SIZE
    assert 80_000 < surface.area < 110_000
    assert len(self_intersections(surface.vertices, surface.faces)) <= 0.002 * len(surface.faces)
    length = np.ptp(surface.vertices, axis=0)
    assert length[1] > length[2] > length[0]  # anterior-posterior, vertical, lateral
    medial = surface.vertices[surface.boundary, 0].mean() - surface.vertices[:, 0].mean()
    assert medial > 0 if hemisphere == "left" else medial < 0


@pytest.mark.parametrize("hemisphere", ["left", "right"])
def test_the_template_is_one_to_one_and_ends_at_the_common_wall(hemisphere):
    cortex = subject(1, hemisphere)
    template, faces = cortex.template, cortex.surface.faces
    assert np.allclose(np.linalg.norm(template, axis=1), 1)
    side = np.linalg.det(template[faces])
    assert (side > 0).all() if hemisphere == "right" else (side < 0).all()
    level = wall_level(template)
    assert np.allclose(level[cortex.surface.boundary], 1, atol=1e-6)
    inner = np.setdiff1d(np.arange(SIZE), cortex.surface.boundary)
    assert level[inner].min() > 0.99


def test_curves_are_paths_of_edges_in_folds():
    surface = subject().surface
    assert set(subject().curves) == set(SULCI)
    curvature, depth = mean_curvature(surface), sulcal_depth(surface)
    assert np.corrcoef(curvature, depth)[0, 1] < -0.4 and depth.max() > 12  # mm
    edges = set(map(tuple, surface.edges))
    concave = []
    for path in surface.curves.values():
        assert len(path) >= 2 and len(np.unique(path)) == len(path)
        assert all((min(pair), max(pair)) in edges for pair in pairwise(path))
        concave.append((curvature[path] < 0).mean())
    assert np.median(concave) > 0.85
    every = np.concatenate(list(surface.curves.values()))
    assert depth[every].mean() > 1.6 * np.average(depth, weights=surface.vertex_areas)


def test_paths_are_cut_at_their_shallow_ends():
    x = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)])
    depth = np.array([0.0, 1.0, 5.0, 4.0, 3.0, 2.0])
    assert trim(x, np.arange(6), depth, 3.5).tolist() == [2, 3, 4, 5]
    assert trim(x, np.arange(6), depth, 5.0).tolist() == [0, 1, 2, 3, 4, 5]


def test_curves_lie_where_anatomy_has_them():
    surface = subject().surface  # left: lateral is negative x
    place = {
        name: surface.vertices[path].mean(axis=0) - surface.vertices.mean(axis=0)
        for name, path in surface.curves.items()
    }
    assert place["calcarine sulcus"][1] < place["central sulcus"][1] < place["superior frontal sulcus"][1]
    assert place["superior temporal sulcus"][2] < place["sylvian fissure"][2] < place["intraparietal sulcus"][2]
    assert place["superior temporal sulcus"][0] < place["cingulate sulcus"][0]
    assert place["central sulcus"][2] > 0 > place["superior temporal sulcus"][2]


def test_curves_follow_the_courses_on_the_template():
    names = list(SULCI)
    centre = {
        seed: np.stack([subject(seed).template[subject(seed).curves[name]].mean(axis=0) for name in names])
        for seed in (1, 2)
    }
    apart = np.linalg.norm(centre[1][:, None] - centre[2][None], axis=2)
    assert (apart.argmin(axis=1) == np.arange(len(names))).all()


def test_the_seed_decides_everything():
    once, again = (make_cortex(1, 1000, generation=GENERATION) for _ in range(2))  # a stored one is of other kernels
    assert again.generation == GENERATION
    assert np.array_equal(again.surface.vertices, once.surface.vertices)
    assert np.array_equal(again.surface.faces, once.surface.faces)
    assert np.array_equal(again.template, once.template)
    assert all(np.array_equal(again.curves[name], path) for name, path in once.curves.items())
    assert not np.array_equal(grown(2, 1000).surface.faces, once.surface.faces)


def test_folds_correspond():
    """A generation whose folds slid off their furrows had 0.68, and curves 5 mm apart."""
    one, other = subject(1), subject(2)
    assert depth_correlation(one, other) > 0.77 and depth_correlation(one, one) == pytest.approx(1)
    truth = correspondence(one, other)
    apart = [curve_distance(truth[path], other.surface.vertices[other.curves[k]]) for k, path in one.curves.items()]
    assert np.mean(apart) < 3.5


def test_areas_correspond_before_growth_where_the_deformation_keeps_them():
    cortex, vary = grown(1, 1000), {}
    template, faces = cortex.template, cortex.surface.faces
    for number in GENERATIONS:
        here, there = (unfolded(replace(cortex, seed=seed, generation=number), template) for seed in (1, 2))
        vary[number] = log2_distortions(Surface(here, faces), there)["log2_area"][1]
    assert vary[4] < 0.6 * vary[3]


def test_generations_are_not_mixed():
    with pytest.raises(CortexError, match="generation is 2; this version makes 3"):
        make_cortex(1, SIZE, generation=2)
    other = replace(subject(2), generation=2)
    for pair in (correspondence, depth_correlation):
        with pytest.raises(CortexError, match="of the generations 2, 3"):
            pair(subject(), other)


def test_the_template_leans_to_itself():
    """The kept pattern is that of the template's own folds, deep where its named sulci run, and even in between."""
    courses = {name: sulcus_course(points)[20:-20] for name, points in SULCI.items()}
    assert min(pattern(course).mean() for course in courses.values()) > 0.3
    tree, depth = template_folds()
    np.testing.assert_allclose(pattern(tree.data[:50]), depth[:50], atol=1e-3)
    assert depth.min() < 0 < depth.max()


@pytest.mark.parametrize("generation", GENERATIONS)
def test_the_pattern_was_grown_with_the_constants_of_each_generation(generation):
    """All but those of the deformation, which the template itself has not."""
    deformation = dict.fromkeys(["variability", "smoothness", "keeps_area"])
    here = json.loads(json.dumps(asdict(GENERATIONS[generation])))
    there = json.loads(FILE.read_text())["guidance"]
    assert here | deformation == there | deformation


def test_gaps_and_branches_are_recorded_where_they_were_drawn():
    """Strength along a course falls in the middle where, and only where, the sulcus is listed as interrupted."""
    for seed in range(3):
        person = Individual(seed, "left")
        person.rng = np.random.default_rng(seed)  # as if the mesh had been made
        assert not person.interrupted and not person.branched
        middle = {name: np.linspace(0.2, 0.8, 200) * (len(course) - 1) for name, course in person.courses.items()}
        points = {name: person.position(course[middle[name].astype(int)]) for name, course in person.courses.items()}
        pull = person.furrows(np.concatenate(list(points.values()))).pull
        weakest = pull.reshape(len(points), 200).min(axis=1)
        gap = [name in person.interrupted for name in person.courses]
        assert set(person.interrupted) | set(person.branched) <= set(SULCI)
        assert (weakest[np.logical_not(gap)] > 0.99).all()
        assert (weakest[gap] < 0.95).all()  # a branch or a neighbour may start at a gap's edge, seldom in it


def test_two_sides_of_a_seed_resemble_each_other():
    probe = fibonacci_sphere(400)
    places = {key: Individual(*key).deform(probe) for seed in range(4) for key in [(seed, "left"), (seed, "right")]}
    between_sides = [np.linalg.norm(places[s, "left"] - places[s, "right"], axis=1).mean() for s in range(4)]
    between_seeds = [np.linalg.norm(places[s, "left"] - places[(s + 1) % 4, "left"], axis=1).mean() for s in range(4)]
    assert 0 < np.mean(between_sides) < 0.8 * np.mean(between_seeds)


@pytest.mark.parametrize("other", [(2, "left"), (1, "right")])
def test_correspondence_there_and_back(other):
    a, b = subject(), subject(*other)
    face, weights = locate_on_sphere(b.template, b.surface.faces, a.template)
    corners = b.surface.faces[face]
    assert np.allclose(correspondence(a, b), np.einsum("pk,pkj->pj", weights, b.surface.vertices[corners]))
    back = np.einsum("pk,pkj->pj", weights, correspondence(b, a)[corners])
    error = np.linalg.norm(back - a.surface.vertices, axis=1)
    edge = np.linalg.norm(np.diff(a.surface.vertices[a.surface.edges], axis=1)[:, 0], axis=1).mean()
    assert error.mean() < 0.5 * edge and np.quantile(error, 0.95) < edge


def test_correspondence_is_exact_on_the_template_and_total():
    a, b = subject(), subject(2)
    face, weights = locate_on_sphere(b.template, b.surface.faces, a.template)
    assert (weights >= 0).all() and np.allclose(weights.sum(axis=1), 1)
    found = unit(np.einsum("pk,pkj->pj", weights, b.template[b.surface.faces[face]]))
    inner = np.setdiff1d(np.arange(SIZE), a.surface.boundary)
    error = np.linalg.norm(found - a.template, axis=1)
    assert np.quantile(error[inner], 0.99) < 1e-12
    assert error.max() < 0.2 * np.sqrt(4 * np.pi / SIZE)  # between the chords of two rims
    assert np.allclose(correspondence(a, a), a.surface.vertices)


@pytest.mark.parametrize("arguments, what", [
    ((1, -5), "n_vertices is -5"), ((1, 10**9), "n_vertices"), ((1, 2500.0), "whole number"),
    ((-1, SIZE), "seed is -1"), (("one", SIZE), "seed"), ((1, SIZE, "both"), "left, right"),
])  # fmt: skip
def test_impossible_requests(arguments, what):
    with pytest.raises(CortexError, match=what):
        make_cortex(*arguments)


def test_saved_and_read_back(tmp_path):
    path, right = tmp_path / "subject.npz", subject(1, "right")
    save_cortex(path, right)
    back = load_cortex(path)
    assert (back.seed, back.hemisphere, back.generation) == (1, "right", GENERATION)
    assert (back.interrupted, back.branched) == (right.interrupted, right.branched)
    assert np.array_equal(back.template, right.template)
    for surface in (back.surface, read_surface(path)):
        assert np.array_equal(surface.vertices, right.surface.vertices)
        assert set(surface.curves) == set(SULCI)
    first = path.read_bytes()
    save_cortex(path, right)
    assert path.read_bytes() == first and [file.name for file in tmp_path.iterdir()] == ["subject.npz"]


def test_unreadable_files(tmp_path):
    path = tmp_path / "subject.npz"
    with pytest.raises(CortexError, match="does not exist"):
        load_cortex(path)
    save_cortex(path, subject())
    whole = path.read_bytes()
    with np.load(path) as file:
        arrays = dict(file)
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(CortexError, match="no readable npz"):
        load_cortex(path)
    for lost in (["interrupted"], ["generation"], ["template", "seed", "hemisphere"]):
        np.savez(path, **{name: array for name, array in arrays.items() if name not in lost})
        with pytest.raises(CortexError, match=f"lacks {', '.join(lost)}"):
            load_cortex(path)
    with pytest.raises(SurfaceError, match="cannot be written"):
        save_cortex(path / "subject.npz", subject())


@pytest.mark.parametrize("kind", [Diffeomorphism, AreaKeeping])
def test_the_deformation_is_a_diffeomorphism_that_leaves_the_wall(kind):
    deform = kind(np.random.default_rng(5), 0.15, 0.6)
    points = fibonacci_sphere(3000)
    moved = deform(points)
    assert np.abs(deform(moved, inverse=True) - points).max() < 1e-4
    inside = wall_level(points) < 1.05
    assert inside.any() and np.allclose(moved[inside], points[inside], rtol=0, atol=1e-12)
    assert 0.05 < np.sqrt(((moved - points) ** 2).sum(axis=1).mean()) < 0.2

    mesh = sphere()
    assert (np.linalg.det(deform(unit(mesh.vertices))[mesh.faces]) > 0).all()


@pytest.mark.parametrize("kind, keeps", [(Diffeomorphism, False), (AreaKeeping, True)])
def test_one_kind_of_deformation_keeps_areas_on_the_hull(kind, keeps):
    deform, points = kind(np.random.default_rng(5), 0.11, 0.6), fibonacci_sphere(1000)
    points = points[wall_level(points) > 1]

    def area(map_):
        return np.linalg.norm(area_vectors(lambda u: hull_radius(map_(u))[:, None] * map_(u), points), axis=1)

    assert (np.quantile(abs(np.log2(area(deform) / area(unit))), 0.95) < 1e-3) == keeps


def test_the_hull_is_flat_on_the_medial_side():
    y, z = np.meshgrid(np.linspace(-0.5, 0.5, 9), np.linspace(-0.2, 0.2, 5))
    target = np.column_stack([np.zeros(45), y.ravel(), z.ravel()])
    direction = unit(target - CENTRE)
    assert np.abs((CENTRE + hull_radius(direction)[:, None] * direction)[:, 0]).max() < 0.03


def test_distance_below_a_round_hull():
    field = hull_distance(lambda u: np.full(len(u), 0.7))
    radius = np.linspace(0.5, 0.75, 11)
    points = CENTRE + radius[:, None] * unit(np.random.default_rng(0).normal(size=(11, 3)))
    assert np.allclose(depth_below(points, *field), 0.7 - radius, atol=2e-3)


def _grow_sphere(growth, steps=300):
    mesh = sphere()
    rest = CENTRE + 0.5 * mesh.vertices
    start, index = neighbour_table(mesh.faces, len(rest))
    owner = np.repeat(np.arange(len(rest)), np.diff(start))
    length = np.linalg.norm(rest[owner] - rest[index], axis=1)
    settings = np.array([steps, 0.2, 0.25, 0.0, 0.2, 0.005, 0.3, 0.5 * length.mean(), 3.0, 10, 1.0, 0.4, 0.0])
    field = hull_distance(lambda u: np.full(len(u), 0.5))
    clock = np.zeros(2, dtype=np.int64)
    lengths, held, still = np.full(len(index), growth), np.zeros(len(rest), bool), np.zeros(len(rest))
    mechanics = (length, held, lengths, np.full(len(rest), 0.01), still, still)
    record = clock, np.empty((0, *rest.shape))
    x = grow(rest.copy(), rest, mesh.vertices, start, index, *mechanics, *field, settings, record)
    assert (clock == [steps - 1, steps]).all()
    return rest, x, depth_below(x, *field)


def test_growth_buckles_the_shell_inward_below_its_hull_and_nothing_else_does():
    rest, x, _ = _grow_sphere(1.0)
    assert np.abs(x - rest).max() < 5e-3
    rest, x, depth = _grow_sphere(1.5)
    area = [Surface(points, sphere().faces).area for points in (rest, x)]
    assert area[1] > 1.4 * area[0]
    assert depth.max() > 0.08 and depth.min() > -0.06


def test_untangling_draws_a_piercing_vertex_back():
    mesh = sphere()
    x = mesh.vertices.copy()
    x[0] *= -1.4  # through the far side
    start, index = neighbour_table(mesh.faces, len(x))
    assert len(self_intersections(x, mesh.faces)) > 0
    free = untangle(x, mesh.faces, start, index, np.zeros(len(x), bool))
    assert len(self_intersections(free, mesh.faces)) == 0
    assert (free == x).all(axis=1).mean() > 0.5


def test_the_mesh_is_even_and_nearly_delaunay():
    cortex = subject()
    rest = unfolded(cortex, cortex.template)
    faces = cortex.surface.faces
    length = np.linalg.norm(rest[cortex.surface.edges[:, 0]] - rest[cortex.surface.edges[:, 1]], axis=1)
    assert length.std() < 0.3 * length.mean()
    corner = rest[faces]
    ahead, behind = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    cosine = (ahead * behind).sum(2) / np.linalg.norm(ahead, axis=2) / np.linalg.norm(behind, axis=2)
    angle = np.arccos(cosine)
    f, i, g, j = interior_edges(faces)
    assert (angle[f, i] + angle[g, j] > np.pi + 1e-3).mean() < 0.005


def test_compilation_does_without_a_cache_folder(monkeypatch):
    def no_folder(cache=False, nogil=False):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return numba.njit(nogil=nogil)

    monkeypatch.setattr("data_synth.compiled.njit", no_folder)
    assert compiled(lambda x: 2 * x)(21) == 42
