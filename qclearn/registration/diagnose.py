"""Recognises a suspect registration: wrong landmarks before the fit, and odd maps after it.

`diagnose_landmarks` compares the curves' ends after the best Möbius map with how they would lie
under another `LandmarkHypothesis`: curves swapped or reversed, a mirrored surface, surfaces
exchanged, another numbering. Fewer than three curves do not determine a Möbius map, so the
features align the disks. `out_of_place`, `reasons`, `disagreeing`, `astray`, `worse` judge the rest.
LIMITS are thresholds beside what was measured (book/studies/suspect.py): good | with the mistake.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..plane.linear import face_areas
from ..plane.mobius import mobius, nearest_mobius
from ..surfaces.surface import SurfaceError, closing_fans, places_of
from ..surfaces.units import size_of
from .curves import SIDES
from .features import FOLDS, SCALE, best_by_features, check_features, featured

LIMITS = {
    "error_mm": 3.0,  # mean landmark error, mm, together with the next; 0.05 to 4.1 | 0.3 to 64
    # Share of the error that the best Möbius map leaves; 0.003 to 0.34 | 0.037 to 1.2.
    "error_share": 1 / 3,
    "curve_mm": 5.0,  # error of one curve, mm, together with the next; 0.06 to 8.2 | 0.3 to 95
    "curve_ratio": 5.0,  # times the error of the median curve; 1.0 to 5.8 | 1.0 to 9.2
    "rows": 0.005,  # rows switched, per vertex; 0 to 0.004 | 0 to 0.99
    "strong_mu": 0.9,  # what counts as strong distortion
    "strong_area": 0.01,  # share of the moving surface's area above that; 0 to 0.0013 | 0 to 0.70
    "log2_area": 5.0,  # 95 % of |log2| of areas' ratio; 0.5 to 3.7 | 0.5 to 13
    "log2_area_alone": 8.0,  # the same by one curve and no folds; 0.8 to 6.2 | 0.7 to 13
    # Misfit of the curves that another hypothesis changes, over that as given; 1.2 to 44 | 0.013
    # to 0.34.
    "better": 0.75,
    # The same misfit over the curves' length in the disk; 0.18 to 10 | 0.028 to 0.44.
    "plausible": 1.0,
    # Misfit as given over that length, other surfaces or numbers; 0.013 to 0.78 | 0.55 to 3.9.
    "surface_given": 0.33,
    # Gain of the folds' correlation if the moving side is mirrored; -0.63 to -0.22 | 0.18 to 0.53.
    "hand": 0.1,
    # The folds' correlation after the best Möbius map less that after a quarter or half turn more.
    # Below this, folds judge no curve. Right pairs: 0.35 to 0.89.
    "rotation_contrast": 0.35,
    # Degrees between a curve's ends and their targets, and DOUBLING per doubling of its length, of
    # fewer than three curves; 1 to 41 | 6 to 200, under the limit one in twenty.
    "place": 44.0,
    "axes_r": 0.4,  # folds' r by axes in space, else these judge none; 0.43 to 0.85 | 0.09 to 0.37
    # Rise of the held-out curves' mean distance, with the next; -0.91 to 0.86 | -0.85 to 2.5.
    "worse": 0.1,
    "worse_mm": 0.5,  # the same in mm; -15 to 3.4 | -14 to 15
    # The same of one curve, with 0.1 of its distance before; -13 to 18 | -9.3 to 42.
    "worse_curve_mm": 10.0,
}
DOUBLING = 20.0  # degrees that a curve of twice the length on one side counts
ROUNDING = 1e-9  # in the disk: a misfit of this size is none

# Curves. With fewer, a Möbius map fits wrong ends as well as right ones.
FEWEST = 3
# A further change of the curves' order must bring the misfit of all below this share of it.
STEP = 0.9
LEAST_R = 0.3  # correlation below which features are no guide
# Correlation of a feature after the fit: 0.69 to 0.94 between people, 0.4 to 0.7 where it is lost.
AGREEING_R = 0.7
# Degrees, the mean angle on crude spheres between a place and where the map takes it: 6 to 12
# between people whose curves end within 3.5 mm, 21 to 120 where they end over 10 mm off.
ASTRAY = 16.0
# Above this mean correlation the map is right even if the files' axes disagree, or the walls: 0.86
# to 0.92 where curves end near, 0.5 to 0.81 where they end far off.
SURE_R = 0.85
# Longest side of a triangle over its height: up to 321 in people's surfaces, 1.4e3 to 1e9 in needles
# at which the map folds.
NEEDLE = 1e3
# Ratio of the two gaps' areas, each over its hemisphere's squared length: 1.0 to 1.3 between people
# cut by one rule, 1.48 to 1.6 between FreeSurfer's cortex label and smaller cuts.
WALLS = 1.4
MIRROR = (
    "give --mirror (library: qc.mirror), or leave it out if it was given: one side is a left, the "
    "other a right"
)
LPS = (
    "one file seems to be in LPS, as 3D Slicer and ITK write, and the other in RAS: negate x and y of "
    "the one in LPS"
)


@dataclass(frozen=True)
class LandmarkHypothesis:
    """What the landmarks may mean: ends p (K, 2) of the moving curves in their disk and q of the
    control's.

    order (K,): number of the moving curve in each row; backwards (K,): whether it runs from its
    other end; reason: the message to the user, empty where it follows from order and backwards.
    """

    p: np.ndarray
    q: np.ndarray
    order: np.ndarray
    backwards: np.ndarray
    reason: str = ""


def diagnose_landmarks(pair):
    """Messages on mistakes in surfaces and landmarks that explain folds or curves' ends much better
    than as given, and on one or two curves out of place."""
    if len(pair.curves) >= FEWEST:
        return diagnose_ends(pair)
    # Too few curves: the folds and places in space judge the hand, and the folds lay the disks on
    # each other, unless they fit in any position.
    try:
        pair = with_folds(pair)
    except SurfaceError:  # a surface without folds
        return []
    # Axes of space have a meaning on hemispheres.
    hemispheres = all(size_of(getattr(pair, side).surface).unit for side in SIDES)
    directions = pair.directions
    r, what, advice = max(
        (directions.mirrored_r, "the mirrored moving surface", MIRROR),
        (directions.lps_r, "x and y of the moving surface negated", LPS),
        (directions.mirrored_lps_r, "y of the moving surface negated", f"{LPS}, and {MIRROR}"),
    )
    if hemispheres and r > max(directions.r + LIMITS["hand"], LEAST_R):
        return [f"mirror: the folds fit {what} much better; {advice}"]
    if pair.curves:
        aligned = align_by_folds(pair)
        elsewhere = [*out_of_place(aligned)] if hemispheres else []
        if rotation_contrast(aligned) > LIMITS["rotation_contrast"]:
            # Curves that are known to lie in place are those of no other surfaces.
            known = hemispheres and directions.r > LIMITS["axes_r"]
            return diagnose_ends(aligned, bool(elsewhere) or not known) or elsewhere
        return elsewhere
    return []


def align_by_folds(pair):
    """The pair with the moving disk aligned by its features."""
    disk = pair.moving.disk
    disk = disk.at(mobius(disk.z, *best_by_features(pair.features, disk.z)))
    return replace(pair, moving=replace(pair.moving, disk=disk))


def with_folds(pair):
    """The pair with its features, or else with the folds as these."""
    if pair.features is not None:
        return pair
    maps = check_features(FOLDS, pair.moving.surface, pair.control.surface)
    moving, control, features = featured(pair.moving, pair.control, maps)
    return replace(pair, moving=moving, control=control, features=features)


def rotation_contrast(aligned):
    """How much better the features of an aligned pair correlate than after a quarter or half turn
    more: 0 on a surface of revolution, where they lie on each other in any."""
    z = aligned.moving.disk.z
    given, *turned = (aligned.features.correlation(k * z, SCALE).mean() for k in (1, 1j, -1, -1j))
    return float(given - max(turned))


def out_of_place(aligned):
    """`place:` for curves of a pair aligned by its features that lie elsewhere on the two sides."""
    curves, limit = places_apart(aligned)
    for name, (degrees, doublings) in curves.items():
        if degrees + DOUBLING * doublings > limit:
            yield (
                f"place: the sides of {name!r} lie {degrees:.0f} degrees apart, from the middle of "
                f"the brain, and one is {2**doublings:.1f} times as long; check that the name means "
                "the same sulcus on both, give more curves, or turn the surfaces alike in space"
            )


def places_apart(aligned):
    """Curve -> (degrees, doublings), the mean angle on crude spheres between its ends and their
    targets and |log2| of the ratio of its lengths, over the hemisphere's; and the limit of degrees
    + DOUBLING doublings. The angle is that by folds or by axes in space, whichever is less, or that
    by folds where these are sure. Axes in space that do not agree judge nothing."""
    (here, there), disk, z = aligned.directions.spheres, aligned.control.disk, aligned.moving.disk.z
    sure = aligned.features.correlation(z, SCALE).mean() > SURE_R
    limit = LIMITS["place"] if aligned.directions.r > LIMITS["axes_r"] else np.inf
    curves = {}
    for curve in aligned.curves:
        p, q = (curve.path(side)[[0, -1]] for side in SIDES)
        ways = [disk.interpolate(there, disk.locate(z[p])), *([] if sure else [here[p]])]
        degrees = min(between(places, there[q]).mean() for places in ways)
        lengths = [
            np.linalg.norm(np.subtract(*surface.vertices[ends])) / size_of(surface).length
            for surface, ends in ((aligned.moving.surface, p), (aligned.control.surface, q))
        ]
        doublings = abs(np.subtract(*np.log2(np.maximum(lengths, ROUNDING))))
        curves[curve.name] = float(degrees), float(doublings)
    return curves, ASTRAY if sure else limit


def between(places, there):
    """Degrees between places within the unit sphere (k, 3) and on it (k, 3)."""
    cosines = (places * there).sum(1) / np.maximum(np.linalg.norm(places, axis=1), ROUNDING)
    return np.degrees(np.arccos(np.clip(cosines, -1, 1)))


def diagnose_ends(pair, surfaces=True):
    """Messages on hypotheses, of other surfaces, too, that explain the curves' ends much better."""
    given, messages = given_hypothesis(pair), []
    # First other surfaces, or one change of order.
    others = surface_hypotheses(given, pair) if surfaces else ()
    best = best_hypothesis([given, *others, *order_hypotheses(given)])
    if best.reason and accepted(given, best):
        given, messages = best, [best.reason]
    # Then, with these, one reversal or swap after the other, as long as all ends fit better.
    best, before = given, None
    while best is not before:
        before, best = best, best_hypothesis([best, *order_hypotheses(best)])
    if best is not given and accepted(given, best):
        messages += order_messages(best, [curve.name for curve in pair.curves])
    return messages


