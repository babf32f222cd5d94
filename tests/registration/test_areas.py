"""The energy of a surface: areas are measured right, their derivative holds, and a fit that sees
them distorts less."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from test_hybrid import CONTROL, MOVING, flat, folds
from test_register import bowl, entries

from exactmaps import TWIST
from qclearn.plane.mobius import mobius
from qclearn.registration import fit as fit_module
from qclearn.registration.features import Feature, featured
from qclearn.registration.fit import fit_landmarks, fit_problem, fit_registration
from qclearn.registration.levels import Level, MultiresolutionFit
from qclearn.registration.problem import LandmarkError, Problem, Weights
from qclearn.registration.register import register
from qclearn.registration.start import SurfacePair
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.surface import Surface

WEIGHTS = Weights(beta=1e-3, delta=10.0, eta=0.1)
GROWTH = 0.4  # of the radius at the rim of `grown`, less at the centre


def grown(disk, growth=GROWTH):
    """A flat `ParameterizedSurface` of a disk in which the vertex z lies at z (1 + growth |z|^2):
    its areas grow with the radius."""
    at = disk.z * (1 + growth * abs(disk.z) ** 2)
    return ParameterizedSurface(Surface(np.stack([at.real, at.imag, 0 * at.real], axis=1), disk.faces), disk)


def growth_of(z, growth=GROWTH):
    """log of the share of a `grown` side's area over the disk's: the Jacobian `(1 + g r^2)(1 + 3 g
    r^2)` of shares."""
    square = abs(z) ** 2
    return np.log((1 + growth * square) * (1 + 3 * growth * square) / (1 + growth) ** 2)


def sides_of(moving, control, maps=()):
    """`SurfacePair` of two flat `ParameterizedSurface`s with features, if any."""
    if not maps:
        return SurfacePair(moving, control, [], [])
    moving, control, features = featured(moving, control, [Feature(f"{k}", *pair) for k, pair in enumerate(maps)])
    return SurfacePair(moving, control, [], [], features)


def problem_of(sides, p=(), q=()):
    return Problem(sides.moving.disk, p, q, fewest=0, pair=sides)


def objective_of(problem, level):
    return MultiresolutionFit(problem).objective(level, Weights(eta=0.5))


OWN, ON_GRID = Level(8, 4.0, 4, "own"), Level(12, 4.0, 4)


@pytest.mark.parametrize("level, tolerance", [(OWN, 0.02), (ON_GRID, 0.02)])
def test_the_areal_scale_of_a_known_map_is_found(level, tolerance):
    objective = objective_of(problem_of(sides_of(flat(MOVING), grown(CONTROL))), level)
    mesh = objective.coefficient_mesh.disk
    f = TWIST(mesh.z)  # which keeps the area of the plane
    expected = growth_of(f)[mesh.faces].mean(1)
    inner = abs(mesh.centroids) < 0.9
    off = objective.area_term.log_areal(f) - expected
    assert np.sqrt((off[inner] ** 2).mean()) < tolerance and abs(off[inner]).max() < 3 * tolerance
    assert np.ptp(expected[inner]) > 0.8


def test_a_mobius_map_of_the_moving_disk_changes_no_area_of_the_surfaces():
    side, turn = grown(MOVING), (0.3 - 0.1j, 0.5)
    moved = replace(side, disk=side.disk.at(mobius(side.disk.z, *turn)))
    sides = sides_of(side, grown(CONTROL), [(folds(MOVING.z)[0], folds(CONTROL.z)[0])])
    found = []
    for moving, f in ((sides.moving, MOVING.z), (replace(sides.moving, disk=moved.disk), MOVING.z)):
        found.append(objective_of(problem_of(replace(sides, moving=moving)), OWN).area_term.log_areal(f))
    off = found[0] - found[1]  # the log of a mean around a vertex, the mean of logs
    assert np.sqrt((off**2).mean()) < 0.01 and np.sqrt((found[0] ** 2).mean()) < 0.02


@pytest.mark.parametrize("level", [OWN, ON_GRID])
def test_the_derivative_of_areas_equals_central_differences(level):
    objective, rng = (
        objective_of(problem_of(sides_of(grown(MOVING, -0.2), grown(CONTROL))), level),
        np.random.default_rng(5),
    )
    f, step = mobius(TWIST(objective.coefficient_mesh.disk.z), 0.1 + 0.05j, 0.2), 1e-6
    for _ in range(3):
        a, b, c = rng.normal(size=3) + 1j * rng.normal(size=3)
        change = 0.1 * (1 - abs(f) ** 2) * (a + b * f + c * f.conj() ** 2)
        expected = (
            objective.area_term.residual(f + step * change) - objective.area_term.residual(f - step * change)
        ) / (2 * step)
        found = (objective.area_term.rows(f).conj() @ change).real
        assert np.linalg.norm(found - expected) < 5e-3 * np.linalg.norm(expected)


def test_prior_and_areas_together_are_henckys_energy():
    """alpha |nu|^2 + alpha/4 (log J)^2 is half of alpha times the squared logs of the principal
    stretches."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(20, 2, 2))
    A[np.linalg.det(A) < 0, 0] *= -1
    a = (A[:, 0, 0] + A[:, 1, 1] + 1j * (A[:, 1, 0] - A[:, 0, 1])) / 2
    b = (A[:, 0, 0] - A[:, 1, 1] + 1j * (A[:, 1, 0] + A[:, 0, 1])) / 2
    stretches = np.log(np.linalg.svd(A, compute_uv=False))
    nu, log_j = np.arctanh(abs(b / a)), np.log(abs(a) ** 2 - abs(b) ** 2)
    np.testing.assert_allclose(nu**2 + log_j**2 / 4, (stretches**2).sum(1) / 2)


