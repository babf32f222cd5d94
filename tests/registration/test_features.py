"""Features: smoothed and compared as said, and every map that cannot be one refused by name."""

import numpy as np
import pytest
from scipy.special import j0, jn_zeros

from known_surfaces import grooved_sphere
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.registration.features import FOLDS, HEMISPHERE, Feature, FeatureError, Smoothing, check_features, featured
from qclearn.registration.residuals import FeatureTerm, Places
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.curvature import curvature_potential, mean_curvature, sulcal_depth
from qclearn.surfaces.surface import Surface

Z, FACES = polar_disk(24, 72)
DISK = Disk(Z, FACES)


def flat(unit=1.0):
    """The unit disk in space, in some unit of length."""
    return Surface(unit * np.stack([Z.real, Z.imag, 0 * Z.real], axis=1), FACES)


def compared(surface, maps):
    """The features of a surface laid on the disk, compared with its own others."""
    side = ParameterizedSurface(surface, DISK)
    return featured(side, side, maps)[-1]


def waves(w):
    """Two maps of the disk, (V,) each."""
    return np.cos(7 * w.real + 1) + np.sin(5 * w.imag), np.sin(6 * (w.real + w.imag)) + w.real


ONE = waves(Z)[0]


def features(unit=1.0, scale=1.0, weights=(1.0, 1.0)):
    maps = [Feature(f"wave {k}", scale * u + k, 3 * u, w) for k, (u, w) in enumerate(zip(waves(Z), weights))]
    return compared(flat(unit), maps)


def test_heat_flow_damps_an_eigenfunction_of_the_disk_as_its_eigenvalue_says(monkeypatch):
    """J_0(k r) with J_0'(k) = 0 does not flow over the rim; implicit steps: `(1 + k^2 t / n)^-n`."""
    k, sigma = jn_zeros(1, 2)[1], 20.0
    wave = j0(k * abs(Z))[:, None]
    time = sigma**2 / 2 * np.pi / HEMISPHERE
    smoothing = Smoothing(flat(), ["wave"], wave)
    monkeypatch.setattr("qclearn.registration.features.clipped", lambda values, *_: values)
    expected = (1 + k**2 * time / 4) ** -4
    assert 0.6 < expected < 0.9
    np.testing.assert_allclose(smoothing.smoothed(sigma), expected * wave, atol=1e-2)


def test_features_are_standardised_by_area_and_know_no_units():
    usual, other = features(), features(unit=25.4, scale=1e3)
    for side, again in zip(usual.at(8.0), other.at(8.0)):
        np.testing.assert_allclose(usual.areas @ side, 0, atol=1e-12)
        np.testing.assert_allclose(usual.areas @ side**2, 1)
        np.testing.assert_allclose(side, again, atol=1e-8)
    for scale in (1e-200, 1e200):
        pair = compared(flat(), check_features([(scale * ONE, ONE)], flat(), flat()))
        assert pair.correlation(Z)[0] == pytest.approx(1)


def test_outliers_are_clipped():
    values = ONE.copy()
    values[[5, 900]] = [1e4, -1e4]
    smoothed = Smoothing(flat(), ["spiked", "wave"], np.stack([values, ONE], axis=1)).at(4.0)
    assert abs(smoothed).max() < 4
    assert flat().vertex_areas / flat().area @ smoothed.prod(1) > 0.3  # unclipped: two spikes alone


def test_the_mismatch_is_twice_one_less_the_correlation():
    """Where the map keeps the variance: the same vertices on both sides, and a feature that is another one there."""
    one, two = waves(Z)
    pair = compared(flat(), [Feature("mixed", one + two, one - 0.3 * two)])
    r = pair.correlation(Z)
    assert 0.1 < r[0] < 0.9
    assert (FeatureTerm(pair, 4.0, 0.7).residual(Z) ** 2).sum() == pytest.approx(0.7 * 2 * (1 - r[0]), rel=1e-6)


def test_few_vertices_of_a_large_surface_judge_as_all_do(monkeypatch):
    """Of scales above the finest alone."""
    monkeypatch.setattr("qclearn.registration.features.COARSE_VERTICES", 600)
    every = features()
    whole = (FeatureTerm(every, 30.0, 1.0).residual(0.9 * Z) ** 2).sum()
    monkeypatch.setattr("qclearn.registration.features.LARGE", len(Z) - 1)
    judges = some, areas = features().judges(30.0)
    assert 600 <= len(some) < len(Z) / 2 and areas.sum() == pytest.approx(1) and areas.min() > 0
    places = Places(DISK, DISK.interpolation(Z[some]))
    judged = (FeatureTerm(every, 30.0, 1.0, places, judges).residual(0.9 * Z) ** 2).sum()
    assert judged == pytest.approx(whole, rel=0.03)
    assert len(features().judges(4.0)[0]) == len(Z)


def test_weights_are_shares():
    terms = (FeatureTerm(features(weights=w), 8.0, 1.0) for w in ((1, 3), (1, 1), (0.2, 0.6)))
    one, even, same = ((term.residual(0.9 * Z) ** 2).sum() for term in terms)
    assert one == pytest.approx(same) != pytest.approx(even)


