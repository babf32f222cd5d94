import numpy as np

import qclearn as qc

from . import parts

TITLE = "An error in its gauge"
PAGE, MINUTES, POINTS = "whennetwork", 25, 3
TASK = r"""
The section *Accuracy on held-out coefficients* has two errors of a network's maps, each in units of the identity's:
the sum of distances from the exact maps over that of the identity, *as it comes*, and the same *after Möbius*, where
both have been followed by their best Möbius maps. Write both. Given are the network's `maps` and the `exact` ones,
complex `(B, V)`; the vertices `z`, complex `(V,)`, which are the identity map; and a function `nearest`:
`nearest(p, q)` is points $p$, `(V,)`, after the Möbius map of the disk that brings them nearest to the points $q$,
as `qc.best_mobius` finds it. Return two numbers, in a tuple or an array.
"""


# %% answer
def errors_in_gauge(maps, exact, z, nearest):
    """(as it comes, after Möbius): errors over those of the identity."""
    ### BEGIN SOLUTION
    off = still = off_after = still_after = 0
    for f, target in zip(maps, exact):
        off += abs(f - target).sum()
        still += abs(z - target).sum()
        off_after += abs(nearest(f, target) - target).sum()
        still_after += abs(nearest(z, target) - target).sum()
    return off / still, off_after / still_after
    ### END SOLUTION


# %% test
def cases(rng):
    """(words, maps, exact, z): maps that are right but for a Möbius map, and maps that are off on
    one side."""
    z, _ = qc.polar_disk(6, 16)
    free, way = 1 - abs(z) ** 2, np.exp(1j * rng.uniform(0, 6, 2))
    exact = np.array([z * np.exp(1j * free * (0.8 * z * way[0]).real), z + 0.25 * free * (0.5 + z**2 * way[1])])
    bump = free * np.exp(-6 * abs(z - 0.6 * way[:, None]) ** 2)
    wrong = exact + np.array([[0.05], [0.25]]) * way[:, None] * bump
    yield ("maps that are right but for a Möbius map", np.array([qc.mobius(f, 0.25j) for f in exact]), exact, z)
    yield ("maps with errors of their own", np.array([qc.mobius(f, 0.6 * w) for f, w in zip(wrong, way)]), exact, z)


def nearest(p, q):
    """Points p after the disk Möbius map that brings them nearest to q: `qc.best_mobius`, in less
    time."""
    from qclearn.plane.mobius import nearest_mobius

    p, q = np.asarray(p, complex)[None], np.asarray(q, complex)[None]
    (a, theta), _ = nearest_mobius(p, q, 1)
    return qc.mobius(p[0], a[0], theta[0])


def verdict(answer, case):
    words, maps, exact, z = case
    said = parts(answer(maps.copy(), exact.copy(), z.copy(), nearest), 2, "as it comes, after Möbius")
    identity = np.tile(z, (len(exact), 1))
    comes = [abs(side - exact).sum() for side in (maps, identity)]
    after = [abs(np.array(list(map(nearest, side, exact))) - exact).sum() for side in (maps, identity)]
    for name, figure, (off, still) in zip(("as they come", "after Möbius"), map(float, said), (comes, after)):
        if not abs(figure - off / still) <= 1e-6:
            return f"for {words} the error {name} is {off / still:.6g}, and not {figure:.6g}"


def evidence(answer, case):
    return np.array(answer(*(part.copy() for part in case[1:]), nearest), float)


MISTAKES = {
    "the identity as it comes": (
        ("abs(nearest(z, target) - target)", "abs(z - target)"),
        "After Möbius the identity has to be followed by its best Möbius map, too: both sides in "
        "one gauge, or "
        "the network is flattered",
    ),
    "mean of ratios": (
        (
            "        off += abs(f - target).sum()\n        still += abs(z - target).sum()\n"
            "        off_after += abs(nearest(f, target) - target).sum()\n"
            "        still_after += abs(nearest(z, target) - target).sum()\n",
            "        still, still_after = len(exact), len(exact)\n"
            "        off += abs(f - target).sum() / abs(z - target).sum()\n"
            "        off_after += abs(nearest(f, target) - target).sum() / abs(nearest(z, target) "
            "- target).sum()\n",
        ),
        "This is the mean of ratios, which a map that hardly moves can spoil. The page has the "
        "ratio of both sums "
        "over all maps",
    ),
    "turns alone": (
        ("abs(nearest(f, target) - target)", "abs(f * np.exp(1j * np.angle(np.vdot(f, target))) - target)"),
        "A turn alone is sought. Möbius maps of the disk have three real parameters, and the "
        "point that goes to 0 "
        "is two of them",
    ),
    "the exact map is moved": (
        ("abs(nearest(f, target) - target)", "abs(nearest(target, f) - f)"),
        "The exact map is moved to the network's. Möbius maps keep no distances: measure at the "
        "exact map, for "
        "both sides",
    ),
    "the network's for both": (
        ("nearest(z, target)", "nearest(z, f)"),
        "The identity is brought nearest to the network's map. Both are to be brought nearest to "
        "the exact map, "
        "from which they are measured",
    ),
}
