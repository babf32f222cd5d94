"""What every valid pair is owed: a map that is written, never worse than doing nothing, or a named refusal."""

import re
from dataclasses import replace
from functools import partial
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_fit import small_newton
from test_hybrid import features_of
from test_register import bowl, spoke

import qclearn as qc
from exactmaps import TWIST
from meshes import random_disk
from qclearn.plane.beltrami import beltrami_coefficient, locate
from qclearn.plane.bijectivity import RepairWarning, check_bijective, check_embedding
from qclearn.plane.checks import BeltramiError
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar, polar_disk
from qclearn.plane.mobius import best_mobius, mobius
from qclearn.plane.solver import CoefficientMesh
from qclearn.registration import register as pipeline
from qclearn.registration.fit import exact_map, fit_landmarks, fit_registration, is_above
from qclearn.registration.gauss_newton import GaussNewtonObjective
from qclearn.registration.levels import Level
from qclearn.registration.networks import refined
from qclearn.registration.problem import NOTHING, Problem, Weights
from qclearn.registration.report import measured_losses
from qclearn.registration.residuals import FeatureTerm
from qclearn.registration.transfer import transfer
from qclearn.surfaces.surface import Surface, SurfaceError

SMALL, COARSE = polar_disk(16, 48), random_disk(0, 16)
TURN = np.exp(2j * np.pi * np.arange(12) / 12)

register = partial(pipeline.register, features=None)  # bowls have no folds


# Ragged rims


def ragged(height, rings, seed):
    """The bowl without some faces of the rim, which has teeth and ears (two edges on it) then; the new numbers."""
    surface, rng = bowl(height, rings=rings), np.random.default_rng(seed)
    outer = surface.faces >= len(surface.vertices) - 3 * rings
    kept = surface.faces[(outer.sum(1) != 2) | (rng.uniform(size=len(outer)) >= 0.4)]
    used, corners = np.unique(kept, return_inverse=True)
    number = np.searchsorted(used, np.arange(len(surface.vertices)))
    return Surface(surface.vertices[used], corners.reshape(-1, 3)), number


@pytest.mark.parametrize("rings, coarse", [(14, 14), (24, 5)])
def test_ragged_rims_with_ears_are_registered_and_written(tmp_path, rings, coarse):
    """On both sides, also where many moving vertices land on one straight edge of the control's rim."""
    moving, number = ragged(0.6, rings, 1)
    control, there = ragged(0.9, coarse, 2)
    curves = [
        {
            "name": f"spoke {k}",
            "detect": False,
            "moving": number[spoke(k * rings, rings, 2, rings - 3)].tolist(),
            "control": there[spoke(k * coarse, coarse, 1, coarse - 1)].tolist(),
        }
        for k in range(3)
    ]
    result = register(moving, control, curves)
    assert result.report["bijective"] and check_bijective(result.disk_moving, moving.faces, result.disk_map).bijective
    a, b, c = (result.points[corner] for corner in moving.faces.T)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert abs(result.report["degenerate"] - (area < 1e-15).sum()) <= 1
    if coarse < rings:
        assert result.report["degenerate"] > 0
        with pytest.raises(SurfaceError, match="degenerate face"):  # an input is judged as strictly as ever
            Surface(result.points, moving.faces)
    for name in ("r.surf.gii", "r.ply", "r.npz", "lh.r"):
        qc.write_surface(tmp_path / name, result.surface)
        assert (tmp_path / name).stat().st_size > 1000
    stored = np.load(tmp_path / "r.npz")
    np.testing.assert_array_equal(stored["vertices"], result.points)
    np.testing.assert_array_equal(stored["faces"], moving.faces)


# Never above the best Möbius map


def swapped(count=20):
    p = 0.7 * np.sqrt((np.arange(count) + 0.5) / count) * np.exp(2.4j * np.arange(count))
    q = p.copy()
    q[[3, 7]] = q[[7, 3]]
    return p, q


ASTRAY = {
    "two swapped": swapped(),
    "twisted": (swapped()[0], swapped()[0] * np.exp(3j * (1 - abs(swapped()[0])))),
    "reversed": (0.6 * TURN, 0.6 * TURN[::-1]),
    "neighbours": (0.3 * TURN, 0.3 * TURN[[1, 0, *range(2, 12)]]),
    "permuted": (0.7 * TURN, 0.7 * TURN[np.random.default_rng(0).permutation(12)]),
    "through the centre": (0.5 * TURN, np.random.default_rng(1).uniform(-0.6, 0.6, (12, 2)) @ [1, 1j]),
    "one": ([0.3], [0.5j]),
    "none needed": (0.5 * TURN, 0.5j * TURN),
}