@pytest.mark.parametrize("name, sigma, local", [("depth", 4.0, True), ("depth", 16.0, False), ("own", 4.0, False)])
def test_fine_folds_count_by_their_surroundings(name, sigma, local):
    """Waves of 25 mm, three times as strong on the right as on the left, and on a slope."""
    strength = np.where(Z.real > 0, 3.0, 1.0)
    wave = strength * np.cos(2 * np.pi * Z.imag * np.sqrt(HEMISPHERE / np.pi) / 25) + 2 * Z.real
    smoothing = Smoothing(flat(), [name], wave[:, None])
    found, plain = smoothing.compared(sigma), smoothing.at(sigma)
    if not local:
        np.testing.assert_array_equal(found, plain)
        return
    left, right = ((abs(Z.imag) < 0.8) & side for side in (Z.real < -0.3, Z.real > 0.3))
    assert np.std(found[right]) < 1.3 * np.std(found[left]) and np.std(plain[right]) > 2 * np.std(plain[left])


@pytest.mark.parametrize(
    "names, sigma, shares",
    [
        (("depth", "curvature", "potential"), 16.0, (0.25, 0.5, 0.25)),
        (("depth", "curvature", "potential"), 8.0, (0.5, 0.5, 0)),
        (("curvature", "potential"), 8.0, (0.5, 0.5)),
        (("own", "depth"), 16.0, (0.5, 0.5)),
    ],
)
def test_the_potential_takes_half_of_the_weight_of_the_depth_at_coarse_scales(names, sigma, shares):
    found = compared(flat(), [Feature(name, ONE, ONE) for name in names])
    np.testing.assert_allclose(found.compared(sigma)[-1], shares)
    np.testing.assert_allclose(found.feature_weights, 1 / len(names))


def test_the_folds_are_depth_curvature_and_its_potential():
    surface, _ = grooved_sphere()
    depth, curvature, potential = check_features(FOLDS, surface, surface)
    np.testing.assert_array_equal(potential.moving, curvature_potential(surface))
    np.testing.assert_array_equal(depth.moving, sulcal_depth(surface))
    np.testing.assert_array_equal(curvature.control, mean_curvature(surface))
    assert (depth.name, depth.weight, curvature.name) == ("depth", 1.0, "curvature")


def test_maps_of_the_users_own_with_and_without_weights():
    one, two = waves(Z)
    given = [(one, two), ((two, one), 2), Feature("sulc", one, one, 0.5), (Feature("thickness", one, one), 3.0)]
    found = check_features(given, flat(), flat())
    assert [feature.name for feature in found] == ["feature 1", "feature 2", "sulc", "thickness"]
    assert [feature.weight for feature in found] == [1, 2, 0.5, 3]
    np.testing.assert_array_equal(found[1].moving, two)


@pytest.mark.digits
def test_coarse_scales_of_a_large_surface_are_smoothed_on_few_vertices():
    """With the finest one as it was, bit for bit, and without a disk, or on a small surface, all of them."""
    large = Disk(*polar_disk(100, 210))
    for disk, same in ((large, [True, False, False]), (DISK, [True, True, True])):
        surface = Surface(np.stack([disk.z.real, disk.z.imag, 0 * disk.z.real], axis=1), disk.faces)
        values = np.stack(waves(disk.z), axis=1)
        whole, few = (Smoothing(surface, "ab", values, known) for known in (None, disk))
        for sigma, exact in zip((4.0, 8.0, 32.0), same):
            one, other = whole.at(sigma), few.at(sigma)
            assert np.array_equal(one, other) == exact
            assert np.sqrt(whole.areas @ (one - other) ** 2).max() < 0.01
    assert len(few.areas) == len(DISK.z)


HOLE = np.where(np.arange(len(Z)) == 7, np.nan, ONE)
SPIKE = 0.3 + 1.0 * (np.arange(len(Z)) == 900)
MASK = 1.0 * (np.arange(len(Z)) < len(Z) // 200)
BAD_FEATURES = [
    ([(ONE, SPIKE)], "feature 1, control side: the same value everywhere but for outliers; leave it out"),
    ([(MASK, ONE)], "feature 1, moving side: the same value everywhere but for outliers; leave it out"),
    ([("wave", ONE)], "^feature 1, moving side: values of type <U4"),
    (["sulc"], "unknown feature 'sulc': depth, curvature, potential are computed"),
    ("depth", "features are 'depth': give a list"),
    ([], r"features are \[\]: give a list of them, or None for landmarks alone"),
    ([ONE], "feature 1 is neither a name nor a pair of maps"),
    ([(ONE, ONE), (ONE, ONE[:-1])], rf"feature 2, control side: shape \({len(Z) - 1},\) for {len(Z)} vertices"),
    ([(ONE, HOLE)], r"feature 1, control side: not finite at vertices \[7\]"),
    ([(np.full(len(Z), 2.5), ONE)], "feature 1, moving side: the same value everywhere, 2.5; leave"),
    ([Feature("sulc", ONE, ONE + 0j)], "sulc, control side: values of type complex128"),
    ([Feature("areas", np.arange(len(Z)), ONE)], "areas, moving side: values of type int64.*labels have no order"),
    ([(ONE > 0, ONE)], "feature 1, moving side: values of type bool"),
    ([(ONE, [[1.0], [1.0, 2.0]])], "feature 1, control side: lists of unequal lengths"),
    *[([Feature(name, ONE, ONE)], "feature 1: its name .* is not text") for name in (None, 3, ["a"])],
    *[([((ONE, ONE), weight)], f"feature 1: weight {weight} is not positive") for weight in (0.0, np.nan)],
    ([Feature("sulc", ONE, ONE), Feature("sulc", ONE, ONE)], r"features named twice: \['sulc'\]"),
]


@pytest.mark.parametrize("given, message", BAD_FEATURES)
def test_what_cannot_be_a_feature_is_refused_by_name(given, message):
    with pytest.raises(FeatureError, match=message):
        check_features(given, flat(), flat())
