"""Mean curvature, sulcal depth and curvature images against closed forms."""

import warnings

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from known_surfaces import icosphere, revolution, sheet
from qcbook.figures import area_under_pixels, resolved_share
from qclearn.io.fsaverage import fsaverage5
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.grids import pixel_centres, polar_disk
from qclearn.surfaces.conformal import disk_conformal_map
from qclearn.surfaces.curvature import (
    POTENTIAL,
    AreaRadius,
    area_radius,
    curvature_image,
    curvature_potential,
    grey_levels,
    grow,
    mean_curvature,
    sulcal_depth,
)
from qclearn.surfaces.surface import Surface, SurfaceError

PLAIN = AreaRadius(np.array([0.0, 1.0]), np.array([0.0, 1.0]))  # the disk as it is


def test_sphere_is_exact():
    ball = icosphere(3)
    vertices, faces = ball.vertices, ball.faces
    for r in (0.01, 70.0):
        np.testing.assert_allclose(mean_curvature(Surface(r * vertices + 5, faces)), 1 / r, rtol=1e-9)
    np.testing.assert_allclose(mean_curvature(Surface(2 * vertices, faces[:, ::-1])), -0.5, rtol=1e-9)


@pytest.mark.parametrize("unit", [1e-3, 70.0])
def test_the_potential_of_a_harmonic_is_damped_as_its_eigenvalue_says(unit):
    """`u = L H` on a sphere, and `H L / (1 + L^2 l (l + 1))` where H is a harmonic of degree l."""
    ball = icosphere(4)
    harmonic = np.polynomial.legendre.Legendre.basis(4)(ball.vertices[:, 2])[:, None]
    for bump, degree in ((0.0, 0), (1e-3, 4)):
        surface = Surface(unit * ball.vertices * (1 + bump * harmonic), ball.faces)
        length, areas = POTENTIAL * np.sqrt(surface.area), surface.vertex_areas / surface.area
        off = mean_curvature(surface) - 1 / unit
        expected = length * (1 / unit + off / (1 + (length / unit) ** 2 * degree * (degree + 1)))
        found = curvature_potential(surface)
        assert np.sqrt(areas @ (found - expected) ** 2) <= 0.03 * length * np.sqrt(areas @ off**2) + 1e-9


def test_ellipsoid_converges_on_average():
    # at vertices of valence other than 6 the error need not vanish (Xu 2004), so the mean error has the rate
    axes = np.array([1.0, 1.3, 0.8])
    errors = []
    for level in (2, 3, 4):
        ball = icosphere(level)
        surface = Surface(ball.vertices * axes, ball.faces)
        x = surface.vertices
        normal_length = np.sqrt((x**2 / axes**4).sum(1))
        exact = ((axes**2).sum() - (x**2).sum(1)) / (2 * axes.prod() ** 2 * normal_length**3)
        error = mean_curvature(surface) - exact
        errors.append((surface.vertex_areas * abs(error)).sum() / surface.area)
    assert np.log2(errors[0] / errors[1]) > 1.7 and np.log2(errors[1] / errors[2]) > 1.8
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("a, b", [(1.0, 0.3), (0.3, 1.0), (-0.5, 0.5)])
def test_saddle_has_the_sign_of_its_stronger_bend(a, b):
    surface, x, y = sheet(41, 2.0, lambda x, y: (a * (x - 1) ** 2 - b * (y - 1) ** 2) / 2)  # k = -a and b from above
    centre = np.hypot(x - 1, y - 1).argmin()
    assert mean_curvature(surface)[centre] == pytest.approx((b - a) / 2, rel=0.01)
    turned = Surface(surface.vertices, surface.faces[:, ::-1])
    np.testing.assert_allclose(mean_curvature(turned), -mean_curvature(surface))


