"""What makes a registration suspect: mistakes in its landmarks, and maps that good landmarks do not lead to.

A reason is one text: a fixed word, what was found, and what to do. What it is held against stands in limits.py.
"""

import numpy as np

from .limits import LIMITS, ROUNDING
from .metrics import mean_rows
from .readings import listed

LEAST_R, COARSEST = 0.3, 16.0  # correlation below which features are no guide, and the scale in mm it is measured at


def reasons(moving, rows, fit):
    """Texts on why the `CertifiedMap` of a moving surface, rows from `error_rows`, is suspect."""
    errors = [*large_error(mean_rows(rows)), *odd_curves(rows)] if rows else []
    return [*errors, *switched_rows(fit, moving), *strong_distortion(moving, fit.mu)]


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


def worse(held_out_mm, dice):
    """`worse:` where held-out curves, or annotations by their `dice`, fit clearly worse than after the Möbius map."""
    rise, found = 1 + LIMITS["worse"], []
    before, after = np.mean(list(held_out_mm.values()), axis=0) if held_out_mm else (0.0, 0.0)
    if after > rise * before and after - before > LIMITS["worse_mm"]:
        found.append(f"the held-out curves end {after:.1f} mm from their targets on average ({before:.1f}")
    for name, (before, after) in held_out_mm.items():
        if after > rise * before and after - before > LIMITS["worse_curve_mm"]:
            found.append(f"{name!r} ends {after:.1f} mm from its target ({before:.1f}")
    if dice and dice["after"] < (1 - LIMITS["worse_dice"]) * dice["before"]:
        found.append(f"the annotations' Dice is {dice['after']:.2f} ({dice['before']:.2f}")
    if found:
        found = ", and ".join(f"{one} after the best Möbius map)" for one in found)
        yield f"worse: {found}; check what was fitted, lower delta or gamma, or give a landmark curve there"
