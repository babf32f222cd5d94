"""LD-Net: its pictures, its loss and symmetries, what its curves keep by construction, and bad input."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from test_networks import batch, network

from data_synth.datasets import CurveDataset
from known_surfaces import sphere
from qclearn.nets import load
from qclearn.nets.ldnet import PRESETS, contrast, heat_metric, refine, smoothed, some, whole
from qclearn.nets.pictures import stamp, turn
from qclearn.plane.disk import Disk
from qclearn.plane.grids import pixel_centres
from qclearn.registration.curves import curve_distance, curves_in_space, detect_curves, weigh_edges
from qclearn.registration.problem import LandmarkError
from qclearn.surfaces.conformal import ParameterizedSurface, disk_conformal_map, parameterize
from qclearn.surfaces.curvature import area_radius, sulcal_depth
from qclearn.surfaces.surface import SurfaceError
from subjects import grown

pytestmark = [
    pytest.mark.filterwarnings("ignore::qclearn.plane.bijectivity.RepairWarning"),
    pytest.mark.usefixtures("one_thread"),
]


@pytest.fixture(scope="module")
def cortex():
    return grown(1, 1000)


@pytest.fixture(scope="module")
def subject(cortex):
    ends = np.array([path[[0, -1]] for path in cortex.curves.values()])
    return cortex.surface, disk_conformal_map(cortex.surface), ends


def test_a_stamp_is_the_bell_around_its_nearest_point():
    points = torch.tensor([[0.31 + 0.2j, -0.5 - 0.11j, 0.33 + 0.25j, 0.9 + 0.9j]])
    shown = torch.tensor([[True, True, True, False]])
    image = stamp(points, shown, 32, 1.5)[0].numpy()
    distance = abs(pixel_centres(32)[..., None] - points[0, :3].numpy()).min(-1) * 16
    np.testing.assert_allclose(image, np.exp(-(distance**2) / (2 * 1.5**2)) * (distance < 4), atol=0.03)


def test_symmetries_move_points_with_their_pixels():
    """A turned image of stamped points is the image of the turned points."""
    generator, shown = torch.Generator().manual_seed(0), torch.ones(64, 5, dtype=torch.bool)
    points = torch.complex(*(torch.rand(2, 64, 5, generator=generator) * 1.6 - 0.8))
    turned, moved = turn(stamp(points, shown, 32, 1.0)[:, None], points, generator)
    torch.testing.assert_close(turned[:, 0], stamp(moved, shown, 32, 1.0))
    ratios = moved / points, moved / points.conj()
    constant = [abs(ratio - ratio.mean(1, keepdim=True)).amax(1) < 1e-3 for ratio in ratios]
    assert (constant[0] ^ constant[1]).all() and 16 < constant[0].sum() < 48  # turns and reflections
    turns = ratios[0][constant[0]].mean(1)
    assert len(set(np.round(turns.numpy(), 3))) == 4


def test_some_curves_and_parts_of_curves_are_shown():
    curves = torch.zeros(200, 8, 37, dtype=torch.complex64)
    first, last, shown = some(curves, torch.Generator().manual_seed(0))
    assert (first >= 0).all() and (last <= 36).all() and (last - first >= 9).all()
    assert shown.any(1).all() and 0.2 < shown.all(1).float().mean() < 0.5
    assert 0.1 < ((first > 0) | (last < 36)).float().mean() < 0.3
    first, last, shown = whole(curves)
    assert (first == 0).all() and (last == 36).all() and shown.all()


def test_contrast_keeps_black_white_and_the_order_of_greys():
    grey = torch.linspace(0, 255, 32).expand(50, 1, 32, 32)
    changed = contrast(grey, torch.Generator().manual_seed(0))
    assert changed.min() >= 0 and changed.max() <= 255 and (changed[..., 1:-1].diff(dim=-1) > 0).all()
    assert changed[:, 0, 16, 16].std() > 10


def test_points_between_lie_on_the_polyline():
    curves = torch.tensor([[[0, 1, 1 + 2j]]])
    points, place = refine(curves, 2)
    assert points[0, 0].tolist() == [0, 0.5, 1, 1 + 1j, 1 + 2j] and place.tolist() == [0, 0.5, 1, 1.5, 2]


def test_the_printed_loss_is_a_sum_of_squares():
    model, (images, ends, curves) = network("ldnet-paper"), batch("ldnet-paper")
    by_hand = (abs(model(images, ends) - curves[:, :, ::4]) ** 2).sum() / len(images)
    assert model.loss((images, ends, curves), None)[0].item() == pytest.approx(by_hand.item(), rel=1e-5)


def test_curves_join_their_endpoints_along_edges(subject):
    surface, z, ends = subject
    curves, again = (network("ldnet-best").detect(surface, z, ends) for _ in range(2))
    vertex = {point: k for k, point in enumerate(z)}
    edges = {frozenset(edge) for edge in surface.edges.tolist()}
    assert len(curves) == len(ends)
    for curve, pair in zip(curves, ends):
        path = [vertex[point] for point in curve]
        assert [path[0], path[-1]] == pair.tolist()
        assert all(frozenset(pair) in edges for pair in pairwise(path))
    assert all(np.array_equal(a, b) for a, b in zip(curves, again))


def test_a_path_follows_the_heat_and_the_fundus(subject):
    """Cheap where the network is sure, and cheaper where the surface is concave."""
    surface, zero = subject[0], np.zeros(len(subject[1]))
    plain, warm = (heat_metric(surface, zero + heat, zero) for heat in (0, 0.5))
    np.testing.assert_allclose(warm / plain, 0.8 / 1.3)
    depth = sulcal_depth(surface)[surface.edges].mean(1)
    assert np.corrcoef(depth, plain / weigh_edges(surface, 1 + zero))[0, 1] < -0.9
    H = np.random.default_rng(0).normal(size=len(zero))
    both, ratio = smoothed(surface, H)[surface.edges].mean(1), heat_metric(surface, zero, H) / plain
    assert np.corrcoef(both, ratio)[0, 1] > 0.9


def test_smoothing_keeps_constants_and_is_the_umbrellas(subject):
    surface, z, _ = subject
    np.testing.assert_allclose(smoothed(surface, np.full(len(z), 3.0)), 3)
    vertex = surface.edges[0, 0]
    around = np.setdiff1d(surface.edges[(surface.edges == vertex).any(1)], vertex)
    assert smoothed(surface, z.real, 1)[vertex] == pytest.approx((z.real[vertex] + z.real[around].mean()) / 2)


def test_the_papers_curves_are_as_many_as_it_was_trained_on_keep_the_endpoints_and_stay_in_the_disk(subject):
    surface, z, ends = subject
    curves = network("ldnet-paper").detect(surface, z, ends)
    assert [len(curve) for curve in curves] == [10] * 8
    assert all(curve[0] == z[a] and curve[-1] == z[b] for curve, (a, b) in zip(curves, ends))
    assert all((abs(curve) <= 1 + 1e-9).all() for curve in curves)
    with pytest.raises(LandmarkError, match="3 pairs of endpoints; .* trained on 8 curves"):
        network("ldnet-paper").detect(surface, z, ends[:3])


def test_the_papers_network_sees_the_picture_it_was_trained_on(subject, cortex):
    surface, _, ends = subject
    dataset = CurveDataset(1, 2, [cortex], size=32, max_abs=(0.0, 0.0))
    image, points, _ = dataset[0]
    model, seen = network("ldnet-paper"), []
    model.register_forward_pre_hook(lambda module, inputs: seen.append(inputs))
    turned = dataset.subjects[0][2].solve(np.zeros(len(surface.faces)))
    turned = turned * (points[0, 0].numpy() / area_radius(surface, turned).to_image(turned[ends[0, 0]]))
    turned /= abs(turned).max()
    model.detect(surface, turned, ends)
    torch.testing.assert_close(seen[0][0][0], image, atol=0.2, rtol=0)
    torch.testing.assert_close(seen[0][1][0], points, atol=1e-4, rtol=0)


BAD = [
    (lambda s, z, e: (s, z, [[0, 0]]), LandmarkError, "repeats vertex 0"),
    (lambda s, z, e: (s, z, [[0, len(z)]]), LandmarkError, "out of range"),
    (lambda s, z, e: (s, z, [0, 5]), LandmarkError, r"shape \(2,\); give \(K, 2\)"),
    (lambda s, z, e: (s, z, np.zeros((0, 2), int)), LandmarkError, "at least one curve"),
    (lambda s, z, e: (s, z, e + 0.5), LandmarkError, "vertex indices"),
    (lambda s, z, e: (s, z[:-1], e), SurfaceError, "give the disk map of this surface"),
    (lambda s, z, e: (s, np.where(np.arange(len(z)) == 3, np.nan, z), e), SurfaceError, "1 of its numbers not finite"),
    (lambda s, z, e: (sphere(), np.zeros(len(sphere().vertices)), e), SurfaceError, "closed|boundary"),
]


@pytest.mark.parametrize("name", ["ldnet-best", "ldnet-paper"])
@pytest.mark.parametrize("change, error, message", BAD)
def test_bad_input_is_named(subject, name, change, error, message):
    with pytest.raises(error, match=message):
        network(name).detect(*change(*subject))


def test_presets_are_of_their_size():
    for preset, (kind, config) in PRESETS.items():
        model = kind(config)
        assert config.preset == preset and model.config == config
        assert 4 * sum(parameter.numel() for parameter in model.parameters()) < 5e6
        assert kind(replace(config, size=64)).config.size == 64


def test_the_shipped_weights_find_sulci():
    """On subjects of no training set, if coarser than those: a mean distance below 2 mm, and below the others'."""
    detectors, found = (load("ldnet").detect, load("ldnet", "paper").detect, detect_curves), []
    for cortex in (grown(1, 2500), grown(2, 2500)):
        side = parameterize(cortex.surface)
        surface, z = side.surface, side.disk.z
        ends = np.array([path[[0, -1]] for path in cortex.curves.values()])
        truth = curves_in_space(side, [z[path] for path in cortex.curves.values()])
        for detect in detectors:
            curves = curves_in_space(side, detect(surface, z, ends))
            found.append(np.mean(list(map(curve_distance, truth, curves))))
    best, paper, twin = np.reshape(found, (2, 3)).mean(0)
    assert best < 2 and best < twin and best < paper < 6


def test_distance_between_curves(subject):
    surface, z, _ = subject
    path = next(iter(surface.curves.values()))
    side = ParameterizedSurface(surface, Disk(z, surface.faces))
    curve, back = curves_in_space(side, [z[path], z[path[::-1]]])
    np.testing.assert_allclose(curve[[0, -1]], surface.vertices[path[[0, -1]]], atol=1e-6)
    step = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    assert step.max() < 1.2 * np.median(step)
    length = np.linalg.norm(np.diff(surface.vertices[path], axis=0), axis=1).sum()
    assert step.sum() == pytest.approx(length, rel=0.02) and curve_distance(curve, back) < 0.2 * step.max()
    line = np.linspace([0, 0, 0], [50.0, 0, 0], 400)
    assert curve_distance(line, line + [0, 0, 3.0]) == pytest.approx(3)
    assert curve_distance(line, line[:200]) == pytest.approx(50 / 16, rel=0.02)  # half of it by 25/2 on average