def test_curvature_survives_the_rim_and_slivers():
    cap = icosphere(3, 0.2)
    vertices, faces = cap.vertices, cap.faces
    np.testing.assert_allclose(mean_curvature(cap), 1, rtol=1e-9)
    # split every tenth face from a point that almost lies on one of its edges
    split = faces[::10]
    a, b, c = split.T
    new = len(vertices) + np.arange(len(split))
    points = np.concatenate([vertices, np.tensordot([0.5 - 1e-9, 0.5 - 1e-9, 2e-9], vertices[split], (0, 1))])
    parts = [np.stack(corners, 1) for corners in ((a, b, new), (b, c, new), (c, a, new))]
    curvature = mean_curvature(Surface(points, np.concatenate([np.delete(faces, np.s_[::10], 0), *parts])))
    assert curvature.min() > -1e-3 and curvature.max() < 4 and np.median(curvature) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("measure, surface, message", [
    (mean_curvature, Surface(np.eye(3), [[0, 1, 2]]), "boundary"), (sulcal_depth, sheet(5)[0], "plane"),
])  # fmt: skip
def test_surfaces_without_an_inside_are_refused(measure, surface, message):
    with pytest.raises(SurfaceError, match=message):
        measure(surface)


def arc(radius, start, end, count):
    """Points of a profile for `revolution`, by polar angle from the top."""
    angle = np.linspace(start, end, count)
    return radius * (np.sin(angle) + 1j * np.cos(angle))


def test_depth_of_a_dent_in_a_sphere():
    mouth, depth, opening = 0.12, 0.3, 2.9
    angle = np.concatenate([np.linspace(0, mouth, 13), np.linspace(mouth, opening, 90)[1:]])
    radius = np.where(angle < mouth, 1 - depth * np.clip(2 - 2 * angle / mouth, 0, 1), 1.0)
    surface = revolution(radius * (np.sin(angle) + 1j * np.cos(angle)))
    # the convex hull is a spherical zone with a flat lid; the closing ball rests on the rim of the dent
    scale = np.sqrt(2 * np.pi * (1 - np.cos(opening)) + np.pi * np.sin(opening) ** 2)
    ball, voxel = 0.05 * scale, scale / 130
    ball_centre = np.cos(mouth) + np.sqrt(ball**2 - np.sin(mouth) ** 2)
    floor = np.flatnonzero(np.repeat(angle, np.r_[1, np.full(len(angle) - 1, 96)]) < mouth / 2 + 1e-9)
    exact = np.linalg.norm(surface.vertices[floor] - [0, 0, ball_centre], axis=1) - ball
    measured = sulcal_depth(surface)
    np.testing.assert_allclose(measured[floor], exact, atol=voxel)
    outside = np.linalg.norm(surface.vertices, axis=1) > 1 - 1e-9
    assert measured.min() >= 0 and measured[outside].max() < 0.5 * voxel
    turned = Surface(10 * surface.vertices, surface.faces[:, ::-1])
    np.testing.assert_allclose(sulcal_depth(turned), 10 * measured, atol=1e-6)


def test_a_chamber_behind_a_closed_mouth_is_deep():
    chamber, neck = (0.5, 0.08)  # wider than the ball: without filling, its middle would count as outside
    inner, outer = np.arcsin(neck / chamber), np.arcsin(neck)
    tube = neck + 1j * np.linspace(chamber * np.cos(inner), np.cos(outer), 12)
    surface = revolution(np.concatenate([arc(chamber, np.pi, inner, 40), tube[1:-1], arc(1, outer, 2.9, 80)]))
    wall = abs(np.linalg.norm(surface.vertices, axis=1) - chamber) < 1e-9
    wall &= abs(surface.vertices[:, 2]) < 0.3  # away from the neck and the flat lid
    np.testing.assert_allclose(sulcal_depth(surface)[wall], 1 - chamber, atol=0.03)


@pytest.mark.parametrize("radius", [0.9, 1.5, 6.5, 11])
def test_a_grown_body_is_what_lies_within_the_radius(radius):
    body = np.random.default_rng(1).random((9, 31, 40)) < 2e-4 * (13 - radius)
    near = distance_transform_edt(~body) <= radius
    assert body.any() and not near.all()
    np.testing.assert_array_equal(grow(body, radius), near)


@pytest.fixture(scope="module")
def crowded():
    """A flat disk w and a disk map z = w |w| that crowds its area to the centre: the equal-area radius is sqrt(|z|)."""
    w, faces = polar_disk(48, 128)
    return Surface(np.stack([w.real, w.imag, 0 * w.real], 1), faces), w, w * abs(w)


