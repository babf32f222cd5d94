"""Where a registration starts: two surfaces aligned by a Möbius map, `SurfacePair`, the landmarks
sampled on both, and for a fit without landmarks two starts, by features and by `Directions`, the
surfaces' places in space."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from scipy import sparse

from ..plane.linear import degenerate_faces, heat_flow
from ..plane.mobius import best_mobius, nearest_mobius
from ..surfaces.conformal import ParameterizedSurface, apply_mobius
from ..surfaces.surface import Surface, closing_fans
from .curves import POINTS_PER_CURVE, curve_lines, equally_spaced, sample_curve
from .features import (
    FINEST,
    HEAT_STEPS,
    HEMISPHERE,
    PLACED,
    POINTS,
    SCALE,
    FeatureError,
    Features,
    best_by_features,
    mobius_by_features,
    standardised,
)
from .levels import COARSE_MM, GUIDES, feature_levels, run_level
from .problem import LandmarkError, Problem, meeting

# Crude spheres: the scale in mm at which a hemisphere has no folds and still its shape; degrees by
# which they are turned about each axis of space, from coarse to fine; cells per radius of the grid
# in which nearest vertices are looked up.
ROUND = 20.0
TURNS = (32, 16, 8, 4, 2)
CELLS = 48
APART = 0.15  # mean distance in the disk of two starts that are tried both
NEAR = 0.01  # the same of two guided fits, about 1 mm, up to which the later one is left out
# The least 1 - |a| of the Möbius map (a, theta) that aligns a disk with its area centred: what lay in
# the middle shrinks to (1 - |a|^2)^2 of its area. 0.45 to 1 by right curves, one to all, ends or
# whole, of eight people, fsaverage5 and synthetic brains (20,904 choices), 0.40 to 1 by folds; less
# than 0.08 where a curve joins neighbours on one rim and points half round the other or beyond,
# than 0.05 by a peak of features in the middle and one near the rim.
ROOM = 0.15


@dataclass(frozen=True, eq=False)
class SurfacePair:
    """Two `ParameterizedSurface`s, the `Curve`s to fit, those held out, and `Features` or None.

    With landmarks sampled: lines, held_lines: name -> (moving, control) line of a fitted or
    held-out curve in the disks; samples: ten landmarks per fitted curve, equally spaced by arc
    length, ends included, sparse (10 K, V) and (10 K, W), moving and control; messages: on failed
    detection.
    """

    moving: ParameterizedSurface
    control: ParameterizedSurface
    curves: list
    held: list
    features: Features | None = None
    lines: dict = field(default_factory=dict)
    held_lines: dict = field(default_factory=dict)
    samples: tuple = ()
    messages: tuple = ()

    @cached_property
    def directions(self):
        """The features' `Directions`, which lay the surfaces on each other by places in space."""
        return Directions(self.features, self.moving.surface, self.control.surface)

    @cached_property
    def mobius_before(self):
        """(a, theta) of the best Möbius map of all sampled landmarks, the identity without curves.
        A report's `_before` is after it; a fit begins at `Problem.mobius`, of the distinct ones."""
        if not self.samples:
            return 0j, 0.0
        here, there = self.samples
        return best_mobius(here @ self.moving.disk.z, there @ self.control.disk.z)


def align_disks(pair):
    """The pair with its moving disk aligned to the control's by a Möbius map: of the points that
    its curves give, or without curves of its features."""
    if pair.curves:
        return replace(pair, moving=align(pair.moving, pair.control, pair.curves))
    parameters = mobius_by_features(pair.features, pair.moving.disk.z)
    if 1 - abs(parameters[0]) < ROOM:
        raise FeatureError(
            "the features pull the moving disk onto its rim; give a landmark curve or two"
        )
    return replace(pair, moving=apply_mobius(pair.moving, parameters))


