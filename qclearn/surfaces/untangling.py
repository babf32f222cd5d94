"""A triangle mesh laid on a sphere, untangled: no triangle flipped or too small in the float32 that files hold."""

import numpy as np
import scipy
from jaxtyping import Float, Integer
from numpy import ndarray
from scipy import sparse

from .checks import norms

RADIUS = 100.0  # of the spheres of FreeSurfer and of Workbench, mm
LEAST_EDGE, LEAST_AREA = 1e-3, 1e-5  # that every edge, mm, and every face, mm^2, has in the end
SPARE = 3.0  # what is too small is made so many times as large as it has to be
ROUNDS, PATIENCE = 30, 5  # at most, and after how many rounds one more ring of neighbours takes part
STEP = 0.4  # of a vertex's shortest edge or more: how far it moves in one round
PRICE = 3.0  # of moving a vertex of the next rank
MISSING = 1e4  # price of a height that stays too small, against that of moving a vertex of rank 0 as far


class UntanglingError(ValueError):
    """A mesh on a sphere whose flipped faces could not be turned back."""


def untangled(
    points: Float[ndarray, " V 3"], faces: Integer[ndarray, " F 3"], rank: Integer[ndarray, " V"]
) -> tuple[Float[ndarray, " V 3"], Integer[ndarray, " k"]]:
    """Points of a closed mesh on the sphere of RADIUS without a flipped or too small face, and the vertices moved.

    The points are those that float32 holds, as files do; the faces look outward. Around bad faces vertices move the
    least that gives every face its height, by linear programs: the sum of the lengths is least, so few move, and those
    of low rank rather than others. UntanglingError, with the faces, where that does not end.
    """
    p, moved = stored(points), np.zeros(len(points), bool)
    corners = np.repeat(np.arange(len(faces)), 3)
    stars = sparse.csr_array((np.ones(faces.size, np.int8), (faces.ravel(), corners)), shape=(len(p), len(faces)))
    bad = np.flatnonzero(too_small(p, faces))
    for turn in range(ROUNDS):
        if not len(bad):
            return p, np.flatnonzero(moved)
        near = bad
        for _ in range(2 + turn // PATIENCE):
            active = np.unique(faces[near])
            near = np.unique(stars[active].indices)
        shift = least_shift(p, faces[near], active, rank)
        far = norms(shift) > 0
        p[active[far]], moved[active[far]] = stored(p[active[far]] + shift[far]), True
        bad = near[too_small(p, faces[near])]
        print(turn, len(bad), len(active), np.bincount(rank[faces[bad]].max(1), minlength=6), bad[:4])
    raise UntanglingError(f"{len(bad)} faces of the sphere stay flipped or too small, the first {bad[:5].tolist()}")


def stored(points):
    """Points (n, 3) on the sphere of RADIUS, as float32 holds them."""
    return (points * (RADIUS / norms(points)[:, None])).astype(np.float32).astype(float)


def doubled_areas(p, faces):
    """Twice the area of each face on the sphere of RADIUS, (F,), negative where it looks inward, and its gradient by
    each corner, (F, 3, 3): that of `det(a, b, c) / RADIUS`."""
    a, b, c = (p[corner] for corner in faces.T)
    gradient = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1) / RADIUS
    return np.einsum("fi,fi->f", a, gradient[:, 0]), gradient


def sides(p, faces):
    """Length of the edge opposite each corner, (F, 3)."""
    a, b, c = (p[corner] for corner in faces.T)
    return np.stack([norms(c - b), norms(a - c), norms(b - a)], 1)


def too_small(p, faces):
    """Which faces are flipped or smaller than they may be, (F,) bool."""
    return (doubled_areas(p, faces)[0] < 2.4 * LEAST_AREA) | (sides(p, faces).min(1) < 1.2 * LEAST_EDGE)


def least_shift(p, faces, active, rank):
    """The shift (k, 3) of the `active` vertices (k,) in their tangent planes that gives the faces the heights they need.

    Linear program: `min sum_v price_v |x_v|_1 + MISSING sum_f s_f`, the linearised height of each face over its longest
    side at least what its area and its shortest edge need, less s_f >= 0; each step is short.
    """
    n, m = len(active), len(faces)
    area, gradient = doubled_areas(p, faces)
    length = sides(p, faces)
    longest = np.maximum(length.max(1), LEAST_EDGE)
    wanted = SPARE * np.maximum(LEAST_EDGE, 2 * LEAST_AREA / longest)
    axes = tangents(p[active])
    number = np.full(len(p), -1)
    number[active] = np.arange(n)
    face, corner = np.nonzero(number[faces] >= 0)
    at = number[faces[face, corner]]
    along = np.einsum("ki,kji->kj", gradient[face, corner], axes[at]) / longest[face, None]
    places = np.repeat(face, 2), (2 * at[:, None] + [0, 1]).ravel()
    slope = sparse.csr_array((along.ravel(), places), shape=(m, 2 * n))
    reach = np.full(len(p), np.inf)
    np.minimum.at(reach, faces.ravel(), np.repeat(np.median(length, 1), 3))
    reach = STEP * np.maximum(reach[active], 10 * LEAST_EDGE).repeat(2)
    price = (PRICE ** rank[active]).repeat(2)
    found = scipy.optimize.linprog(
        np.concatenate([price, price, np.full(m, MISSING)]),
        sparse.hstack([-slope, slope, -sparse.eye_array(m)]).tocsr(),
        area / longest - wanted,
        bounds=np.stack([np.zeros(4 * n + m), np.concatenate([reach, reach, np.full(m, np.inf)])], 1),
    )
    x = found.x[: 2 * n] - found.x[2 * n : 4 * n]
    return np.einsum("nj,nji->ni", np.where(abs(x) < 1e-6, 0, x).reshape(n, 2), axes)


def tangents(p):
    """Two directions across each point (n, 3) of a sphere around 0, (n, 2, 3), orthonormal."""
    third = p / norms(p)[:, None]
    first = np.cross(third, np.eye(3)[abs(third).argmin(1)])
    first /= norms(first)[:, None]
    return np.stack([first, np.cross(third, first)], 1)
