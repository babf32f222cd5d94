import numpy as np

import qclearn as qc
from qclearn.plane import Disk

TITLE = "A certificate of your own"
PAGE, MINUTES, POINTS = "certificate", 25, 3
TASK = r"""
Write `accepts`: it returns `True` exactly where the piecewise linear picture `f`, complex `(V,)`, of a triangulated
disk is one to one and not mirrored. `faces`, integer `(F, 3)`, are counter-clockwise in the source, and `loop`, integer
`(B,)`, is its counter-clockwise boundary. {prf:ref}`The proposition on the certificate <prop-ce-certificate>` says what
has to be looked at, and the text below its proof why neither part may be left out. Ignore rounding: an area is
positive, or it is not. Two helpers are given.
"""


# %% answer
def areas(faces, f):
    """Signed areas of the triangles of the picture, (F,)."""
    a, b, c = f[faces].T
    return ((b - a).conj() * (c - a)).imag / 2


def is_simple(corners):
    """Whether the closed polygon through complex points is simple."""
    import shapely

    xy = np.stack([corners.real, corners.imag], axis=1)
    return bool(shapely.linearrings(xy).is_simple)


def accepts(faces, f, loop):
    """Whether the picture f (V,) is one to one and not mirrored."""
    ### BEGIN SOLUTION
    upright = areas(faces, f).min() > 0
    return bool(upright and is_simple(f[loop]))
    ### END SOLUTION


# %% test
def pictures(rng):
    """(words, whether it is one to one, the picture) of the mesh of `cases`."""
    z, _ = qc.polar_disk(12, 40)
    turn = np.exp(2j * np.pi * rng.uniform())
    yield "a twisted disk", True, turn * z * np.exp(0.6j * rng.uniform(0.5, 1) * (1 - abs(z) ** 2))
    yield (
        "a strip that is bent and does not meet itself",
        True,
        turn * np.exp(2.4j * z * np.exp(0.1j * rng.uniform())),
    )
    yield ("a twisted disk, small and far away", True, 1e-5 * (z * np.exp(0.5j * (1 - abs(z) ** 2)) + 3 * turn))
    f = z.copy()
    f[1 + 40 * 5 + rng.integers(40)] += 0.3
    yield "one vertex pulled across its neighbours", False, f
    yield "the whole disk in a mirror", False, turn * z.conj()
    yield "a strip that comes round to itself", False, np.exp(4j * z * np.exp(0.1j * rng.uniform()))
    yield "a disk that covers its image twice, as z² does", False, turn * z**2
    yield "the same in a mirror", False, turn * z.conj() ** 2
    f = np.round(z * 1024) / 1024  # the areas are exact, so that 0 is 0 and not a rounding error
    inner = 1 + 40 * 4 + rng.integers(40)
    f[inner] = f[inner + 40]
    yield "triangles without area", False, f


def cases(rng):
    disk = Disk(*qc.polar_disk(12, 40))
    for words, right, f in pictures(rng):
        yield words, right, disk.faces, f, disk.loop


def verdict(answer, case):
    words, right, *given = case
    said = answer(*given)
    if not isinstance(said, (bool, np.bool_)):
        return f"True or False is asked for, and it returns {type(said).__name__}"
    if said != right:
        return f"it {'refuses' if right else 'accepts'} this picture: {words}"


def evidence(answer, case):
    return float(answer(*case[2:]))


MISTAKES = {
    "unsigned areas": (
        ("areas(faces, f).min() > 0", "abs(areas(faces, f)).min() > 0"),
        "Areas without their sign cannot see a fold: a triangle that is turned over keeps its "
        "size. The proof counts"
        " positive triangles, and every other one adds nothing",
    ),
    "total area": (
        ("areas(faces, f).min() > 0", "areas(faces, f).sum() > 0"),
        "The sum of all areas, which is the area inside the boundary, hides a fold: the others "
        "make up for it. The"
        " proposition speaks of every"
        " triangle: ask each of them",
    ),
    "triangles alone": (
        ("upright and is_simple(f[loop])", "upright"),
        "Positive triangles are not enough: around a vertex their angles may add up to more than "
        "a full turn, as z²"
        " shows below the proof. Look at the boundary, too",
    ),
    "boundary alone": (
        ("upright and is_simple(f[loop])", "is_simple(f[loop])"),
        "A simple boundary alone says nothing of what happens inside, nor which way round it is "
        "run. Look at the"
        " triangles, too",
    ),
    "one of the two": (
        ("upright and is_simple(f[loop])", "upright or is_simple(f[loop])"),
        "One of the two conditions is taken for enough. The proposition asks for both: each "
        "refuses pictures that the"
        " other lets through",
    ),
    "no area": (
        ("min() > 0", "min() >= 0"),
        "A triangle without area is let through: it goes to a segment or a point, and the map is "
        "not one to one"
        " there. The proposition excludes it",
    ),
}
