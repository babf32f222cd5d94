import numpy as np

import qclearn as qc

TITLE = "The middle of a group"
PAGE, MINUTES, POINTS = "template", 25, 3
TASK = r"""
Take step 2 in the section *One round of the iteration*. Given are the maps $f_k$ of $n$ subjects to the
mean, `maps`, complex `(n, V)`; for simplicity all are known at the vertices `z` of one mesh of the disk with
triangles `faces`, and all are the identity on the circle. Return the maps $g_k = h \circ f_k$, complex `(n, V)`,
where $h$ is the average of the inverse maps.
{prf:ref}`Then the average of the inverses of the new maps <prop-tm-identity>` is the identity.

`qc.transfer(values, places, faces, points)` evaluates what has the `values` where the vertices lie at `places`, at
any `points` of the disk, linearly in each triangle. That is all you need, for inverses and for compositions.
"""


# %% answer
def centred(maps, z, faces):
    """The maps (n, V), each followed by the average of all inverses."""
    ### BEGIN SOLUTION
    inverses = [qc.transfer(z, f, faces, z) for f in maps]
    h = np.mean(inverses, axis=0)
    return np.array([qc.transfer(h, z, faces, f) for f in maps])
    ### END SOLUTION


# %% test
def cases(rng):
    """(maps, z, faces): three subjects whose folds all lie to one side of the mean's."""
    z, faces = qc.polar_disk(14, 42)
    free, way = 1 - abs(z) ** 2, np.exp(1j * rng.uniform(0, 6))
    shifts, turns = rng.permutation([0.15, 0.3, 0.42]), rng.permutation([0.3, 0.8, 1.3])
    yield (np.array([(z + s * way * free) * np.exp(1j * turn * free) for s, turn in zip(shifts, turns)]), z, faces)


def off_centre(maps, z, faces):
    """Mean distance of the average of the inverse maps from the identity."""
    return abs(np.mean([qc.transfer(z, f, faces, z) for f in maps], axis=0) - z).mean()


def verdict(answer, case):
    maps, z, faces = case
    found = np.asarray(answer(maps.copy(), z.copy(), faces.copy()))
    if found.shape != maps.shape:
        return f"the new maps should have the shape {maps.shape}; these have {found.shape}"
    if not np.isfinite(found).all():
        return "the new maps are not finite"
    if abs(found - maps).max() < 1e-9:
        return "the maps are returned as they came"
    before, after = off_centre(maps, z, faces), off_centre(found, z, faces)
    if not after <= 0.05 * before:
        return f"the average of the inverses is off the identity by {after:.3f}, and was by {before:.3f}"
    h = np.mean([qc.transfer(z, f, faces, z) for f in maps], axis=0)
    if not max(abs(g - qc.transfer(h, z, faces, f)).mean() for f, g in zip(maps, found)) <= 0.05 * before:
        return "the inverses average to the identity, but the new maps are not each old one followed by one common map"


def evidence(answer, case):
    found = np.asarray(answer(*(part.copy() for part in case)), complex)
    return np.stack([found.real, found.imag])


MISTAKES = {
    "average of the maps": (
        ("inverses = [qc.transfer(z, f, faces, z) for f in maps]", "inverses = maps"),
        "This averages the maps, whose disks are different ones. The mean asks from its own "
        "points where each "
        "subject has the same: average the inverses",
    ),
    "inverse of the average": (
        (
            "h = np.mean(inverses, axis=0)\n    return np.array([qc.transfer(h, z, faces, f) for f in maps])",
            "a = np.mean(maps, axis=0)\n    return np.array([qc.transfer(z, a, faces, f) for f in maps])",
        ),
        "This takes off the average of the maps by its inverse, as in the page's exercise 'Why "
        "not the average of "
        "the maps?'. It centres nothing exactly",
    ),
    "taken off the other way": (
        ("qc.transfer(h, z, faces, f)", "qc.transfer(z, h, faces, f)"),
        "The inverse of h follows the maps here, which doubles what should be taken off: the maps "
        "have to be "
        "followed by h itself",
    ),
    "the wrong order": (
        ("qc.transfer(h, z, faces, f)", "qc.transfer(f, z, faces, h)"),
        "The order: h comes first here, on the subject's disk. It lives on the disk of the mean "
        "and has to come "
        "after each map",
    ),
    "displacements added": (
        ("qc.transfer(h, z, faces, f)", "f + h - z"),
        "The displacement of h is added where the vertex was. It is needed where the map has taken the vertex: compose",
    ),
}