def test_equal_area_radius_undoes_the_crowding(crowded):
    surface, w, z = crowded
    radius = area_radius(surface, z)
    np.testing.assert_allclose(radius.to_image(z), w, atol=0.01)
    np.testing.assert_allclose(radius.from_image(radius.to_image(z)), z, atol=1e-14)
    assert radius.to_image(0) == 0 and abs(radius.to_image(1j) - 1j) < 1e-15
    assert (np.diff(radius.disk) > 0).all() and (np.diff(radius.image) > 0).all()


def test_image_has_its_axes_right(crowded):
    surface, w, z = crowded
    centres = pixel_centres(32)
    assert centres[0, 0] == (-1 - 1j) * 31 / 32 and centres[0, 1].real > centres[0, 0].real
    for part in (np.real, np.imag):
        image, _radius = curvature_image(surface, z, 32, values=part(w))
        assert (np.isnan(image) == (abs(centres) > 1)).all()
        inside = ~np.isnan(image)
        np.testing.assert_allclose(image[inside], part(centres)[inside], atol=0.015)


def test_area_under_pixels(crowded):
    surface, _w, z = crowded
    areas = area_under_pixels(surface, z, area_radius(surface, z), 16)
    assert areas.sum() == pytest.approx(surface.area, rel=1e-12)
    inside = abs(pixel_centres(16)) < 1 - 2 / 16
    np.testing.assert_allclose(areas[inside], (2 / 16) ** 2, rtol=0.1)
    crowd = area_under_pixels(surface, z, PLAIN, 16)
    # density of area in z is 1/(2|z|): a pixel of side 1/8 carries less than 1/64 where |z| > 1/2, half of it
    assert resolved_share(areas, 1.2 / 64) > 0.99
    assert resolved_share(crowd, 1 / 64) == pytest.approx(0.5, abs=0.05)


def test_pixels_count_where_they_lie(crowded):
    surface, w, _ = crowded
    areas = area_under_pixels(surface, 0.3 * w + 0.5j, PLAIN, 32)  # a disk in the upper half, y from 0.2 to 0.8
    row, column = np.nonzero(areas)
    assert (2 * row.min() / 32 - 1, 2 * (row.max() + 1) / 32 - 1) == pytest.approx((0.2, 0.8), abs=0.07)
    assert row.mean() > 20 and column.mean() == pytest.approx(15.5, abs=0.01)


@pytest.mark.parametrize("hemisphere, wall", [("left", "cortex"), ("right", "thickness")])
def test_equal_area_radius_resolves_real_cortex(hemisphere, wall):
    surface = fsaverage5(hemisphere, wall=wall)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)  # the map is another test's matter
        z = disk_conformal_map(surface)
    radius = area_radius(surface, z)
    assert resolved_share(area_under_pixels(surface, z, radius, 128)) > 0.95
    assert resolved_share(area_under_pixels(surface, z, radius, 256)) > 0.99
    if wall == "thickness":  # the narrower the cut, the more is crowded in the middle of the disk
        assert resolved_share(area_under_pixels(surface, z, PLAIN, 128)) < 0.6
    curvature, depth = mean_curvature(surface), sulcal_depth(surface)
    assert np.corrcoef(curvature, depth)[0, 1] < -0.4 and 0.1 < (depth == 0).mean() < 0.5


def test_grey_levels_clip_two_per_cent_of_the_area():
    values = np.linspace(-3, 7, 1001)
    grey = grey_levels(values, np.ones(1001))
    assert grey.min() == 0 and grey.max() == 255
    assert [np.mean(grey == 0), np.mean(grey == 255)] == pytest.approx([0.02, 0.02], abs=0.002)
    assert grey[500] == pytest.approx(127.5)
    areas = np.where(values < 2, 3.0, 1.0)  # tails are shares of area, not of vertices
    assert np.mean(grey_levels(values, areas) == 255) == pytest.approx(0.04, abs=0.003)
    assert (grey_levels(np.ones(5), np.ones(5)) == 127.5).all()


def test_sulci_are_dark_and_gyri_bright():
    z, faces = polar_disk(40, 96)
    waves = Surface(np.stack([z.real, z.imag, 0.1 * np.cos(3 * np.pi * abs(z))], 1), faces)
    image, radius = curvature_image(waves, z, 64)
    r = abs(radius.from_image(pixel_centres(64)))
    crown, fundus = r < 0.08, abs(r - 1 / 3) < 0.03
    assert image[crown].min() > 200 and image[fundus].max() < 60