def given_hypothesis(pair):
    """The landmarks of a `SurfacePair` as given."""
    p, q = (
        getattr(pair, side).disk.z[[curve.path(side)[[0, -1]] for curve in pair.curves]]
        for side in SIDES
    )
    return LandmarkHypothesis(p, q, np.arange(len(p)), np.zeros(len(p), bool))


def best_hypothesis(hypotheses):
    """The one whose ends fit best; the first unless another is better by a STEP."""
    total = np.sqrt((misfits(hypotheses) ** 2).mean(1))
    total[0] = STEP * total[0] - ROUNDING
    return hypotheses[total.argmin()]


def misfits(hypotheses):
    """Root mean square distance of each curve's ends after each hypothesis's best Möbius map,
    (hypotheses, K); of fewer than FEWEST curves as they lie."""
    p = np.stack([hypothesis.p for hypothesis in hypotheses])
    q = np.stack([hypothesis.q for hypothesis in hypotheses])
    if p.shape[1] < FEWEST:
        off = abs(p - q)
    else:
        _, off = nearest_mobius(p.reshape(len(p), -1), q.reshape(len(q), -1))
        off = off.reshape(p.shape)
    return np.sqrt((off**2).mean(2))


def accepted(given, other):
    """Whether another hypothesis explains the curves that it changes, by LIMITS."""
    ratios = compared(given, other)
    if other.reason and ratios["given"] < LIMITS["surface_given"]:
        return False  # surfaces that share one numbering fit about as well exchanged
    return ratios["better"] < LIMITS["better"] and ratios["plausible"] < LIMITS["plausible"]


