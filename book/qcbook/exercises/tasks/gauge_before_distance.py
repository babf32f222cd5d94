import numpy as np

import qclearn as qc
from qclearn.plane import centring_mobius

TITLE = "Are these two maps the same?"
PAGE, MINUTES, POINTS = "conformal", 25, 3
TASK = r"""
Two programs flatten the same surface. Their disk maps differ at every vertex, and yet both may be right:
{prf:ref}`the theorem on uniformisation <thm-dc-uniformisation>` leaves a Möbius map open. So maps are compared in one
gauge. Write two functions. `gauged` moves a map until [the areas have their centroid at 0](#eq-dc-centroid), and then
turns it so that the rim vertex with the number `first` lies at 1. `apart` returns the mean distance of two maps of
the same surface, each in its gauge, with the areas as weights: one real number, in radii of the disk. Given are the
maps `f` and `g`, complex `(V,)`, and `areas`, the surface's area at each vertex, real `(V,)`. `qc.mobius(f, a)` is
the Möbius map that sends `a` to 0. The present centroid is a good `a`, but Möbius maps do not take centroids to
centroids, so repeat the step until nothing moves. The section *Five steps to the map* explains the gauge.
"""


# %% answer
def gauged(f, areas, first):
    """The map with the areas' centroid at 0 and vertex `first` at 1."""
    ### BEGIN SOLUTION
    for _ in range(200):
        f = qc.mobius(f, areas @ f / areas.sum())
    return f / f[first]
    ### END SOLUTION


def apart(f, g, areas, first):
    """Mean distance of two disk maps by area, each in its gauge."""
    ### BEGIN SOLUTION
    off = abs(gauged(f, areas, first) - gauged(g, areas, first))
    return areas @ off / areas.sum()
    ### END SOLUTION


# %% test
def cases(rng):
    """Words, maps and areas: one map in two gauges, and different maps in different gauges."""
    z, _ = qc.polar_disk(6, 18)
    z = z + 0.1 * np.exp(1j * rng.uniform(0, 6)) * (1 - abs(z) ** 2)
    along = z * np.exp(2j * np.pi * rng.uniform())
    areas = np.exp(8 * along.real**2 + along.real)  # a long surface: single steps towards its centroid fall short
    twisted = z * np.exp(0.5j * (1 - abs(z) ** 2))
    pairs = ("a map and the same after a Möbius map", z, z), ("two different maps", z, twisted)
    for words, f, g in pairs:
        far = rng.uniform(0.5, 0.7) * np.exp(2j * np.pi * rng.uniform(size=2))
        turns = rng.uniform(0.5, 2) * np.array([1, -1])
        f, g = (qc.mobius(one, a, turn) for one, a, turn in zip((f, g), far, turns))
        yield words, f, g, areas, len(z) - 2 - rng.integers(16)


def settled(f, areas, first):
    f = qc.mobius(f, centring_mobius(f, areas))
    return f / f[first]


def verdict(answer, case):
    words, f, g, areas, first = case
    right = np.average(abs(settled(f, areas, first) - settled(g, areas, first)), weights=areas)
    said = np.asarray(answer(f, g, areas, first))
    if said.shape or said.dtype.kind not in "fi":
        return "one real number is asked for, and it returns something else"
    if not abs(said - right) < 1e-5:
        return f"for {words} it returns {said:.2g}"


def evidence(answer, case):
    return float(answer(*case[1:]))


MISTAKES = {
    "freedom forgotten": (
        ("off = abs(gauged(f, areas, first) - gauged(g, areas, first))", "off = abs(f - g)"),
        "The maps are compared as they come. Two maps of one surface may differ by a Möbius map "
        "and both be"
        " conformal: bring each into the gauge first",
    ),
    "turn forgotten": (
        ("return f / f[first]", "return f"),
        "The centroid is at 0, but a turn is still free: the gauge has three real parameters, and a centroid fixes two",
    ),
    "one step": (
        ("range(200)", "range(1)"),
        "One step does not bring the centroid to 0: a Möbius map is not linear, so the centroid "
        "does not move like a"
        " point. Repeat the step until it rests",
    ),
    "centroid of the vertices": (
        ("areas @ f / areas.sum())", "f.mean())"),
        "This centroid counts vertices and not area, so it depends on the mesh. Look at the "
        "weights in the equation"
        " of the gauge",
    ),
    "translated": (
        ("qc.mobius(f, areas @ f / areas.sum())", "f - areas @ f / areas.sum()"),
        "The map is shifted, which carries it out of the disk: a translation is no map of the "
        "disk to itself. The"
        " freedom is that of Möbius maps",
    ),
    "mean over vertices": (
        ("return areas @ off / areas.sum()", "return off.mean()"),
        "The gauge is right, but the mean distance counts vertices: where the mesh is fine, "
        "cortex counts more. Weigh"
        " the distances by area, too",
    ),
}
