"""Thresholds of a suspect registration, each beside what was measured (book/studies/suspect.py)."""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..plane.mobius import nearest_mobius
from ..surfaces.surface import SurfaceError
from .features import FOLDS, SCALE, align_by_features, check_features, featured, mirrored_gain
from .metrics import mean_rows

LIMITS = {
    "error_mm": 3.0,  # mean landmark error, mm, together with the next; 0.05 to 4.1 | 0.3 to 64
    "error_share": 1
    / 3,  # of the error that the best Möbius map leaves; 0.003 to 0.34 | 0.037 to 1.2
    "curve_mm": 5.0,  # error of one curve, mm, together with the next; 0.06 to 8.2 | 0.3 to 95
    "curve_ratio": 5.0,  # times the error of the median curve; 1.0 to 5.8 | 1.0 to 9.2
    "rows": 0.005,  # rows switched, per vertex; 0 to 0.004 | 0 to 0.99
    "strong_mu": 0.9,  # what counts as strong distortion
    "strong_area": 0.01,  # share of the moving surface's area above that; 0 to 0.0013 | 0 to 0.70
    # Misfit of the curves concerned in another reading, over that as given; 1.2 to 44 | 0.013 to
    # 0.34.
    "better": 0.75,
    # The same misfit over the curves' length in the disk; 0.18 to 10 | 0.028 to 0.44.
    "plausible": 1.0,
    # Misfit as given over that length, other surfaces or numbers; 0.013 to 0.78 | 0.55 to 3.9.
    "surface_given": 0.33,
    # Gain of the folds' correlation if the moving side is mirrored; -0.63 to -0.22 | 0.18 to 0.53.
    "hand": 0.1,
    # The same over that after a quarter or half turn more: below, folds judge no curve; 0.35 to
    # 0.89.
    "rotation_contrast": 0.35,
    # Rise of the held-out curves' mean distance, with the next; -0.91 to 0.86 | -0.85 to 2.5.
    "worse": 0.1,
    "worse_mm": 0.5,  # the same in mm; -15 to 3.4 | -14 to 15
    # The same of one curve, with 0.1 of its distance before; -13 to 18 | -9.3 to 42.
    "worse_curve_mm": 10.0,
    # Loss of the annotations' Dice, as a share of it; -0.84 to 0.23 | -0.85 to 0.71.
    "worse_dice": 0.05,
}
ROUNDING = 1e-9  # in the disk: a misfit of this size is none


# Curves: with fewer, a Möbius map takes wrong ends to wrong ends as well as right ones to right
# ones.
FEWEST = 3
STEP = 0.9  # of the misfit of all curves: what a further change of their order must come below
MIRROR = "give --mirror (library: qc.mirror), or leave it out if it was given: one side is a left, the other a right"


@dataclass(frozen=True)
class LandmarkHypothesis:
    """One way to read the landmarks: ends p (K, 2) of the moving curves in their disk and q of the
    control's.

    order (K,): number of the moving curve in each row; backwards (K,): whether it runs from its
    other end; reason: words for the reading, empty where order and backwards tell.
    """

    p: np.ndarray
    q: np.ndarray
    order: np.ndarray
    backwards: np.ndarray
    reason: str = ""


def diagnose_landmarks(sides):
    """Words on mistakes in surfaces and landmarks that explain folds or curves' ends much better
    than as given."""
    if len(sides.curves) >= FEWEST:
        return diagnose_ends(sides)
    laid = laid_by_folds(sides)
    if laid is None:
        return []
    if mirrored_gain(laid.moving, laid.control) > LIMITS["hand"]:
        return [f"mirror: the folds fit the mirrored moving surface much better; {MIRROR}"]
    return (
        diagnose_ends(laid)
        if sides.curves and rotation_contrast(laid) > LIMITS["rotation_contrast"]
        else []
    )


