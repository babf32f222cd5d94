"""Mistakes in surfaces and landmarks: another way to read them, in which the curves' ends fit much better.

The surfaces mirrored, exchanged or not the numbered ones, curves reversed or swapped. The ends are compared after each
reading's best Möbius map. One or two curves it takes to wrong places as well as to right ones: with so few the folds
judge, by their own best Möbius map; and without any they tell a left from a right.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..plane.mobius import mobius_misfits
from ..surfaces.surface import SurfaceError
from .features import FOLDS, SCALE, check_features, featured, laid_by_features, mirrored_gain
from .limits import LIMITS, ROUNDING

FEWEST = 3  # curves: with fewer, a Möbius map takes wrong ends to wrong ends as well as right ones to right ones
STEP = 0.9  # of the misfit of all curves: what a further change of their order must come below
MIRROR = "give --mirror (library: qc.mirror), or leave it out if it was given: one side is a left, the other a right"


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


def mistakes(sides):
    """Words on mistakes in surfaces and landmarks that explain folds or curves' ends much better than as given."""
    if len(sides.entries) >= FEWEST:
        return misread(sides)
    laid = laid_by_folds(sides)
    if laid is None:
        return []
    if mirrored_gain(laid.moving, laid.control) > LIMITS["hand"]:
        return [f"mirror: the folds fit the mirrored moving surface much better; {MIRROR}"]
    return misread(laid) if sides.entries and decisive(laid) > LIMITS["decisive"] else []


def laid_by_folds(sides):
    """The sides with the moving one laid upon the control's by its features, or else by its folds; None without any."""
    if not sides.entries:
        return sides
    try:
        sides = with_folds(sides)
    except SurfaceError:  # a surface without folds
        return None
    disk = sides.moving.disk
    return replace(sides, moving=replace(sides.moving, disk=disk.at(laid_by_features(sides.features, disk.z))))


def with_folds(sides):
    """The sides with their features, or else with the folds as these."""
    if sides.features is not None:
        return sides
    maps = check_features(FOLDS, sides.moving.surface, sides.control.surface)
    moving, control, features = featured(sides.moving, sides.control, maps)
    return replace(sides, moving=moving, control=control, features=features)


def decisive(laid):
    """How much better the features correlate than after a quarter or half turn more: 0 on a surface of revolution,
    where they lie upon each other in any."""
    z = laid.moving.disk.z
    given, *turned = (laid.features.correlation(turn * z, SCALE).mean() for turn in (1, 1j, -1, -1j))
    return float(given - max(turned))


def misread(sides):
    """Words on readings of the landmarks that explain the curves' ends much better than as given."""
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
    """Root mean square distance of each curve's ends after each reading's best Möbius map, (readings, K); of fewer than
    FEWEST curves as they lie."""
    p, q = (np.stack([getattr(reading, side) for reading in readings]) for side in ("p", "q"))
    few = p.shape[1] < FEWEST
    off = abs(p - q) if few else mobius_misfits(p.reshape(len(p), -1), q.reshape(len(q), -1)).reshape(p.shape)
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
    if len(sides.entries) >= FEWEST:
        reason = f"mirror: the curves fit the mirrored moving surface much better; {MIRROR}"
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