def compared(given, other):
    """Misfits of the curves that another hypothesis changes: `given` and `plausible`, as given and
    in that one, over the curves' length in the disk; `better`, over each other."""
    rows = ((given.p != other.p) | (given.q != other.q)).any(1)
    before, after = np.sqrt((misfits([given, other])[:, rows] ** 2).mean(1))
    length = np.sqrt((abs(np.diff(other.q[rows])) ** 2).mean())
    return {
        "better": float(after / (before + ROUNDING)),
        "given": float(before / length),
        "plausible": float(after / length),
    }


def surface_hypotheses(given, pair):
    """Hypotheses in which the surfaces are not those that the landmarks mean."""
    z = {side: getattr(pair, side).disk.z for side in SIDES}
    vertices = {side: np.array([one.path(side)[[0, -1]] for one in pair.curves]) for side in SIDES}
    if len(pair.curves) >= FEWEST:
        reason = f"mirror: the curves fit the mirrored moving surface much better; {MIRROR}"
        yield replace(given, p=given.p.conj(), reason=reason)
    if all(vertices[a].max() < len(z[b]) for a, b in (SIDES, SIDES[::-1])):
        reason = (
            "exchanged: the curves fit much better with MOVING and CONTROL exchanged; exchange "
            'the two surfaces, or "moving" and "control" in the landmarks'
        )
        p, q = z["moving"][vertices["control"]], z["control"][vertices["moving"]]
        yield replace(given, p=p, q=q, reason=reason)
    # The numbers may be those of the whole surfaces, where their vertices are known.
    cut = dict.fromkeys(SIDES)
    for side in SIDES:
        table = getattr(pair, side).surface.original_vertices
        if table is not None:
            places = places_of(vertices[side], table)
            cut[side] = None if (places < 0).any() else places
    for whole in (("moving",), ("control",), SIDES):
        if all(cut[side] is not None for side in whole):
            reason = (
                f"numbering: the {' and '.join(whole)} vertices fit much better as those of the "
                "whole surface, before it was cut open; give the positions of your numbers in "
                "original_vertices, which `qclearn open` keeps"
            )
            p, q = (
                z[side][cut[side]] if side in whole else as_given
                for side, as_given in zip(SIDES, (given.p, given.q))
            )
            yield replace(given, p=p, q=q, reason=reason)