def test_a_face_that_folds_costs_much_and_not_infinitely():
    objective = objective_of(problem_of(sides_of(flat(MOVING), flat(CONTROL))), OWN)
    f = MOVING.z.copy()
    f[np.argmin(abs(f))] += 0.2
    residual, rows = objective.area_term.residual(f), objective.area_term.rows(f)
    assert np.isfinite(residual).all() and np.isfinite(rows.data).all()
    assert abs(objective.area_term.log_areal(f)).max() == pytest.approx(-np.log(objective.area_term.FLOOR), rel=0.1)


@pytest.fixture(scope="module")
def pulled():
    """Three landmarks pulled across a disk, with eta 0, 0.3 and 3."""
    p = 0.4 * np.exp(2j * np.pi * np.arange(3) / 3)
    problem = problem_of(sides_of(flat(MOVING), flat(CONTROL)), p, [0.7, *(0.35 * p[1:] / abs(p[1:]))])
    return [(fit_problem(problem, Weights(eta=eta)), eta) for eta in (0.0, 0.3, 3.0)]


def test_with_landmarks_alone_a_larger_eta_changes_less_area(pulled):
    spread = []
    for fit, _ in pulled:
        ratio = np.log(MOVING.at(fit.f).areas / MOVING.areas)
        spread.append(MOVING.areas @ (ratio - MOVING.areas @ ratio / MOVING.areas.sum()) ** 2)
        assert fit.bijective and fit.fallbacks == () and fit.landmark_error < 0.05
    assert spread[2] < 0.8 * spread[1] < 0.8 * 0.9 * spread[0]
    assert "L_area" not in pulled[0][0].losses and pulled[2][0].losses["L_area"] < pulled[1][0].losses["L_area"]


def test_without_eta_the_papers_setting_is_met_exactly(monkeypatch):
    seen = []

    def fit(problem, *given, **options):
        seen.append(problem)
        return fit_problem(problem, *given, **options)

    monkeypatch.setattr(fit_module, "fit_problem", fit)
    result = register(bowl(0.6), bowl(0.9), entries(0), features=None, eta=0)
    (problem,) = seen
    alone = fit_landmarks(problem.disk.z, problem.disk.faces, problem.moving, problem.target, curve=problem.curve)
    np.testing.assert_allclose(result.disk_map, alone.f, rtol=0, atol=1e-9)
    assert result.report["eta"] == 0 and register(bowl(0.6), bowl(0.9), entries(0), features=None).report["eta"] == 0


