"""What makes a registration suspect: mistakes that the landmarks betray, and maps that good landmarks do not lead to.

A mistake is looked for before anything is registered: under the right explanation (the moving surface mirrored, a curve
run from its other end, two curves swapped, ...) the curves' ends fit much better after their best Möbius map. Every
reason is one text: a fixed word, what was found, at which curves, and what to do.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..plane.mobius import mobius_misfits
from .metrics import mean_rows

# The thresholds. Beside each what tools/suspect.py measured: the range in good cases | in cases with a mistake,
# which need not pass each of them. Every single value is in kept/suspect.json.
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

    order (K,): the number of the moving curve that stands in each row; backwards (K,): whether it runs from its other
    end; reason: the words for the reading, empty where order and backwards tell.
    """

    p: np.ndarray
    q: np.ndarray
    order: np.ndarray
    backwards: np.ndarray
    reason: str = ""


def reasons(sides, rows, fit):
    """Why a registration of two `Sides` is suspect: texts, each with its fixed word first; [] where nothing is.

    rows: the landmark errors of `error_rows`; fit: the `CertifiedMap`.
    """
    return [
        *mistakes(sides),
        *(large_error(mean_rows(rows)) if rows else ()),
        *(odd_curves(rows) if rows else ()),
        *switched_rows(fit, sides.moving.surface),
        *strong_distortion(sides.moving.surface, fit.mu),
    ]


def disagreeing(features, f):
    """`features:` where the `Features` of both sides hardly agree, or not in sign, after a Möbius map f (V,)."""
    r = dict(zip(features.names, features.correlation(f, COARSEST)))
    against = [name for name, value in r.items() if value < -LEAST_R]
    hardly = [name for name, value in r.items() if abs(value) <= LEAST_R]
    if against:
        yield (
            f"features: {listed(against)} of the two sides {'are' if len(against) > 1 else 'is'} of opposite sign "
            f"(r = {min(r.values()):.2f}); negate one side (FreeSurfer's curv is the negative of ours, "
            "its sulc is not)"
        )
    if hardly:
        yield (
            f"features: {listed(hardly)} of the two sides hardly {'agree' if len(hardly) > 1 else 'agrees'} (r = "
            f"{min(abs(r[name]) for name in hardly):.2f} at {COARSEST:g} mm after the best Möbius map); check that "
            "both show the same thing, that a noisy surface is smoothed first, or give a landmark curve or two, or "
            "negate one side"
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
            yield (
                f"curve: {row['name']!r} ends {error:.1f} mm from its target, the median curve {median:.1f} mm; check "
                "its vertices, their order and its name, or leave it out"
            )


def switched_rows(fit, surface):
    """`rows:` where the `CertifiedMap` of a surface had to be repaired at many vertices."""
    n_vertices = len(surface.vertices)
    if fit.switched > LIMITS["rows"] * n_vertices:
        yield (
            f"rows: the map folded and was repaired at {fit.switched} of {n_vertices} vertices; no good landmarks ask "
            "for that: check the order, the names and the ends of the curves"
        )


def strong_share(moving, mu):
    """Share of the moving surface's area with |mu| over LIMITS["strong_mu"]."""
    return float(moving.face_areas[abs(mu) > LIMITS["strong_mu"]].sum() / moving.area)


def strong_distortion(moving, mu):
    """`distortion:` where much of the surface is stretched beyond what folding explains."""
    share = strong_share(moving, mu)
    if share > LIMITS["strong_area"]:
        yield (
            f"distortion: |mu| is over {LIMITS['strong_mu']} on {100 * share:.1f} % of the moving surface; check the "
            "curves, or lower gamma"
        )


def mistakes(sides):
    """The mistakes in surfaces and landmarks that explain the curves' ends much better than the landmarks as given."""
    if len(sides.entries) < FEWEST:
        return []
    given = given_reading(sides)
    start, words = given, []
    best = best_reading([given, *of_surfaces(given, sides), *of_order(given)])
    if best.reason and accepted(given, best):
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
    """Curves reversed and swapped, one after the other, as long as the ends altogether fit better by a STEP."""
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
    """Misfits of the curves that another reading reads otherwise, dict.

    `given` and `plausible`: as given and in the other reading, over the curves' length in the disk; `better`: over
    each other.
    """
    rows = ((given.p != other.p) | (given.q != other.q)).any(1)
    before, after = np.sqrt((misfits([given, other])[:, rows] ** 2).mean(1))
    length = np.sqrt((abs(np.diff(other.q[rows])) ** 2).mean())
    return {
        "better": float(after / (before + ROUNDING)),
        "given": float(before / length),
        "plausible": float(after / length),
    }


def of_surfaces(reading, sides):
    """Readings in which the surfaces are not those that the landmarks mean."""
    z_moving, z_control = sides.moving.disk.z, sides.control.disk.z

    def change(p, q, reason):
        return replace(reading, p=p, q=q, reason=reason)

    yield change(
        reading.p.conj(),
        reading.q,
        "mirror: the curves fit the mirrored moving surface much better; give "
        "--mirror (library: qc.mirror), or leave it out if it was given: one side is a left, the other a right",
    )
    pairs = {side: ends(sides.entries, side) for side in ("moving", "control")}
    if pairs["control"].max() < len(z_moving) and pairs["moving"].max() < len(z_control):
        yield change(
            z_moving[pairs["control"]],
            z_control[pairs["moving"]],
            "exchanged: the curves fit much better with "
            'MOVING and CONTROL exchanged; exchange the two surfaces, or "moving" and "control" in the landmarks',
        )
    cut = {side: cut_numbers(getattr(sides, side).surface, numbers) for side, numbers in pairs.items()}
    for read in (("moving",), ("control",), ("moving", "control")):
        if all(cut[side] is not None for side in read):
            yield change(
                z_moving[cut["moving"]] if "moving" in read else reading.p,
                z_control[cut["control"]] if "control" in read else reading.q,
                f"numbering: the {' and '.join(read)} vertices fit much better as those of the whole surface, "
                "before it was cut open; give those of the cut one: the positions of your numbers in "
                "original_vertices, which `qclearn open` keeps in the npz",
            )


def cut_numbers(surface, numbers):
    """Vertices of the cut surface from those of the whole one; None without a table, or where one was cut away."""
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
        yield replace(
            reading, p=reading.p[rows], order=reading.order[rows], backwards=reading.backwards[rows], reason=""
        )


def order_words(reading, names):
    """`reversed:` and `swapped:` for a reading, against the names as given, in their order."""
    words, left = [], dict(enumerate(reading.order.tolist()))
    turned = [names[k] for k in sorted(reading.order[reading.backwards])]
    if turned:
        words.append(
            f"reversed: {listed(turned)} {'fit' if len(turned) > 1 else 'fits'} much better run from the other "
            "end; exchange first and last vertex on one side"
        )
    while left:
        row, cycle = next(iter(left)), []
        while row in left:
            cycle.append(names[row])
            row = left.pop(row)
        if len(cycle) > 1:
            words.append(
                f"swapped: {listed(cycle)} fit much better with each other's vertices; exchange their names or "
                "their vertices on one side"
            )
    return words


def listed(names):
    """Names in quotes, with commas and a last 'and'."""
    quoted = [repr(name) for name in names]
    return " and ".join(filter(None, [", ".join(quoted[:-1]), quoted[-1]]))