def align(moving, control, curves):
    """The moving `ParameterizedSurface` after the Möbius map that best carries the given points of
    `Curve`s to the control's: of their ends, or of whole paths where both sides have these. It
    changes the disk itself; the best Möbius maps of a `Problem` and of `mobius_before` come
    after it."""
    p, q = [], []
    for curve in curves:
        whole = min(len(curve.moving), len(curve.control)) > 2
        count = POINTS_PER_CURVE if whole else 2
        p.append(sample_curve(moving.surface, curve.moving, count) @ moving.disk.z)
        q.append(sample_curve(control.surface, curve.control, count) @ control.disk.z)
    parameters = best_mobius(np.concatenate(p), np.concatenate(q))
    if 1 - abs(parameters[0]) < ROOM:
        # At fault is the first curve without which the map of the others moves 0 the least.
        shifts = np.zeros(len(curves))
        for k in range(len(curves) if len(curves) > 1 else 0):
            others = (np.concatenate([*side[:k], *side[k + 1 :]])[None] for side in (p, q))
            shifts[k] = abs(nearest_mobius(*others)[0][0][0])
        fault = curves[(shifts < shifts.min() + 1e-6).argmax()].name
        raise LandmarkError(
            f"curve {fault!r} pulls the moving disk onto its rim: no room is left for the rest; "
            "check this curve's ends on both sides (or is one side mirrored?), keep them off the "
            "rim, or give curves elsewhere as well"
        )
    return apply_mobius(moving, parameters)