def drawn(seed, count):
    """Landmarks that no map near the identity takes to theirs, spread anew or in another order."""
    rng = np.random.default_rng(seed)
    p = 0.8 * np.sqrt(rng.uniform(size=count)) * np.exp(2j * np.pi * rng.uniform(size=count))
    return p, rng.permutation(p) if seed % 2 else rng.permutation(p * np.exp(2j * rng.normal()))


landmarks = st.sampled_from(list(ASTRAY.values())) | st.builds(drawn, st.integers(0, 999), st.integers(1, 12))


@given(
    landmarks,
    st.sampled_from([SMALL, COARSE]),
    st.sampled_from([1e2, 1e3, 1e5]),
    st.sampled_from(["landmarks", "features", "networks"]),
)
@example(ASTRAY["permuted"], COARSE, 1e5, "landmarks")  # where steps that objectives alone choose end in a fold
@settings(max_examples=12, deadline=None)
def test_no_map_ends_above_the_best_mobius_map(points, mesh, gamma, route):
    """Of landmarks; of features from a field that helps nothing; of networks that answer with that field."""
    p, q = (np.asarray(side, complex) for side in points)
    problem, weights, best = Problem(Disk(*mesh), p, q), Weights(gamma=gamma), mobius(mesh[0], *best_mobius(p, q))
    floor = (abs(problem.samples @ best - q) ** 2).mean()
    wild, least = 0.6 * np.exp(9j * problem.disk.centroids.real), gamma * floor
    if route == "landmarks":
        fit = fit_landmarks(*mesh, p, q, gamma=gamma)
        value = fit.losses["L_CP"]
    elif route == "features":
        features, levels = features_of(TWIST, problem.disk), [Level(8, 4.0, 1, "own")]
        fit = fit_registration(problem, replace(weights, delta=0.3), features, wild, levels)
        value = fit.losses["L_CP"] + 0.3 * fit.losses["L_features"]
        least += (FeatureTerm(features, 4.0, 0.3).residual(best) ** 2).sum()
    else:
        fit = refined(problem, weights, wild, exact_map(problem, wild), np.inf)
        value, least = (
            measured_losses(problem, weights, problem.disk.coefficient(f), problem.samples @ f)["L_CP"]
            for f in (fit.f, best)
        )
    assert fit.bijective and check_bijective(*mesh, fit.f).bijective
    if fit.fallbacks and fit.fallbacks[-1].endswith("ended above the best Möbius map: that map is returned"):
        np.testing.assert_allclose(fit.f, best, atol=1e-14)
    else:
        square = (abs(problem.samples @ fit.f - q) ** 2).mean()
        assert value <= least * (1 + 1e-9) + NOTHING
        assert route == "features" or square <= floor * (1 + 1e-9) + NOTHING
        assert floor < 1e-20 or square != pytest.approx(floor, rel=1e-12)
    assert is_above([np.nan], [1.0])  # what is no number is not below


def test_the_work_of_a_fit_of_wrong_landmarks_is_bounded():
    """Steps of a fit end where its objective has done the work it may; the map is certified, with a word."""
    p, q = (np.asarray(side, complex) for side in ASTRAY["permuted"])
    objectives = []

    class Watched(GaussNewtonObjective):
        def __init__(self, *given):
            super().__init__(*given)
            self.most_work = min(self.most_work, 20.0)
            objectives.append(self)

    with patch("qclearn.registration.levels.GaussNewtonObjective", Watched):
        fit = fit_landmarks(*COARSE, p, q, gamma=1e5)
    assert objectives[-1].spent and fit.bijective and fit.fallbacks[-1].startswith("the fit was cut short")


def test_a_fit_gone_astray_is_taken_up_again_from_the_mobius_map():
    """On a mesh too coarse for what the polar mesh proposes: steps from there end far above the Möbius map."""
    mesh, (p, q) = random_disk(3, 16), ASTRAY["neighbours"]
    fit = fit_landmarks(*mesh, p, q, gamma=1e5)
    assert re.fullmatch(r"the fit ended above the best Möbius map: \d+ steps from there", fit.fallbacks[0])
    best = mobius(mesh[0], *best_mobius(p, q))
    assert fit.losses["L_CP"] < 0.9 * 1e5 * (abs(Disk(*mesh).interpolation(p) @ best - q) ** 2).mean()


