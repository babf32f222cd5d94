"""What makes a registration suspect: mistakes in its landmarks, and maps that good landmarks do not lead to.

Under the right explanation of a mistake (the moving surface mirrored, two curves swapped, ...) the curves' ends fit
much better after their best Möbius map. A reason is one text: a fixed word, what was found, and what to do.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..plane.mobius import mobius_misfits
from .metrics import mean_rows

# Beside each threshold, from kept/suspect.json: the range in good cases | with a mistake, which need not pass them all.
LIMITS = {
    "error_mm": 3.0,  # mean landmark error, mm, together with the next; 0.05 to 4.1 | 3.0 to 64
    "error_share": 1 / 3,  # of the error that the best Möbius map leaves; 0.003 to 0.20 | 0.25 to 1.2
    "curve_mm": 5.0,  # error of one curve, mm, together with the next; 0.1 to 8.2 | 9.4 to 95
    "curve_ratio": 5.0,  # times the error of the median curve; 1.1 to 5.8 | 1.0 to 9.2
    "rows": 0.005,  # rows switched, per vertex; 0 to 0.004 | 0 to 0.99
    "strong_mu": 0.9,  # what counts as strong distortion
    "strong_area": 0.01,  # share of the moving surface's area above that; 0 to 0.0013 | 0 to 0.70
    "better": 0.75,  # misfit of the curves concerned in another reading, over that as given; 1.75 to 43 | 0.036 to 0.34
    "plausible": 1.0,  # the same misfit over the curves' length in the disk; 0.36 to 3.6 | 0.031 to 0.38
    "surface_given": 0.33,  # misfit as given over that length, other surfaces or numbers; 0.013 to 0.28 | 0.55 to 3.0
}
LEAST_R, COARSEST = 0.3, 16.0  # correlation below which features are no guide, and the scale in mm it is measured at
FEWEST = 3  # curves: with fewer, a Möbius map takes wrong ends to wrong ends as well as right ones to right ones
STEP = 0.9  # of the misfit of all curves: what a further change of their order must come below
ROUNDING = 1e-9  # in the disk: a misfit of this size is none


@dataclass(frozen=True)
class Reading:
    """One way to read the landmarks: ends p (K, 2) of the moving curves in their disk and q of the control's.

    order (K,): number of the moving curve in each row; backwards (K,): whether it runs from its other end; reason:
    words for the reading, empty where order and backwards tell.
    """

    p: np.ndarray
    q: np.ndarray
    order: np.ndarray
    backwards: np.ndarray
    reason: str = ""


def reasons(sides, rows, fit):
    """Texts on why a registration of two `Sides`, rows from `error_rows`, a `CertifiedMap`, is suspect."""
    errors = [*large_error(mean_rows(rows)), *odd_curves(rows)] if rows else []
    moving = sides.moving.surface
    return [*mistakes(sides), *errors, *switched_rows(fit, moving), *strong_distortion(moving, fit.mu)]


def disagreeing(features, f):
    """`features:` where the `Features` of both sides hardly agree, or not in sign, after a Möbius map f (V,)."""
    r = dict(zip(features.names, features.correlation(f, COARSEST)))
    against = [name for name, value in r.items() if value < -LEAST_R]
    hardly = [name for name, value in r.items() if abs(value) <= LEAST_R]
    if against:
        yield (
            f"features: {listed(against)} of the two sides {'are' if len(against) > 1 else 'is'} of opposite sign (r = "
            f"{min(r.values()):.2f}); negate one side (FreeSurfer's curv is the negative of ours, its sulc is not)"
        )
    if hardly:
        yield (
            f"features: {listed(hardly)} of the two sides hardly {'agree' if len(hardly) > 1 else 'agrees'} (r = "
            f"{min(abs(r[name]) for name in hardly):.2f} at {COARSEST:g} mm after the best Möbius map); check that "
            "both show the same thing, smooth a noisy surface first, give a landmark curve or two, or negate one side"
        )


def large_error(means):
    """`error:` where the map leaves the landmarks far from their targets."""
    found, share = means["landmark_error_mm"], means["landmark_error"] / max(means["landmark_error_before"], ROUNDING)
    if found > LIMITS["error_mm"] and share > LIMITS["error_share"]:
        yield (
            f"error: the landmarks end {found:.1f} mm from their targets on average, and {100 * share:.0f} % of what "
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


def mistakes(sides):
    """Words on mistakes in surfaces and landmarks that explain the curves' ends much better than as given."""
    if len(sides.entries) < FEWEST:
        return []
    start, words = given_reading(sides), []
    best = best_reading([start, *of_surfaces(start, sides), *of_order(start)])
    if best.reason and accepted(start, best):
        start, words = best, [best.reason]
    best = in_order(start)
    if best is not start and accepted(start, best):
        words += order_words(best, [entry["name"] for entry in sides.entries])
    return words


