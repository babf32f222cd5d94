"""The energy of a surface: areas are measured right, their derivative holds, and a fit that sees them distorts less."""

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
    """A flat `ParameterizedSurface` of a disk whose vertex z lies at z (1 + growth |z|^2): areas grow outwards."""
    at = disk.z * (1 + growth * abs(disk.z) ** 2)
    return ParameterizedSurface(Surface(np.stack([at.real, at.imag, 0 * at.real], axis=1), disk.faces), disk)


def growth_of(z, growth=GROWTH):
    """log of the share of a `grown` side's area over the disk's: the Jacobian `(1 + g r^2)(1 + 3 g r^2)` of shares."""
    square = abs(z) ** 2
    return np.log((1 + growth * square) * (1 + 3 * growth * square) / (1 + growth) ** 2)


def sides_of(moving, control, maps=(), names="012"):
    """`SurfacePair` of two flat `ParameterizedSurface`s with features, if any."""
    if not maps:
        return SurfacePair(moving, control, [], [])
    moving, control, features = featured(moving, control, [Feature(*given) for given in zip(names, *zip(*maps))])
    return SurfacePair(moving, control, [], [], features)


def problem_of(sides, p=(), q=()):
    return Problem(sides.moving.disk, p, q, fewest=0, pair=sides)


def objective_of(problem, level):
    return MultiresolutionFit(problem).objective(level, Weights(eta=0.5))


OWN, ON_GRID = Level(8, 4.0, 4, "own"), Level(12, 4.0, 4)


@pytest.mark.parametrize("level", [OWN, ON_GRID])
def test_the_areal_scale_of_a_known_map_is_found(level):
    objective = objective_of(problem_of(sides_of(flat(MOVING), grown(CONTROL))), level)
    mesh = objective.coefficient_mesh.disk
    f = TWIST(mesh.z)  # which keeps the area of the plane
    expected = growth_of(f)[mesh.faces].mean(1)
    inner = abs(mesh.centroids) < 0.9
    off = objective.area_term.log_areal(f) - expected
    assert np.sqrt((off[inner] ** 2).mean()) < 0.02 and abs(off[inner]).max() < 0.06
    assert np.ptp(expected[inner]) > 0.8


def test_a_mobius_map_of_the_moving_disk_changes_no_area_of_the_surfaces():
    side, found = grown(MOVING), []
    turned = replace(side, disk=side.disk.at(mobius(side.disk.z, 0.3 - 0.1j, 0.5)))
    for moving in (side, turned):
        found.append(objective_of(problem_of(sides_of(moving, grown(CONTROL))), OWN).area_term.log_areal(MOVING.z))
    off = found[0] - found[1]  # the log of a mean around a vertex, the mean of logs
    assert np.sqrt((off**2).mean()) < 0.01 and np.sqrt((found[0] ** 2).mean()) < 0.02


@pytest.mark.parametrize("level", [OWN, ON_GRID])
def test_the_derivative_of_areas_equals_central_differences(level):
    objective = objective_of(problem_of(sides_of(grown(MOVING, -0.2), grown(CONTROL))), level)
    f, step, rng = mobius(TWIST(objective.coefficient_mesh.disk.z), 0.1 + 0.05j, 0.2), 1e-6, np.random.default_rng(5)
    for a, b, c in rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3)):
        change = 0.1 * (1 - abs(f) ** 2) * (a + b * f + c * f.conj() ** 2)
        ahead, behind = (objective.area_term.residual(f + sign * step * change) for sign in (1, -1))
        expected = (ahead - behind) / (2 * step)
        found = (objective.area_term.rows(f).conj() @ change).real
        assert np.linalg.norm(found - expected) < 5e-3 * np.linalg.norm(expected)


def test_a_face_that_folds_costs_much_and_not_infinitely():
    objective = objective_of(problem_of(sides_of(flat(MOVING), flat(CONTROL))), OWN)
    f = MOVING.z.copy()
    f[np.argmin(abs(f))] += 0.2
    residual, rows = objective.area_term.residual(f), objective.area_term.rows(f)
    assert np.isfinite(residual).all() and np.isfinite(rows.data).all()
    assert abs(objective.area_term.log_areal(f)).max() == pytest.approx(-np.log(objective.area_term.FLOOR), rel=0.1)