def order_hypotheses(given):
    """Hypotheses in which curves run from their other ends, all or one, or two have each other's
    places."""
    count = len(given.order)
    for rows in (slice(None), *range(count)):
        p, backwards = given.p.copy(), given.backwards.copy()
        p[rows], backwards[rows] = p[rows, ..., ::-1], ~backwards[rows]
        yield replace(given, p=p, backwards=backwards, reason="")
    for two in combinations(range(count), 2):
        rows = np.arange(count)
        rows[list(two)] = two[::-1]
        p, order, backwards = given.p[rows], given.order[rows], given.backwards[rows]
        yield replace(given, p=p, order=order, backwards=backwards, reason="")


def order_messages(hypothesis, names):
    """`reversed:` and `swapped:` for a hypothesis, against the names as given, in their order."""
    messages = []
    turned = [names[k] for k in sorted(hypothesis.order[hypothesis.backwards])]
    if turned:
        messages.append(
            f"reversed: {listed(turned)} {'fit' if len(turned) > 1 else 'fits'} much better run "
            "from the other end; exchange first and last vertex on one side"
        )
    # Each cycle of the order is one group of swapped curves.
    left = dict(enumerate(hypothesis.order.tolist()))
    while left:
        row, cycle = next(iter(left)), []
        while row in left:
            cycle.append(names[row])
            row = left.pop(row)
        if len(cycle) > 1:
            messages.append(
                f"swapped: {listed(cycle)} fit much better with each other's vertices; exchange "
                "their names or their vertices on one side"
            )
    return messages


