import numpy as np

import qclearn as qc
from qclearn.plane import corner_angles, edge_lengths

from . import shaped

TITLE = "Curvature in a corner, and on the rim"
PAGE, MINUTES, POINTS = "surfaces", 25, 3
TASK = r"""
A polyhedron is flat on its faces: its Gaussian curvature sits in the vertices. Inside, a vertex carries $2\pi$ minus
the sum of the angles around it. On the rim, where half of a turn is the flat case, it carries $\pi$ minus that sum,
which is the turning of the rim. Write `defects`: given are `vertices`, real `(V, 3)`, `faces`, integer `(F, 3)`, and
`rim`, integer `(B,)`, the boundary vertices of all loops; return the numbers at the vertices in radians, real `(V,)`.
Measure the angles in space, between the edges that leave a corner. The numbers have to add up to $2\pi\chi$
[by Gauss and Bonnet](#eq-sf-gauss-bonnet), but not every mistake spoils that sum. See the section *Counting: Euler's
number and boundary loops*.
"""


# %% answer
def defects(vertices, faces, rim):
    """Angle defects, 2 pi or (on the rim) pi minus the angles, (V,)."""
    ### BEGIN SOLUTION
    corners = vertices[faces]
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, -2, axis=1) - corners
    lengths = np.linalg.norm(ahead, axis=2) * np.linalg.norm(back, axis=2)
    angles = np.arccos((ahead * back).sum(axis=2) / lengths)
    total = np.bincount(faces.ravel(), angles.ravel())
    flat = np.full(len(vertices), 2 * np.pi)
    flat[rim] = np.pi
    return flat - total
    ### END SOLUTION


# %% test
def cases(rng):
    """A crooked cap, and a crooked ring: words, Euler's number, points, faces and rim."""
    z, faces = qc.polar_disk(5, 14)
    ring = faces[(faces > 0).all(axis=1)] - 1
    for words, chi, some, points in (("disk", 1, faces, z), ("ring", 0, ring, z[1:])):
        height = rng.uniform(0.5, 1) * np.cos(1.5 * abs(points)) + 0.3 * points.real * points.imag
        vertices = np.stack([points.real, points.imag, height], axis=1) + 0.03 * rng.normal(size=(len(points), 3))
        rim = np.arange(len(points) - 14, len(points))
        yield words, chi, vertices, some, rim if chi else np.append(np.arange(14), rim)


def verdict(answer, case):
    words, chi, vertices, faces, rim = case
    angles = corner_angles(edge_lengths(vertices[faces]))
    right = 2 * np.pi - np.bincount(faces.ravel(), angles.ravel()) - np.pi * np.isin(np.arange(len(vertices)), rim)
    said = shaped(answer(*case[2:]), right.shape)
    off = abs(said - right)
    if not off.max() < 1e-6:
        where = "on the rim" if off.argmax() in rim else "inside"
        sums = f"the sum is {said.sum() / np.pi:.6g} pi and should be {2 * chi} pi"
        return f"on a {words} {sums}; the largest error, {off.max():.2g}, is {where}"


def evidence(answer, case):
    return np.asarray(answer(*case[2:]), float)


MISTAKES = {
    "rim like the inside": (
        ("flat[rim] = np.pi", "flat[rim] = 2 * np.pi"),
        "Rim vertices are measured against a full turn. They have faces on one side only: there "
        "the flat case is a"
        " straight line, half of a turn",
    ),
    "rim left out": (
        ("return flat - total", "return np.where(np.isin(np.arange(len(flat)), rim), 0, flat - total)"),
        "The rim is left out. The theorem of Gauss and Bonnet has a second sum, over the "
        "boundary: it is the turning"
        " of the rim",
    ),
    "angle at another corner": (
        ("angles.ravel())", "np.roll(angles, 1, axis=1).ravel())"),
        "Each angle is given to another corner of its triangle. The sum over all vertices does "
        "not see that, but the"
        " curvature sits in the wrong places",
    ),
    "outer angles": (
        ("np.roll(corners, -2, axis=1) - corners", "np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)"),
        "The two edges do not start at the same corner: that gives an outer angle, of another "
        "corner. Both have to"
        " leave the corner whose angle is asked for",
    ),
    "all angles alike": (
        ("np.bincount(faces.ravel(), angles.ravel())", "np.bincount(faces.ravel()) * np.pi / 3"),
        "Triangles are counted as if each were equilateral. That gives the right sum and says "
        "nothing of the shape:"
        " measure the angles in space",
    ),
    "degrees": (
        ("return flat - total", "return np.degrees(flat - total)"),
        "These are degrees, and radians are asked for: a full turn is 2 pi. np.arccos gives radians by itself",
    ),
    "flat case left out": (
        ("return flat - total", "return -total"),
        "The angles alone are summed. Curvature is what they lack to the flat case: a full turn "
        "inside, half of one"
        " on the rim",
    ),
    "sign": (
        ("return flat - total", "return total - flat"),
        "The sign is wrong: a cap, whose angles fall short of a full turn, has positive "
        "curvature. Compare with the"
        " theorem of Gauss and Bonnet",
    ),
}