def test_with_landmarks_alone_a_larger_eta_changes_less_area():
    """Three landmarks pulled across a disk."""
    p = 0.4 * np.exp(2j * np.pi * np.arange(3) / 3)
    problem = problem_of(sides_of(flat(MOVING), flat(CONTROL)), p, [0.7, *(0.35 * p[1:] / abs(p[1:]))])
    fits, spread = [fit_problem(problem, Weights(eta=eta)) for eta in (0.0, 0.3, 3.0)], []
    for fit in fits:
        ratio = np.log(MOVING.at(fit.f).areas / MOVING.areas)
        spread.append(MOVING.areas @ (ratio - MOVING.areas @ ratio / MOVING.areas.sum()) ** 2)
        assert fit.bijective and fit.fallbacks == () and fit.landmark_error < 0.05
    assert spread[2] < 0.8 * spread[1] < 0.8 * 0.9 * spread[0]
    assert "L_area" not in fits[0].losses and fits[2].losses["L_area"] < fits[1].losses["L_area"]


def test_without_eta_the_papers_setting_is_met_exactly_and_the_report_tells_eta(monkeypatch):
    seen = []

    def fit(problem, *given, **options):
        seen.append(problem)
        return fit_problem(problem, *given, **options)

    monkeypatch.setattr(fit_module, "fit_problem", fit)
    pair = bowl(0.6), bowl(1.2), entries(0)
    usual, plain, much = (register(*pair, features=None, **eta) for eta in ({}, {"eta": 0}, {"eta": 2.0}))
    problem = seen[1]
    alone = fit_landmarks(problem.disk.z, problem.disk.faces, problem.moving, problem.target, curve=problem.curve)
    np.testing.assert_allclose(plain.disk_map, alone.f, rtol=0, atol=1e-9)
    assert [one.report["eta"] for one in (usual, plain, much)] == [0, 0, 2]
    assert much.report["distortion"]["log2_area"]["95"] < plain.report["distortion"]["log2_area"]["95"]


def tall(disk, height=0.5):
    """The side of a disk under a hill and a hollow, whose places in space tell a turned map from the right one."""
    w = disk.z
    z = height * np.exp(-8 * abs(w - 0.4) ** 2) - height * np.exp(-8 * abs(w - 0.4j) ** 2)
    return ParameterizedSurface(Surface(np.stack([w.real, w.imag, z], axis=1), disk.faces), disk)


MAPS = list(zip(folds(TWIST(MOVING.z)), folds(CONTROL.z)))


def test_fits_from_spoilt_starts_end_where_the_good_one_does_and_say_how():
    """From three Möbius starts: the true one, one turned, and one far off."""
    sides, fits = sides_of(tall(MOVING), tall(CONTROL), MAPS), []
    for start in [(0j, 0.0), (0.3j, -0.5), (-0.3 + 0.2j, np.pi)]:
        laid = replace(sides, moving=replace(sides.moving, disk=MOVING.at(mobius(MOVING.z, *start))))
        fits.append(fit_registration(problem_of(laid), WEIGHTS, sides.features))
    assert abs(fits[0].f - TWIST(MOVING.z)).mean() < 0.02
    for fit in fits[1:]:
        assert abs(fit.f - fits[0].f).mean() < 0.02 and fit.bijective
    first, last = fits[0].start_message, fits[2].start_message
    assert re.match(r"by crude spheres, 0\.\d+ in the disk from the best Möbius map of features", first)
    found = re.match(r"by spheres \(objective ([\d.]+)\), not by features \(objective ([\d.]+)\)", last)
    assert float(found[1]) < float(found[2])


def test_places_that_mislead_do_no_harm():
    """The moving side is turned about in space: its places lead astray, and the way without them is kept."""
    side = tall(MOVING)
    turned = replace(side, surface=Surface(side.surface.vertices * [-1, -1, 1], MOVING.faces))
    sides = sides_of(turned, tall(CONTROL), MAPS)
    fit = fit_registration(problem_of(sides), WEIGHTS, sides.features)
    assert fit.start_message.startswith("by features (objective") and abs(fit.f - TWIST(MOVING.z)).mean() < 0.02


@pytest.mark.parametrize("turn, told", [(0.0, "$"), (1.0, "; the potential's share 0 of 0.5, 0")])
def test_of_what_depth_and_its_potential_guide_the_lower_goes_on(turn, told):
    """A potential that lies elsewhere than the folds guides astray."""
    potential = [1.5 * field for field in (folds(TWIST(MOVING.z))[0], folds(CONTROL.z * np.exp(1j * turn))[0])]
    sides = sides_of(tall(MOVING), tall(CONTROL), [*MAPS, potential], ("depth", "curvature", "potential"))
    fit = fit_registration(problem_of(sides), WEIGHTS, sides.features)
    assert abs(fit.f - TWIST(MOVING.z)).mean() < 0.02 and re.search(f"Möbius map of features{told}", fit.start_message)


def test_eta_without_surfaces_is_refused():
    with pytest.raises(LandmarkError, match="eta = 0.5: areas belong to surfaces.*pair"):
        fit_problem(Problem(MOVING, [0.1], [0.2]), Weights(eta=0.5))