def listed(names):
    """Names in quotes, with commas and a last 'and'."""
    quoted = [repr(name) for name in names]
    return " and ".join(filter(None, [", ".join(quoted[:-1]), quoted[-1]]))


def differing_walls(moving, control):
    """A message for `fallbacks`, `walls:`, where two hemispheres were cut open by different rules.
    Folds change a surface's area and not its length: the gap's area over the squared length is what
    compares."""
    sizes = [size_of(surface) for surface in (moving, control)]
    if not all(size.unit for size in sizes):
        return
    here, there = (
        face_areas(*closing_fans(surface)).sum() / size.length**2
        for surface, size in zip((moving, control), sizes)
    )
    if max(here, there) > WALLS * min(here, there):
        larger, smaller = SIDES if here > there else SIDES[::-1]
        ratio = max(here, there) / min(here, there)
        yield (
            f"walls: the gap at the medial wall is {ratio:.1f} times as large on the {larger} as "
            f"on the {smaller} side; cut both by one rule (?h.cortex.label), or give {FEWEST} "
            "curves or more, and hold out another beside it"
        )


def reasons(moving, rows, fit, log2_area, folds):
    """Why the `CheckedMap` of a moving surface, rows from `error_rows`, is suspect, messages:
    `error:`, `curve:`, `rows:`, `distortion:`, `areas:`. log2_area: 95 %; folds: fitted, too."""
    # The map leaves the landmarks far from their targets.
    errors = np.array([row["landmark_error_mm"] for row in rows])
    if rows:
        before, after = (
            np.mean([row[key] for row in rows])
            for key in ("landmark_error_before", "landmark_error")
        )
        share = after / max(before, ROUNDING)
        if errors.mean() > LIMITS["error_mm"] and share > LIMITS["error_share"]:
            yield (
                f"error: the landmarks end {errors.mean():.1f} mm from their targets on average, "
                f"and {100 * share:.0f} % of what the best Möbius map leaves stays; check the "
                "curves, or raise gamma if it was lowered"
            )

    # One curve ends far from its target, and the others do not.
    for row, error in zip(rows, errors):
        median = np.median(errors)
        if error > LIMITS["curve_mm"] and error > LIMITS["curve_ratio"] * median:
            yield (
                f"curve: {row['name']!r} ends {error:.1f} mm from its target, the median curve "
                f"{median:.1f} mm; check its vertices, their order and its name, or leave it out"
            )

    # The map had to be repaired at many vertices: needles, landmarks or features ask for folds.
    count = len(moving.vertices)
    if fit.switched > LIMITS["rows"] * count:
        corners, numbers = moving.vertices[moving.faces], moving.original_vertices
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
        aspect = longest**2 / np.maximum(2 * moving.face_areas, np.finfo(float).tiny)
        needles = np.argsort(-aspect)[: (aspect > NEEDLE).sum()]
        first = moving.faces[needles[:3]]
        first = first.tolist() if numbers is None else numbers[first].tolist()
        causes = [
            f"needle triangles of the moving surface ask for it ({len(needles)}, up to "
            f"{aspect.max():.0e} times as long as high; the first have the vertices {first}): merge "
            "their near ends, or mesh the surface anew",
            "the landmarks are probably wrong: check the order, the names and the ends of the curves",
        ]
        causes = [cause for cause, found in zip(causes, (len(needles), rows)) if found]
        advice = "the features ask for folds: smooth a noisy surface first, or lower delta"
        yield (
            f"rows: the map folded and was repaired at {fit.switched} of {count} vertices; "
            f"{'; or '.join(causes) or advice}"
        )

    # Much of the surface is stretched beyond what folding explains.
    strong = moving.face_areas[abs(fit.mu) > LIMITS["strong_mu"]].sum() / moving.area
    if strong > LIMITS["strong_area"]:
        yield (
            f"distortion: |mu| is over {LIMITS['strong_mu']} on {100 * strong:.1f} % of the moving "
            f"surface; {'check the curves, or lower gamma' if rows else 'smooth it, or lower delta'}"
        )

    # Areas change as no right map changes them.
    if log2_area > LIMITS["log2_area_alone" if len(rows) == 1 and not folds else "log2_area"]:
        yield (
            f"areas: on 5 % of the moving surface they change over {2**log2_area:.0f}-fold; check "
            "that each name means the same curve on both sides, or give more curves"
        )


