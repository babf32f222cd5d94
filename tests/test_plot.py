"""Figures: what is drawn is what was computed; nothing global is left behind."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from meshes import bowl
from qcbook.figures import ellipse_field, grid_plot, square_lines
from qcbook.scenes import registration_scene, stacked_scene, surface_picture, surface_scene
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk, square_disk
from qclearn.plane.mobius import mobius
from qclearn.plot import CURVE_STYLES, disk_plot, drawn_part, mu_histogram, polar_lines, registration_figure
from qclearn.registration.register import register
from qclearn.surfaces.surface import Surface


@pytest.fixture
def ax():
    return Figure().subplots()


@pytest.fixture(scope="module")
def registered():
    moving, control = bowl(0.5), bowl(0.7)
    path = [1 + 24 * ring for ring in range(6)]
    turned = [vertex + 1 for vertex in path]
    curves = [
        {"name": "spoke", "moving": path, "control": turned},
        {"name": "ring", "moving": list(range(80, 88)), "control": list(range(82, 90))},
    ]
    return register(moving, control, curves, gamma=1e3, features=None), moving, control


def longest_direction(mu):
    """Direction, length and width of the image of the unit circle under dz + mu conj(dz), by brute force."""
    turn = np.exp(1j * np.linspace(0, np.pi, 100_001))
    image = turn + mu * turn.conj()
    k = abs(image).argmax()
    return np.angle(image[k]) % np.pi, abs(image[k]), abs(image).min()


@pytest.mark.parametrize("mu", [0.5, 0.5j, -0.3, 0.4 - 0.3j])
def test_ellipses_point_where_the_map_stretches_most(ax, mu):
    ellipse = ellipse_field(ax, [0.1 + 0.2j], [mu], size=0.2)
    direction, longest, shortest = longest_direction(mu)
    difference = np.radians(ellipse.get_angles()[0]) - direction
    assert abs(np.sin(difference)) < 1e-4
    assert ellipse.get_widths()[0] == pytest.approx(0.2)
    assert ellipse.get_heights()[0] / ellipse.get_widths()[0] == pytest.approx(shortest / longest, rel=1e-6)


@pytest.mark.parametrize("labels", [np.arange(193) % 3 * 10, np.arange(193) % 2 > 0])
def test_labels_in_a_figure_are_not_blended(ax, labels):
    artist = disk_plot(ax, *polar_disk(8, 24), labels)
    assert len(artist.get_array()) == len(polar_disk(8, 24)[1])
    assert set(artist.get_array().tolist()) <= set(labels.tolist())


@pytest.mark.parametrize("lines", [polar_lines(4, 6, 31), square_lines(5, 31)])
def test_grid_lines_are_carried_by_the_map(ax, lines):
    z, faces = square_disk(8)
    segments = grid_plot(ax, z, faces, 1j * z, lines).get_segments()
    assert len(segments) == len(lines)
    inner = abs(np.concatenate(lines)) < 0.95  # beyond the boundary polygon points move onto it
    drawn = np.concatenate(segments) @ [1, 1j]
    np.testing.assert_allclose(drawn[inner], 1j * np.concatenate(lines)[inner], atol=1e-12)


def test_histogram_holds_shares_and_the_mean(ax):
    mu = np.array([0.1, 0.1j, -0.5, 0.3])
    mu_histogram(ax, mu, weights=np.array([1, 1, 2, 0]), bins=10)
    heights = [patch.get_height() for patch in ax.patches]
    assert sum(heights) == pytest.approx(1)
    assert heights[5] == pytest.approx(0.5)
    assert ax.lines[0].get_xdata()[0] == pytest.approx((0.1 + 0.1 + 2 * 0.5) / 4)
    mu_histogram(other := Figure().subplots(), np.array([0.2, 1.7]), bins=10)  # coefficients above one, too
    assert sum(patch.get_height() for patch in other.patches) == pytest.approx(1)


@pytest.mark.parametrize("per", ["vertex", "face"])
def test_disk_plot_colours_vertices_or_faces(ax, per):
    z, faces = square_disk(4)
    values = z.real if per == "vertex" else z[faces].mean(1).real
    np.testing.assert_array_equal(disk_plot(ax, z, faces, values).get_array(), values)


def test_registration_figure_draws_before_and_after(registered, tmp_path):
    registration, moving, control = registered
    figure = registration_figure(registration, moving, control)
    figure.savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 50_000
    assert "matplotlib.pyplot" not in vars(matplotlib) or not matplotlib.pyplot.get_fignums()

    def drawn(ax, style):
        lines = [line for line in ax.lines if line.get_color() == CURVE_STYLES[style]["color"]]
        return [line.get_xydata() @ [1, 1j] for line in lines if line.get_linestyle() != "None"]

    first, second = figure.axes[0], figure.axes[1]
    (spoke, _), (spoke_after, _) = drawn(first, "detected"), drawn(second, "registered")
    np.testing.assert_array_equal(spoke, registration.curves["spoke"][0])
    path = [1 + 24 * k for k in range(6)]  # on vertices the map is known exactly
    np.testing.assert_allclose(spoke_after, registration.disk_map[path], atol=1e-9)
    targets = drawn(second, "target")
    np.testing.assert_array_equal(targets[1], registration.curves["ring"][1])
    assert abs(spoke_after - targets[0]).mean() < 0.5 * abs(mobius(spoke) - targets[0]).mean()


def test_of_a_large_surface_means_over_fewer_vertices_are_drawn():
    z, faces = polar_disk(130, 200)
    some, triangles, means = drawn_part(Disk(z, faces), Surface(np.stack([z.real, z.imag, 0 * z.real], 1), faces))
    assert 25_000 <= len(some) < len(z) == 26_001 and not len(Disk(z[some], triangles).maybe_flipped)
    np.testing.assert_allclose(means.sum(1), 1)
    np.testing.assert_allclose(means @ z, z[some], atol=0.03)


def test_registration_figure_without_curves_shows_the_control_beside(registered):
    registration, moving, control = registered
    registration = replace(registration, curves={}, report=registration.report | {"curves": {}})
    first, second = registration_figure(registration, moving, control).axes[:2]
    for ax, disk in ((first, registration.disk_control), (second, registration.disk_map)):
        corners = np.concatenate([path.vertices for path in ax.collections[0].get_paths()]) @ [1, 1j]
        np.testing.assert_array_equal(np.unique(corners), np.unique(disk))
        assert ax.get_legend() is None and not ax.lines
    assert "control" in first.get_title() and "moving" in second.get_title()


def test_scene_holds_only_what_is_seen_in_float32_with_tubes_above_the_surface():
    pyvista = pytest.importorskip("pyvista")
    flat, curve = bowl(0.0), np.array([0, 1, 25, 49])
    plotter = surface_scene(flat, flat.vertices[:, 0], [(curve, "detected"), (flat.vertices[curve], "target")])
    surface, *tubes = [actor.mapper.dataset for actor in plotter.actors.values() if isinstance(actor, pyvista.Actor)]
    assert len(tubes) == 2 and all(mesh.points.dtype == np.float32 for mesh in (surface, *tubes))
    np.testing.assert_array_equal(surface.point_data["values"], flat.vertices[:, 0].astype(np.float32))
    assert set(surface.array_names) <= {"values", "Normals"}
    np.testing.assert_allclose(tubes[0].center, tubes[1].center)
    radius = 0.006 * np.linalg.norm(np.ptp(flat.vertices, axis=0))
    assert all(tube.bounds[4] < 0 < 1.4 * radius < tube.bounds[5] < 1.7 * radius for tube in tubes)
    plotter.close()


def test_stacked_surfaces_stand_one_below_the_other_for_one_camera():
    above, below = bowl(0.5), Surface(3 + 2 * bowl(0.7).vertices, bowl(0.7).faces)
    plotter = stacked_scene([above, below], [above.vertices[:, 2], below.vertices[:, 2]])
    first, second = [actor.mapper.dataset for actor in plotter.actors.values() if hasattr(actor, "mapper")]
    assert second.bounds[5] < first.bounds[4]
    np.testing.assert_allclose(second.points.mean(0)[:2], first.points.mean(0)[:2], atol=1e-5)
    np.testing.assert_allclose(np.ptp(second.points, axis=0), np.ptp(below.vertices, axis=0), rtol=1e-5)
    assert plotter.camera.parallel_projection and abs(plotter.camera.direction[2]) < 1e-6
    plotter.close()


@pytest.mark.parametrize("height", [4.0, 8.0])
def test_a_picture_is_to_scale_and_not_dark(height):
    pixels = surface_picture(bowl(0.5), direction=(0, 0, 1), up=(0, 1, 0), height=height)
    seen = np.flatnonzero((pixels < 250).any(axis=(1, 2)))
    assert abs((seen[-1] - seen[0] + 1) / len(pixels) - 2 / height) < 0.02
    assert 120 < np.median(pixels[pixels < 250]) < 245


def test_the_scene_of_a_registration_has_its_curves_on_their_targets(registered):
    registration, _, control = registered
    plotter = registration_scene(registration, control)
    meshes = [actor.mapper.dataset for actor in plotter.actors.values() if hasattr(actor, "mapper")]
    targets, curves = meshes[1:3], meshes[3:5]
    for curve, target in zip(curves, targets):
        assert np.linalg.norm(curve.center_of_mass() - target.center_of_mass()) < 0.05
    plotter.close()