def test_the_report_tells_eta_and_distortions():
    told = [register(bowl(0.6), bowl(1.2), entries(0), eta=eta, features=None).report for eta in (0.0, 2.0)]
    areas = [report["distortion"]["log2_area"] for report in told]
    assert [report["eta"] for report in told] == [0.0, 2.0] and json.dumps(told)
    assert all(list(area) == ["50", "95", "100"] and area["50"] < area["95"] < area["100"] for area in areas)
    assert areas[1]["95"] < areas[0]["95"]


def tall(disk, height=0.5):
    """The `ParameterizedSurface` of a disk under a hill and a hollow, whose places in space tell a
    turned map from the right one."""
    w = disk.z
    z = height * np.exp(-8 * abs(w - 0.4) ** 2) - height * np.exp(-8 * abs(w - 0.4j) ** 2)
    return ParameterizedSurface(Surface(np.stack([w.real, w.imag, z], axis=1), disk.faces), disk)


MAPS = list(zip(folds(TWIST(MOVING.z)), folds(CONTROL.z)))


@pytest.fixture(scope="module")
def spoilt():
    """Fits of one problem from three Möbius starts: the true one, one turned, and one far off."""
    sides, found = sides_of(tall(MOVING), tall(CONTROL), MAPS), []
    for start in [(0j, 0.0), (0.3j, -0.5), (-0.3 + 0.2j, np.pi)]:
        disk = MOVING.at(mobius(MOVING.z, *start))
        laid = replace(sides, moving=replace(sides.moving, disk=disk))
        found.append(fit_registration(problem_of(laid), WEIGHTS, sides.features))
    return found


def test_fits_from_spoilt_starts_end_where_the_good_one_does(spoilt):
    good, *others = spoilt
    assert abs(good.f - TWIST(MOVING.z)).mean() < 0.02
    for fit in others:
        assert abs(fit.f - good.f).mean() < 0.02 and fit.bijective


def test_the_start_is_told_in_words(spoilt):
    good, *_, last = spoilt
    assert re.match(r"by crude spheres, 0\.\d+ in the disk from the best Möbius map of features", good.start_message)
    assert re.match(r"by spheres \(objective \S+\), not by features \(objective \S+\)", last.start_message)
    taken, left = map(float, re.findall(r"objective ([\d.]+)", last.start_message))
    assert taken < left


def test_places_that_mislead_do_no_harm():
    """The moving side is turned about in space: its places lead astray, and the way without them is
    kept."""
    side = tall(MOVING)
    turned = replace(side, surface=Surface(side.surface.vertices * [-1, -1, 1], MOVING.faces))
    sides = sides_of(turned, tall(CONTROL), MAPS)
    fit = fit_registration(problem_of(sides), WEIGHTS, sides.features)
    assert fit.start_message.startswith("by features (objective") and abs(fit.f - TWIST(MOVING.z)).mean() < 0.02


@pytest.mark.parametrize(
    "eta, more, words",
    [
        (-0.1, {}, "eta = -0.1: must be finite and not negative"),
        (np.nan, {}, "eta = nan"),
        (np.inf, {"features": None}, "eta = inf"),
        ("much", {}, "eta = 'much'"),
        (0.5, {"features": None, "method": "network"}, "eta = 0.5 and the networks alone: .*eta=0"),
    ],
)
def test_an_eta_that_cannot_be_used_is_refused(eta, more, words):
    with pytest.raises(LandmarkError, match=words):
        register(bowl(0.6), bowl(0.9), entries(0), eta=eta, **more)


def test_eta_without_surfaces_is_refused():
    with pytest.raises(LandmarkError, match="eta = 0.5: areas belong to surfaces.*pair"):
        fit_problem(Problem(MOVING, [0.1], [0.2]), Weights(eta=0.5))