def sample_landmarks(pair, detect=None, sliding=False):
    """The `Problem` of an aligned `SurfacePair`, its `pair` the same with landmarks sampled; where
    only a curve's ends are given, the path between them is detected by `detect`, or else a shortest
    path."""
    held_lines, _ = lines_by_name(pair, pair.held)
    lines, messages = lines_by_name(pair, pair.curves, detect)
    moving = pair.moving
    samples = ()
    if pair.curves:
        lines_moving, lines_control = zip(*lines.values())
        samples = sample_lines(moving, lines_moving), sample_lines(pair.control, lines_control)
    sampled = replace(
        pair, lines=lines, held_lines=held_lines, samples=samples, messages=tuple(messages)
    )
    if "directions" in vars(pair):  # they cost a second, and are the same
        vars(sampled)["directions"] = pair.directions
    if not pair.curves:
        return Problem(moving.disk, [], [], fewest=0, pair=sampled)
    p = samples[0] @ moving.disk.z
    q = samples[1] @ pair.control.disk.z
    # A point that curves share is one landmark of the fit.
    once = distinct_landmarks(pair.curves, p, q)
    return Problem(moving.disk, p[once], q[once], once // POINTS_PER_CURVE, sliding, pair=sampled)


def lines_by_name(pair, curves, detect=None):
    """name -> (moving, control) line of `Curve`s in both disks of a pair, and messages."""
    moving, messages = curve_lines(pair.moving, curves, "moving", detect)
    control, more = curve_lines(pair.control, curves, "control", detect)
    names = [curve.name for curve in curves]
    return dict(zip(names, zip(moving, control))), messages + more


def sample_lines(own, lines):
    """Landmarks of K lines in the disk of a `ParameterizedSurface`: sparse (10 K, V)."""
    stops = np.cumsum([0, *map(len, lines)])
    corners = own.disk.interpolation(np.concatenate(lines))
    parts = [corners[start:stop] for start, stop in pairwise(stops)]
    points = own.surface.vertices
    matrices = [equally_spaced(part @ points, POINTS_PER_CURVE) @ part for part in parts]
    return sparse.vstack(matrices).tocsr()


def distinct_landmarks(curves, p, q):
    """The landmarks of (10 K,) to fit, (k,) int, such that each point counts once; LandmarkError
    where two meet on one side only."""
    meet_p = meeting(p)
    torn = np.argwhere(meet_p != meeting(q))
    if len(torn):
        first, second = (curves[k // POINTS_PER_CURVE].name for k in torn[0])
        side = "moving" if meet_p[tuple(torn[0])] else "control"
        raise LandmarkError(
            f"curves {first!r} and {second!r} share a point on the {side} side only, and a "
            "bijection cannot part points; let them meet on both sides or on neither"
        )
    return np.flatnonzero(~meet_p.any(0))


class Directions(Features):
    """Features that lead from afar: the vertices' places on `crude_sphere`s, as smooth as they
    are, the moving ones after the rotation by which the features at SCALE agree best.

    r: their mean correlation then; mirrored_r, lps_r, mirrored_lps_r: if the moving side is
    mirrored, has x and y negated, as in LPS, or both.
    """

    def __init__(self, features, moving, control):
        self.smoothings, self.disk, self.areas = features.smoothings, features.disk, features.areas
        self.feature_weights = np.ones(3) / 3
        here, there = (
            crude_sphere(surface, side.few(ROUND)[1])
            for surface, side in zip((moving, control), features.smoothings)
        )
        search = RotationSearch(features, there)
        self.mirrored_r, self.lps_r, self.mirrored_lps_r = (
            search.best(here * axes)[0] for axes in ([-1, 1, 1], [-1, -1, 1], [1, -1, 1])
        )
        self.r, rotated = search.best(here)
        self.spheres = rotated, there

    def at(self, sigma):
        """Places on the unit sphere (V, 3) and (W, 3)."""
        return self.spheres

    def compared(self, sigma):
        """The same, and weights (3,)."""
        return *self.spheres, self.feature_weights


class RotationSearch:
    """Rotations of a moving sphere onto a control's (W, 3), tried on POINTS of its vertices."""

    def __init__(self, features, there):
        here, values = features.at(SCALE)
        self.some = np.random.default_rng(0).choice(len(here), POINTS, p=features.areas)
        few, _ = features.smoothings[1].few(SCALE)
        self.here, self.values = here[self.some] * features.feature_weights / POINTS, values[few]
        # Many rotations ask for the nearest vertex to each cell of a grid on the sphere.
        cells = np.indices((2 * CELLS + 1,) * 3).reshape(3, -1).T / CELLS - 1
        near = abs(np.linalg.norm(cells, axis=1) - 1) < 1 / CELLS
        self.nearest = np.zeros(len(cells), int)
        self.nearest[near] = scipy.spatial.KDTree(there[few]).query(cells[near])[1]

    def best(self, sphere):
        """The features' correlation after the best rotation of a sphere (V, 3) about the axes of
        space by up to TURNS in all, and the sphere after it."""
        Rotation = scipy.spatial.transform.Rotation
        best, r = Rotation.identity(), -np.inf
        for turn in TURNS:
            # From coarse to fine: a grid of rotations around the best one so far.
            steps = turn * (np.arange(-2, 3) / 2 if turn == TURNS[0] else np.arange(-1, 2) / 2)
            grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
            tried = Rotation.from_euler("xyz", grid, degrees=True) * best
            places = np.einsum("rij,pj->rpi", tried.as_matrix(), sphere[self.some])
            cells = np.rint((places + 1) * CELLS).astype(int)
            nearest = self.nearest[cells @ [(2 * CELLS + 1) ** 2, 2 * CELLS + 1, 1]]
            found = np.einsum("rpc,pc->r", self.values[nearest], self.here)
            if found.max() > r:
                r, best = float(found.max()), tried[int(found.argmax())]
        return r, best.apply(sphere)


def crude_sphere(surface, spread=None):
    """The vertices of a surface cut open at one rim on the unit sphere (V, 3), from their places
    alone.

    A fan closes the rim, and the places follow the closed surface's heat flow to the scale ROUND;
    centred, with deviation 1 along each axis of space, they are taken to the sphere from its
    centre. Sides that lie in space alike lie alike on their spheres, wherever they were cut.
    spread: of `Smoothing.few`, whose vertices then carry the heat.
    """
    count = len(surface.vertices)
    places, fan = closing_fans(surface)
    # A slit's rim may have faces without area in its fan; it needs none.
    slit = len(degenerate_faces(places, fan)) > 0
    closed = surface if slit else Surface(places, np.vstack([surface.faces, fan]))
    areas = closed.vertex_areas / closed.area
    mass, time = sparse.diags_array(areas), ROUND**2 / HEMISPHERE / (2 * HEAT_STEPS)
    places = closed.vertices - areas @ closed.vertices
    flow = mass, time * closed.stiffness, mass @ places
    if spread is None:
        places = heat_flow(*flow, HEAT_STEPS)
    else:
        spread = sparse.block_diag([spread, np.eye(len(places) - count)]).tocsr()
        small = (spread.T @ part @ spread for part in flow[:2])
        places = spread @ heat_flow(*small, spread.T @ flow[2], HEAT_STEPS)
    places = standardised(places, areas)[:count]
    return places / np.maximum(np.linalg.norm(places, axis=1, keepdims=True), np.finfo(float).tiny)


def from_starts(multiresolution, levels, weights, features):
    """The fit of a problem without landmarks, as of `MultiresolutionFit.run`, and a message on its
    start.

    Where two surfaces are cut elsewhere their disks differ by more than a Möbius map, and folds
    lead it into valleys that are not theirs. A second fit begins where `Directions` lead. Unless it
    lies near the first, the one whose objective is lower after the guiding levels goes on. Depth
    and the potential of curvature guide into other valleys still: of the fits by `Features.shares`
    that end more than NEAR apart, the one whose objective is lowest at the FINEST scale of a polar
    mesh goes on.
    """
    z = multiresolution.problem.disk.z
    guiding = [level for level in levels if level.mesh == "nu" and (level.sigma or 0) >= COARSE_MM]
    rest = levels[len(guiding) :]
    if not guiding:
        return multiresolution.run(levels, weights, features=features), ""

    def run(levels, share, resumed=None):
        guide = features.sharing(share)
        return multiresolution.run(levels, weights, features=guide, resumed=resumed)

    def value(fit):
        objective, state, _ = fit
        return objective.value(state, objective.weights.gamma)

    # The crude spheres lead the map from their best Möbius map on.
    directions = multiresolution.problem.pair.directions
    leading = multiresolution.objective(guiding[0], weights, directions)
    nothing = np.zeros(len(leading.coefficient_mesh.mesh.z), complex)
    state = leading.at(nothing, best_by_features(directions, z, PLACED))
    state, _ = run_level(leading, state, guiding[0])
    apart = features.areas @ abs(leading.moved(state) - z)
    usual, *others = features.shares
    start = leading, state
    best = run(guiding, usual, start)
    message = f"by crude spheres, {apart:.2g} in the disk from the best Möbius map of features"

    # Far from the best Möbius map of features: fit from there as well, and take the better of both.
    if apart >= APART:
        other = run(guiding, usual)
        values = [value(one) for one in (best, other)]
        names = ("spheres", "features")
        lower = int(values[1] < values[0])
        best, start = ((best, start), (other, None))[lower]
        message = (
            f"by {names[lower]} (objective {values[lower]:.4g}), not by {names[1 - lower]} "
            f"(objective {values[1 - lower]:.4g})"
        )

    # The other shares guide from the same start; one that ends near an earlier one is left out.
    guided, ends = {usual: best}, [best[0].moved(best[1])]
    for share in others:
        one = run(guiding, share, start)
        end = one[0].moved(one[1])
        if min(features.areas @ abs(end - known) for known in ends) > NEAR:
            guided[share] = one
            ends.append(end)
    if len(guided) > 1:
        # They are judged by one objective, at the finest scale of a polar mesh.
        deciding = [level for level in rest if level.mesh == "nu"]
        if not any(level.sigma == FINEST for level in deciding):
            deciding += feature_levels(multiresolution.problem.disk, GUIDES[-1:])
        for share, one in guided.items():
            objective, state, steps = run(deciding, share, one[:2])
            guided[share] = objective, state, one[2] + steps
        share = min(guided, key=lambda share: value(guided[share]))
        best, rest = guided[share], [level for level in rest if level.mesh != "nu"]
        message += f"; the potential's share {share:g} of {', '.join(f'{one:g}' for one in guided)}"
    objective, state, steps = run(rest, usual, best[:2])
    return (objective, state, best[2] + steps), message
