"""Registration by features: the derivative and the step against brute force, and maps that must be found again."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse

from exactmaps import TWIST
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk, square_disk
from qclearn.plane.mobius import compose_mobius, mobius, mobius_inverse
from qclearn.plane.solver import CoefficientMesh
from qclearn.registration import fit, gauss_newton, levels
from qclearn.registration.features import Feature, featured, mobius_by_features
from qclearn.registration.fit import fit_problem, fit_registration
from qclearn.registration.gauss_newton import GaussNewtonObjective
from qclearn.registration.levels import LARGE_LEVELS, LEVELS, Level, MultiresolutionFit, landmark_levels
from qclearn.registration.problem import LandmarkError, Problem, Weights
from qclearn.registration.residuals import FeatureTerm, Places
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.surface import Surface

CONTROL, MOVING = Disk(*polar_disk(40, 120)), Disk(*square_disk(40))


def flat(disk):
    """The `ParameterizedSurface` of a disk in space."""
    at = np.stack([disk.z.real, disk.z.imag, 0 * disk.z.real], axis=1)
    return ParameterizedSurface(Surface(at, disk.faces), disk)


def folds(w):
    """Two maps of the disk that no symmetry takes to themselves."""
    return (
        np.cos(9 * w.real + 2 * w.imag) + 0.6 * np.sin(7 * w.imag + 4 * w.real**2) + w.real,
        np.sin(8 * w.real - 5 * w.imag) + np.cos(11 * w.imag) - w.imag,
    )


def features_of(exact, moving=MOVING):
    """Features that `exact` takes to the control's, whose disk map is the disk itself."""
    maps = [Feature(name, *pair) for name, *pair in zip("ab", folds(exact(moving.z)), folds(CONTROL.z))]
    return featured(flat(moving), flat(CONTROL), maps)[-1]


def no_landmarks():
    return Problem(MOVING, [], [], fewest=0)


# The derivative and the step


@pytest.fixture(scope="module")
def equations():
    """Landmarks and features on a small mesh, linearised at a field and a Möbius map: (objective, state, step)."""
    rng = np.random.default_rng(1)
    mesh = Disk(*polar_disk(5, 15))
    moving, target = 0.7 * np.exp(1j * np.arange(4)), 0.6 * np.exp(1j * np.arange(4) + 0.2j)
    features = FeatureTerm(features_of(TWIST), 16.0, 0.5, Places(CONTROL, mesh.interpolation(MOVING.z)))
    problem, weights = Problem(MOVING, moving, target), Weights(1.0, 0.02, 1e2, 0.5)
    objective = GaussNewtonObjective(problem, CoefficientMesh(mesh, mesh), weights, True, features)
    nu = 0.2 * (rng.normal(size=len(mesh.z)) + 1j * rng.normal(size=len(mesh.z)))
    state = objective.at(nu, (0.1 - 0.05j, 0.2))
    return objective, state, objective.linearise(state, 1e2)


def test_the_derivative_of_all_residuals_equals_differences(equations):
    """Up to the slopes, which are averaged over the control's faces."""
    objective, state, found = equations
    rng, step = np.random.default_rng(2), 1e-4

    def residual(x):
        moved = compose_mobius(state.mobius, (complex(x[-2], x[-1]), x[-3]))
        at = objective.at(state.nu + x[:-3].view(complex), moved)
        return np.concatenate([objective.landmarks.residual(at.points, 1e2), objective.feature_term.residual(at.f)])

    for _ in range(3):
        x = rng.normal(size=2 * len(state.nu) + 3)
        expected = (residual(step * x) - residual(-step * x)) / (2 * step)
        difference = found.forward(x) - expected
        assert np.linalg.norm(difference[:8]) < 1e-6 * np.linalg.norm(expected[:8])  # landmarks
        assert np.linalg.norm(difference) < 0.05 * np.linalg.norm(expected)