@pytest.mark.parametrize("mesh", [SMALL, COARSE])
@pytest.mark.parametrize("apart", [1, 3, 5])
def test_landmarks_that_a_mobius_map_meets_are_fitted_in_silence(mesh, apart):
    """What rounding leaves of them is neither fitted nor compared."""
    rim = mesh[0][Disk(*mesh).loop]
    for p, q in (rim[[0, 1]], rim[[0, apart]]), (rim[[0, apart]], rim[[0, 1]]):
        fit = fit_landmarks(*mesh, p, q)
        assert fit.bijective and fit.landmark_error < 1e-9 and fit.fallbacks == ()


def test_damped_steps_are_shorter_and_turn_to_the_steepest_descent():
    newton, nu, _ = small_newton(False)
    disk = Disk(*COARSE)
    problem = Problem(disk, 0.5 * TURN, 0.45 * TURN * np.exp(0.2j * TURN.real))
    finer = GaussNewtonObjective(problem, CoefficientMesh(disk, polar(4)), Weights(), on_nu_mesh=False)
    even = np.full(len(finer.coefficient_mesh.mesh.z), 0.1 + 0.2j)
    for objective, field in ((newton, nu), (finer, even)):
        step = objective.linearise(objective.at(field, (0.1j, 0.2)), 50.0)
        sizes = [objective.prior(step.propose(damping).nu) for damping in (0.0, 0.1, 1, 10, 1e3)]
        assert (np.diff(sizes) < 0).all()
    step = newton.linearise(newton.at(nu, (0.1j, 0.2)), 50.0)
    far, farther = (step.propose(damping).nu for damping in (1e8, 1e9))
    np.testing.assert_allclose(far, 10 * farther, atol=1e-4 * abs(far).max())


# Wrong shapes and types


Z, FACES = polar_disk(3, 8)
FEW = np.zeros(len(FACES), complex)
WRONG = {
    "faces of floats": lambda: qc.signed_areas(Z, FACES.astype(float)),
    "faces of four corners": lambda: qc.check_bijective(Z, np.pad(FACES, ((0, 0), (0, 1))), Z),
    "ragged faces": lambda: qc.signed_areas(Z, [[0, 1, 2], [0, 1]]),
    "no faces": lambda: qc.signed_areas(Z, np.zeros((0, 3), int)),
    "text": lambda: qc.solve_beltrami_disk("0.1", FACES, FEW),
    "text among numbers": lambda: beltrami_coefficient(Z, FACES, ["a"] * len(Z)),
    "too long z": lambda: qc.solve_beltrami_disk(np.append(Z, 0), FACES, FEW),
    "planar points as rows": lambda: qc.stiffness(np.stack([Z.real, Z.imag], 1), FACES, FEW),
    "f too short": lambda: beltrami_coefficient(Z, FACES, Z[:-1]),
    "f as rows": lambda: qc.jacobian(Z, FACES, np.stack([Z.real, Z.imag], 1)),
    "mu of text": lambda: qc.solve_beltrami_disk(Z, FACES, ["x"] * len(FACES)),
    "points that are nowhere": lambda: locate(Z, FACES, [0.1, np.nan]),
    "points of text": lambda: locate(Z, FACES, "0.1"),
    "a map that is nowhere": lambda: transfer(np.zeros(len(Z)), Z, FACES, np.full(3, np.nan)),
    "pinned text": lambda: qc.solve_beltrami(Z, FACES, FEW, [1], ["a"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arrays_are_refused_by_name(case):
    with pytest.raises(BeltramiError, match="give|split|do the mesh|mend|leave|must be"):
        WRONG[case]()


# A solver that mends


def test_the_solver_mends_a_fold_where_asked():
    z, faces = random_disk(seed=1)
    mu = 0.9 * np.exp(2j * np.pi * np.random.default_rng(0).uniform(size=len(faces)))
    plain = qc.solve_beltrami_disk(z, faces, mu)
    assert len(check_embedding(faces, plain).flipped) > 0
    with pytest.warns(RepairWarning, match=r"\d+ rows switched to mean-value weights, 0 faces stay flipped"):
        mended = qc.solve_beltrami_disk(z, faces, mu, repair=True)
    assert check_bijective(z, faces, mended).bijective


@pytest.mark.digits
def test_the_solver_that_mends_leaves_what_does_not_fold():
    z, faces = random_disk(seed=1)
    gentle = np.full(len(faces), 0.2)
    np.testing.assert_array_equal(
        qc.solve_beltrami_disk(z, faces, gentle, repair=True), qc.solve_beltrami_disk(z, faces, gentle)
    )