def laid_by_folds(sides):
    """The sides with the moving one laid upon the control's by its features, or else by its folds;
    None without any."""
    if not sides.curves:
        return sides
    try:
        sides = with_folds(sides)
    except SurfaceError:  # a surface without folds
        return None
    disk = sides.moving.disk
    return replace(
        sides, moving=replace(sides.moving, disk=disk.at(align_by_features(sides.features, disk.z)))
    )


def with_folds(sides):
    """The sides with their features, or else with the folds as these."""
    if sides.features is not None:
        return sides
    maps = check_features(FOLDS, sides.moving.surface, sides.control.surface)
    moving, control, features = featured(sides.moving, sides.control, maps)
    return replace(sides, moving=moving, control=control, features=features)


def rotation_contrast(laid):
    """How much better the features correlate than after a quarter or half turn more: 0 on a surface
    of revolution, where they lie upon each other in any."""
    z = laid.moving.disk.z
    given, *turned = (
        laid.features.correlation(turn * z, SCALE).mean() for turn in (1, 1j, -1, -1j)
    )
    return float(given - max(turned))


def diagnose_ends(sides):
    """Words on readings of the landmarks that explain the curves' ends much better than as given."""
    start, words = given_hypothesis(sides), []
    best = best_hypothesis([start, *of_surfaces(start, sides), *of_order(start)])
    if best.reason and accepted(start, best):
        start, words = best, [best.reason]
    best = in_order(start)
    if best is not start and accepted(start, best):
        words += order_messages(best, [curve.name for curve in sides.curves])
    return words


def given_hypothesis(sides):
    """The landmarks of two `SurfacePair` as given."""
    p, q = (getattr(sides, side).disk.z[ends(sides.curves, side)] for side in ("moving", "control"))
    return LandmarkHypothesis(p, q, np.arange(len(p)), np.zeros(len(p), bool))


def ends(curves, side):
    """First and last vertices of the `Curve`s of one side, (K, 2) int."""
    return np.array([curve.path(side)[[0, -1]] for curve in curves])


def in_order(reading):
    """The reading after one reversal or swap after the other, as long as all ends fit better by a
    STEP."""
    while (best := best_hypothesis([reading, *of_order(reading)])) is not reading:
        reading = best
    return reading


def best_hypothesis(readings):
    """The reading whose ends fit best; the first one unless another is better by a STEP."""
    total = np.sqrt((misfits(readings) ** 2).mean(1))
    total[0] = STEP * total[0] - ROUNDING
    return readings[total.argmin()]


def misfits(readings):
    """Root mean square distance of each curve's ends after each reading's best Möbius map,
    (readings, K); of fewer than FEWEST curves as they lie."""
    p, q = (np.stack([getattr(reading, side) for reading in readings]) for side in ("p", "q"))
    few = p.shape[1] < FEWEST
    off = (
        abs(p - q)
        if few
        else nearest_mobius(p.reshape(len(p), -1), q.reshape(len(q), -1))[1].reshape(p.shape)
    )
    return np.sqrt((off**2).mean(2))


def accepted(given, other):
    """Whether another reading explains the curves that it reads otherwise, by LIMITS."""
    found = compared(given, other)
    if other.reason and found["given"] < LIMITS["surface_given"]:
        return False  # surfaces that share one numbering fit about as well exchanged
    return found["better"] < LIMITS["better"] and found["plausible"] < LIMITS["plausible"]


def compared(given, other):
    """Misfits of the curves that another reading reads otherwise: `given` and `plausible`, as given
    and in that one, over the curves' length in the disk; `better`, over each other."""
    rows = ((given.p != other.p) | (given.q != other.q)).any(1)
    before, after = np.sqrt((misfits([given, other])[:, rows] ** 2).mean(1))
    length = np.sqrt((abs(np.diff(other.q[rows])) ** 2).mean())
    found = {
        "better": after / (before + ROUNDING),
        "given": before / length,
        "plausible": after / length,
    }
    return {name: float(value) for name, value in found.items()}