def test_the_step_solves_the_normal_equations(equations, monkeypatch):
    objective, state, found = equations
    monkeypatch.setattr(gauss_newton, "PRIMAL_STEPS", 300)
    monkeypatch.setattr(found, "accuracy", 1e-9)
    J = np.stack([found.forward(unit) for unit in np.eye(2 * len(state.nu) + 3)], axis=1)
    W = sparse.block_diag([sparse.kron(objective.W, np.eye(2)), gauss_newton.MOBIUS_PRIOR * np.eye(3)]).toarray()
    nu = np.concatenate([state.nu.view(float), np.zeros(3)])
    expected = -np.linalg.solve(W + J.T @ J, W @ nu + J.T @ found.residual)
    change, da, dtheta, promised = found.propose()
    scale = abs(expected).max()
    np.testing.assert_allclose(change.view(float), expected[:-3], atol=1e-6 * scale)
    np.testing.assert_allclose([dtheta, da.real, da.imag], expected[-3:], atol=1e-6 * scale)
    model = found.residual + J @ expected
    assert promised == pytest.approx((nu + expected) @ W @ (nu + expected) + model @ model, rel=1e-8)


# Maps found again


@pytest.fixture(scope="module")
def twisted():
    return fit_registration(no_landmarks(), Weights(beta=1e-3, delta=10.0), features_of(TWIST))


def test_a_map_is_found_again_by_features_alone(twisted):
    before, after = (abs(f - TWIST(MOVING.z)) for f in (MOVING.z, twisted.f))
    assert before.mean() > 0.1 and after.mean() < 0.07 * before.mean()
    assert twisted.bijective and twisted.fallbacks == () and twisted.landmark_error == 0
    assert abs(twisted.mu).max() < 0.98 and twisted.losses["L_features"] < 0.02  # rounding alone leads to .93 or .97
    before, after = (features_of(TWIST).correlation(f) for f in (MOVING.z, twisted.f))
    assert before.max() < 0.7 and after.min() > 0.99


def test_features_lead_between_the_landmarks():
    """Landmarks on a line through the centre; what lies beside it is known to the features alone."""
    p = np.linspace(-0.6, 0.6, 9) + 0.05j
    problem, weights = Problem(MOVING, p, TWIST(p)), Weights(gamma=1e4, delta=1.0)
    alone, both = (fit_problem(problem, weights), fit_registration(problem, weights, features_of(TWIST)))
    errors = [abs(one.f - TWIST(MOVING.z)).mean() for one in (alone, both)]
    assert errors[1] < errors[0] / 3 and both.landmark_error < 5e-3 and both.bijective


def test_coarse_features_guide_with_less_weight_and_the_whole_is_asked_for_at_last():
    t = np.exp(1j * np.arange(6))
    multiresolution, features = (MultiresolutionFit(Problem(MOVING, 0.6 * t, 0.5 * t)), features_of(TWIST))
    asked = Weights(gamma=1e5, delta=1.0)
    scales = [level.sigma for level in LEVELS]
    assert scales == sorted(scales, reverse=True) and scales[0] == 32 and LEVELS[-1].mesh == "own"
    for level in LEVELS:
        objective = multiresolution.objective(level, asked, features)
        assert objective.weights.gamma == (1e5 if level.mesh == "own" else 1e2)
        delta = (objective.feature_term.scale**2).sum()
        assert delta == pytest.approx(0.3 if level.sigma >= 16 else 1.0)
    small = multiresolution.objective(LEVELS[0], Weights(gamma=10.0, delta=0.1), features)
    assert small.weights.gamma == 10 and (small.feature_term.scale**2).sum() == pytest.approx(0.1)


@pytest.mark.parametrize("level, left, steps", [(-1, 0.98, 10), (-1, 0.995, 2), (0, 0.94, 4), (0, 0.98, 2)])
def test_a_level_ends_with_two_steps_that_gained_little(level, left, steps):
    """Of an objective whose steps leave one share of it each."""

    def value(state, _):
        return state

    def step(state, *_):
        return left * state

    falling = SimpleNamespace(weights=Weights(), spent=False, value=value, step=step)
    state, taken = levels.run_level(falling, 1.0, LEVELS[level])
    assert taken == steps and state == pytest.approx(left**steps)


# A polar mesh in a large surface's place

LARGE_DISK = Disk(*polar_disk(100, 201))  # 20,101 vertices
P = np.array([0.5, 0.4j, -0.3 - 0.4j, 0.2 - 0.5j, -0.6 + 0.1j])


def fitted(some):
    return fit_registration(Problem(MOVING, P, TWIST(P)), Weights(delta=1.0), features_of(TWIST), levels=some)