def disagreeing(features, f, fitted, walls=()):
    """`features:` where the `Features` of both sides are of opposite sign after a Möbius map f
    (V,), or hardly agree there nor after the fitted map (V,). walls: of `differing_walls`, the
    likely cause."""
    sign = "negate one side (FreeSurfer's curv is the negative of ours, its sulc is not)"
    advice = (
        "check that both show the same thing, smooth noise first, give a curve or two, or negate "
        "one side"
    )
    if walls:
        sign = advice = "probably because of the different walls; cut both by one rule first"
    r = dict(zip(features.names, features.correlation(f, SCALE)))
    after = dict(zip(features.names, features.correlation(fitted, SCALE)))
    against = [name for name, value in r.items() if value < -LEAST_R]
    hardly = [name for name in r if abs(r[name]) <= LEAST_R and after[name] < AGREEING_R]
    if against:
        yield (
            f"features: {listed(against)} of the two sides {'are' if len(against) > 1 else 'is'} "
            f"of opposite sign (r = {min(r.values()):.2f}); {sign}"
        )
    if hardly:
        least = min(abs(r[name]) for name in hardly)
        yield (
            f"features: {listed(hardly)} of the two sides hardly "
            f"{'agree' if len(hardly) > 1 else 'agrees'} (r = {least:.2f} at {SCALE:g} mm after "
            f"the best Möbius map); {advice}"
        )


def astray(pair, f, walls=()):
    """`features:` where the folds that led the map f (V,) of a `SurfacePair` do not agree so well
    that it is right, and it takes the surface far from its place in space or there are `walls`, of
    `differing_walls`."""
    here, there = pair.directions.spheres
    disk, features = pair.control.disk, pair.features
    degrees = features.areas @ between(disk.interpolate(there, disk.locate(f)), here)
    r = features.correlation(f, SCALE).mean()
    if r >= SURE_R:
        return
    if degrees > ASTRAY:
        yield (
            f"features: the map takes the surface {degrees:.0f} degrees on average from its place "
            f"in space, and the features agree little (r = {r:.2f} at {SCALE:g} mm): the fit began "
            "in a wrong place; give a landmark curve or two, or turn the surfaces alike in space "
            "(3D Slicer's files are in LPS, with x and y negated)"
        )
    elif walls:
        yield (
            f"features: between walls cut so differently they may have led the map astray (r = {r:.2f} "
            f"at {SCALE:g} mm, less than {SURE_R}); cut both by one rule first, or give {FEWEST} curves"
        )


def worse(held_out_mm, folds):
    """`worse:` where held-out curves fit clearly worse than after the Möbius map. folds: fitted."""
    if not held_out_mm:
        return
    mean = np.mean(list(held_out_mm.values()), axis=0)
    rows = [("the held-out curves end", "their targets on average", mean, "worse_mm")]
    rows += [
        (f"{name!r} ends", "its target", both, "worse_curve_mm")
        for name, both in held_out_mm.items()
    ]
    facts = [
        f"{what} {after:.1f} mm from {where} ({before:.1f} after the best Möbius map)"
        for what, where, (before, after), least in rows
        if after > (1 + LIMITS["worse"]) * before and after - before > LIMITS[least]
    ]
    if facts:
        yield (
            f"worse: {', and '.join(facts)}; check what was fitted, lower "
            f"{'delta or gamma' if folds else 'gamma'}, or give a landmark curve there"
        )