def of_surfaces(reading, sides):
    """Readings in which the surfaces are not those that the landmarks mean."""
    z_moving, z_control = sides.moving.disk.z, sides.control.disk.z
    if len(sides.curves) >= FEWEST:
        reason = f"mirror: the curves fit the mirrored moving surface much better; {MIRROR}"
        yield replace(reading, p=reading.p.conj(), reason=reason)
    pairs = {side: ends(sides.curves, side) for side in ("moving", "control")}
    if pairs["control"].max() < len(z_moving) and pairs["moving"].max() < len(z_control):
        reason = (
            "exchanged: the curves fit much better with MOVING and CONTROL exchanged; exchange "
            "the two surfaces, or "
            '"moving" and "control" in the landmarks'
        )
        yield replace(
            reading, p=z_moving[pairs["control"]], q=z_control[pairs["moving"]], reason=reason
        )
    cut = {
        side: cut_numbers(getattr(sides, side).surface, numbers) for side, numbers in pairs.items()
    }
    for read in (("moving",), ("control",), ("moving", "control")):
        if all(cut[side] is not None for side in read):
            reason = (
                f"numbering: the {' and '.join(read)} vertices fit much better as those of the "
                "whole surface, before "
                "it was cut open; give the positions of your numbers in original_vertices, which "
                "`qclearn open` keeps"
            )
            p = z_moving[cut["moving"]] if "moving" in read else reading.p
            q = z_control[cut["control"]] if "control" in read else reading.q
            yield replace(reading, p=p, q=q, reason=reason)


def cut_numbers(surface, numbers):
    """Vertices of the cut surface from those of the whole one; None without a table or where one is
    missing."""
    table = surface.original_vertices
    if table is None or not np.isin(numbers, table).all():
        return None
    order = np.argsort(table)
    return order[np.searchsorted(table, numbers, sorter=order)]


def of_order(reading):
    """Readings in which curves run from their other ends, all or one, or two have each other's
    places."""
    count = len(reading.order)
    for rows in (slice(None), *range(count)):
        p, backwards = reading.p.copy(), reading.backwards.copy()
        p[rows], backwards[rows] = p[rows, ..., ::-1], ~backwards[rows]
        yield replace(reading, p=p, backwards=backwards, reason="")
    for pair in combinations(range(count), 2):
        rows = np.arange(count)
        rows[list(pair)] = pair[::-1]
        p, order, backwards = reading.p[rows], reading.order[rows], reading.backwards[rows]
        yield replace(reading, p=p, order=order, backwards=backwards, reason="")


def order_messages(reading, names):
    """`reversed:` and `swapped:` for a reading, against the names as given, in their order."""
    words, left = [], dict(enumerate(reading.order.tolist()))
    turned = [names[k] for k in sorted(reading.order[reading.backwards])]
    if turned:
        found = f"reversed: {listed(turned)} {'fit' if len(turned) > 1 else 'fits'} much better run from the other end"
        words.append(f"{found}; exchange first and last vertex on one side")
    while left:
        row, cycle = next(iter(left)), []
        while row in left:
            cycle.append(names[row])
            row = left.pop(row)
        if len(cycle) > 1:
            found = f"swapped: {listed(cycle)} fit much better with each other's vertices"
            words.append(f"{found}; exchange their names or their vertices on one side")
    return words


def listed(names):
    """Names in quotes, with commas and a last 'and'."""
    quoted = [repr(name) for name in names]
    return " and ".join(filter(None, [", ".join(quoted[:-1]), quoted[-1]]))


LEAST_R, COARSEST = (
    0.3,
    16.0,
)  # correlation below which features are no guide, and the scale in mm it is measured at


def reasons(moving, rows, fit):
    """Texts on why the `CertifiedMap` of a moving surface, rows from `error_rows`, is suspect."""
    errors = [*large_error(mean_rows(rows)), *odd_curves(rows)] if rows else []
    return [*errors, *switched_rows(fit, moving), *strong_distortion(moving, fit.mu)]