def test_a_polar_mesh_stands_for_a_surface_that_is_then_solved_on_once_or_in_steps_where_it_misleads(monkeypatch):
    """24 rings of a polar mesh stand for the surface; 4 mislead, and without steps there the fit ends above."""
    usual, found = fitted(LEVELS), {}
    for rings, ratio in ((24, levels.SKIP_RATIO), (4, levels.SKIP_RATIO), (4, np.inf)):
        monkeypatch.setattr(levels, "PROXY_RINGS", rings)
        monkeypatch.setattr(levels, "SKIP_RATIO", ratio)
        found[rings, ratio] = fitted(LARGE_LEVELS)
    good, mended, blind = found.values()
    least, *ends = (one.losses["L_CP"] + one.losses["L_features"] for one in (usual, good, mended, blind))
    assert good.steps[-2] > 0 and good.steps[-1] == 0 and good.bijective and good.fallbacks == ()
    assert abs(good.f - usual.f).mean() < 2e-3 and good.f.shape == MOVING.z.shape
    assert mended.steps[-1] > 0 and mended.bijective and max(ends[:2]) < 1.05 * least
    assert blind.steps[-1] == 0 and ends[2] > 1.1 * least


def test_landmarks_alone_are_fitted_on_what_stands_for_a_large_surface(monkeypatch):
    monkeypatch.setattr(levels, "PROXY_RINGS", 32)
    problem, weights = Problem(MOVING, P, TWIST(P)), Weights(gamma=1e2)
    objective, state, steps = MultiresolutionFit(problem).run(landmark_levels(LARGE_DISK, 16), weights)
    assert steps[-2] > 0 and steps[-1] == 0 and objective.problem is problem
    assert objective.value(state, 1e2) == pytest.approx(fit_problem(problem, weights).losses["L_CP"], rel=0.05)
    for disk, large in ((MOVING, False), (LARGE_DISK, True)):
        for some in (levels.feature_levels(disk), landmark_levels(disk, 16)):
            assert ("proxy" in [level.mesh for level in some]) == large and some[-1].mesh == "own"


def test_without_weight_features_change_nothing():
    p = 0.6 * np.exp(2j * np.pi * np.arange(8) / 8)
    problem, weights = Problem(MOVING, p, TWIST(p)), Weights(gamma=1e3)
    hybrid = fit_registration(problem, Weights(gamma=1e3, delta=1e-9), features_of(TWIST))
    np.testing.assert_allclose(hybrid.f, fit_problem(problem, weights).f, atol=5e-3)


@pytest.mark.parametrize("plain, fitted, words", [(1, 1, "that"), (0, 0, "that"), (1, 0, "that"), (0, 1, "kept")])
def test_a_mobius_map_that_alone_folds_the_mesh_is_not_returned(twisted, plain, fitted, words, monkeypatch):
    fits = [replace(twisted, bijective=bool(one)) for one in (fitted, plain)]
    monkeypatch.setattr(fit, "report_fit", lambda *_: fits.pop(0))
    values = iter([1.0, 2.0])  # of the Möbius map, and of the fit
    above = SimpleNamespace(problem=no_landmarks(), weights=Weights(), spent=False, feature_term=True)
    above.at_mobius, above.value = (lambda _: None), (lambda *_: next(values))
    found = fit.better(above, None, (1, 1))
    assert found.bijective == bool(plain or fitted)
    assert found.fallbacks[-1].startswith(f"the fit ended above the best Möbius map: {words}")


def test_features_without_weight_are_refused_and_a_large_one_is_told():
    with pytest.raises(LandmarkError, match="delta = 0: the features would take no part"):
        fit_registration(no_landmarks(), Weights(), features_of(TWIST))
    found = fit_registration(no_landmarks(), Weights(delta=11.0), features_of(TWIST), levels=[Level(8, 16.0, 1, "own")])
    assert found.fallbacks == ("delta = 11 overfits: choose it by held-out curves",)


def test_the_mobius_map_is_found_by_features_alone():
    a, theta = 0.35 - 0.2j, 2.5
    found = mobius_by_features(features_of(lambda z: mobius(z, a, theta)), MOVING.z)
    w = mobius_inverse(mobius(MOVING.z, *found), a, theta)
    assert abs(w - MOVING.z).max() < 0.03
