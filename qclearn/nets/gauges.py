"""How far maps are off, in units of what the identity is off, in two gauges."""

import numpy as np

from ..plane.mobius import nearest_mobius

ROUNDS = 12  # of the fit of Möbius maps, which begins at the best rotation


def gauge_errors(maps, exact, z):
    """`sum|f - f*| / sum|z - f*|` over z (V,), for maps f and exact maps f* (B, V): dict.

    A dict: "comes", both as they come (f(0) = 0 and f(1) = 1), and "mobius", after the best Möbius
    map for f and for z.
    """
    identity = np.tile(z, (len(exact), 1))
    off, still = (
        nearest_mobius(np.asarray(f, complex), exact, 1, ROUNDS)[1].sum() for f in (maps, identity)
    )
    return {
        "comes": float(abs(maps - exact).sum() / abs(identity - exact).sum()),
        "mobius": float(off / still),
    }