def disagreeing(features, f):
    """`features:` where the `Features` of both sides hardly agree, or not in sign, after a Möbius
    map f (V,)."""
    r = dict(zip(features.names, features.correlation(f, COARSEST)))
    against = [name for name, value in r.items() if value < -LEAST_R]
    hardly = [name for name, value in r.items() if abs(value) <= LEAST_R]
    if against:
        yield (
            f"features: {listed(against)} of the two sides {'are' if len(against) > 1 else 'is'} "
            "of opposite sign (r = "
            f"{min(r.values()):.2f}); negate one side (FreeSurfer's curv is the negative of ours, "
            "its sulc is not)"
        )
    if hardly:
        yield (
            f"features: {listed(hardly)} of the two sides hardly "
            f"{'agree' if len(hardly) > 1 else 'agrees'} (r = "
            f"{min(abs(r[name]) for name in hardly):.2f} at {COARSEST:g} mm after the best Möbius "
            "map); check that "
            "both show the same thing, smooth a noisy surface first, give a landmark curve or "
            "two, or negate one side"
        )


def large_error(means):
    """`error:` where the map leaves the landmarks far from their targets."""
    found, share = (
        means["landmark_error_mm"],
        means["landmark_error"] / max(means["landmark_error_before"], ROUNDING),
    )
    if found > LIMITS["error_mm"] and share > LIMITS["error_share"]:
        yield (
            f"error: the landmarks end {found:.1f} mm from their targets on average, and "
            f"{100 * share:.0f} % of what "
            "the best Möbius map leaves stays; check the curves, or raise gamma if it was lowered"
        )


def odd_curves(rows):
    """`curve:` where one curve ends far from its target and the others do not."""
    errors = np.array([row["landmark_error_mm"] for row in rows])
    median = np.median(errors)
    for row, error in zip(rows, errors):
        if error > LIMITS["curve_mm"] and error > LIMITS["curve_ratio"] * median:
            found = f"curve: {row['name']!r} ends {error:.1f} mm from its target, the median curve {median:.1f} mm"
            yield f"{found}; check its vertices, their order and its name, or leave it out"


def switched_rows(fit, surface):
    """`rows:` where the `CertifiedMap` of a surface had to be repaired at many vertices."""
    count = len(surface.vertices)
    if fit.switched > LIMITS["rows"] * count:
        found = f"rows: the map folded and was repaired at {fit.switched} of {count} vertices"
        yield f"{found}; no good landmarks ask for that: check the order, the names and the ends of the curves"


def strong_share(moving, mu):
    """Share of the moving surface's area with |mu| over LIMITS["strong_mu"]."""
    return float(moving.face_areas[abs(mu) > LIMITS["strong_mu"]].sum() / moving.area)


def strong_distortion(moving, mu):
    """`distortion:` where much of the surface is stretched beyond what folding explains."""
    share = strong_share(moving, mu)
    if share > LIMITS["strong_area"]:
        found = f"distortion: |mu| is over {LIMITS['strong_mu']} on {100 * share:.1f} % of the moving surface"
        yield f"{found}; check the curves, or lower gamma"


def worse(held_out_mm, dice):
    """`worse:` where held-out curves, or annotations by their `dice`, fit clearly worse than after
    the Möbius map."""
    rise, found = 1 + LIMITS["worse"], []
    before, after = np.mean(list(held_out_mm.values()), axis=0) if held_out_mm else (0.0, 0.0)
    if after > rise * before and after - before > LIMITS["worse_mm"]:
        found.append(
            f"the held-out curves end {after:.1f} mm from their targets on average ({before:.1f}"
        )
    for name, (before, after) in held_out_mm.items():
        if after > rise * before and after - before > LIMITS["worse_curve_mm"]:
            found.append(f"{name!r} ends {after:.1f} mm from its target ({before:.1f}")
    if dice and dice["after"] < (1 - LIMITS["worse_dice"]) * dice["before"]:
        found.append(f"the annotations' Dice is {dice['after']:.2f} ({dice['before']:.2f}")
    if found:
        found = ", and ".join(f"{one} after the best Möbius map)" for one in found)
        yield f"worse: {found}; check what was fitted, lower delta or gamma, or give a landmark curve there"