def given_reading(sides):
    """The landmarks of two `Sides` as given."""
    p, q = (getattr(sides, side).disk.z[ends(sides.entries, side)] for side in ("moving", "control"))
    return Reading(p, q, np.arange(len(p)), np.zeros(len(p), bool))


def ends(entries, side):
    """First and last vertices of the curves of one side, (K, 2) int."""
    return np.array([entry[side][[0, -1]] for entry in entries])


def in_order(reading):
    """The reading after one reversal or swap after the other, as long as all ends fit better by a STEP."""
    while (best := best_reading([reading, *of_order(reading)])) is not reading:
        reading = best
    return reading


def best_reading(readings):
    """The reading whose ends fit best; the first one unless another is better by a STEP."""
    total = np.sqrt((misfits(readings) ** 2).mean(1))
    total[0] = STEP * total[0] - ROUNDING
    return readings[total.argmin()]


def misfits(readings):
    """Root mean square distance of each curve's ends after each reading's best Möbius map, (readings, K)."""
    p, q = (np.stack([getattr(reading, side) for reading in readings]) for side in ("p", "q"))
    off = mobius_misfits(p.reshape(len(p), -1), q.reshape(len(q), -1)).reshape(p.shape)
    return np.sqrt((off**2).mean(2))


def accepted(given, other):
    """Whether another reading explains the curves that it reads otherwise, by LIMITS."""
    found = compared(given, other)
    if other.reason and found["given"] < LIMITS["surface_given"]:
        return False  # surfaces that share one numbering fit about as well exchanged
    return found["better"] < LIMITS["better"] and found["plausible"] < LIMITS["plausible"]


def compared(given, other):
    """Misfits of the curves that another reading reads otherwise: `given` and `plausible`, as given and in that one,
    over the curves' length in the disk; `better`, over each other."""
    rows = ((given.p != other.p) | (given.q != other.q)).any(1)
    before, after = np.sqrt((misfits([given, other])[:, rows] ** 2).mean(1))
    length = np.sqrt((abs(np.diff(other.q[rows])) ** 2).mean())
    found = {"better": after / (before + ROUNDING), "given": before / length, "plausible": after / length}
    return {name: float(value) for name, value in found.items()}


def of_surfaces(reading, sides):
    """Readings in which the surfaces are not those that the landmarks mean."""
    z_moving, z_control = sides.moving.disk.z, sides.control.disk.z
    reason = (
        "mirror: the curves fit the mirrored moving surface much better; give --mirror (library: qc.mirror), or leave "
        "it out if it was given: one side is a left, the other a right"
    )
    yield replace(reading, p=reading.p.conj(), reason=reason)
    pairs = {side: ends(sides.entries, side) for side in ("moving", "control")}
    if pairs["control"].max() < len(z_moving) and pairs["moving"].max() < len(z_control):
        reason = (
            "exchanged: the curves fit much better with MOVING and CONTROL exchanged; exchange the two surfaces, or "
            '"moving" and "control" in the landmarks'
        )
        yield replace(reading, p=z_moving[pairs["control"]], q=z_control[pairs["moving"]], reason=reason)
    cut = {side: cut_numbers(getattr(sides, side).surface, numbers) for side, numbers in pairs.items()}
    for read in (("moving",), ("control",), ("moving", "control")):
        if all(cut[side] is not None for side in read):
            reason = (
                f"numbering: the {' and '.join(read)} vertices fit much better as those of the whole surface, before "
                "it was cut open; give the positions of your numbers in original_vertices, which `qclearn open` keeps"
            )
            p = z_moving[cut["moving"]] if "moving" in read else reading.p
            q = z_control[cut["control"]] if "control" in read else reading.q
            yield replace(reading, p=p, q=q, reason=reason)


def cut_numbers(surface, numbers):
    """Vertices of the cut surface from those of the whole one; None without a table or where one is missing."""
    table = surface.original_vertices
    if table is None or not np.isin(numbers, table).all():
        return None
    order = np.argsort(table)
    return order[np.searchsorted(table, numbers, sorter=order)]


def of_order(reading):
    """Readings in which curves run from their other ends, all or one, or two have each other's places."""
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


def order_words(reading, names):
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
