"""A triangle mesh laid on a sphere, untangled: no face flipped or too small in the float32 that files hold."""

import numpy as np
import scipy
from jaxtyping import Float, Integer
from numpy import ndarray
from scipy import sparse

from ..plane.triangles import edge_lengths
from .checks import norms

RADIUS = 100.0  # of the spheres of FreeSurfer and of Workbench, mm
LEAST_EDGE, LEAST_AREA = 1e-3, 1e-5  # that every edge, mm, and every face, mm^2, has in the end
BAD, GOOD = 1.2, 3.0  # a face below so many times its least size is mended, to so many times of it
ROUNDS, PATIENCE, EASE = 80, 10, 4  # at most; after how many one more ring takes part, and neighbours' means are taken
STEP = 0.4  # of the edges around it, or less at random: how far a vertex goes in a round
PRICE, MISSING = 3.0, 1e4  # of the next rank's moving 1 mm, and of 1 mm of height that stays away
SOFT = 4  # the least rank that stays when neighbours' means are taken


class UntanglingError(ValueError):
    """A mesh on a sphere whose flipped faces could not be turned back."""


def untangled(
    vertices: Float[ndarray, " V 3"], faces: Integer[ndarray, " F 3"], rank: Integer[ndarray, " V"]
) -> tuple[Float[ndarray, " V 3"], Integer[ndarray, " k"]]:
    """The vertices of a closed mesh on the sphere of RADIUS without a flipped or too small face; and which were moved.

    They are those that float32 holds; the faces look outward. Around bad faces the vertices make in each round
    the shortest moves that give all faces their heights (`least_moves`), those of low `rank` rather than others. Where
    that does not end, those below rank SOFT go to the means of their neighbours every EASE rounds: long faces on a
    jagged seam need a detour. UntanglingError, with the faces, where ROUNDS are not enough.
    """
    p, moved, rng = stored(vertices), np.zeros(len(vertices), bool), np.random.default_rng(0)
    owners = np.repeat(np.arange(len(faces)), 3)
    stars = sparse.csr_array((np.ones(faces.size, np.int8), (faces.ravel(), owners)), shape=(len(p), len(faces)))
    bad = np.flatnonzero(too_small(p, faces))
    for turn in range(ROUNDS):
        if not len(bad):
            return p, np.flatnonzero(moved)
        near = bad
        for _ in range(2 + turn // PATIENCE):
            active = np.unique(faces[near])
            near = np.unique(stars[active].indices)
        if turn % EASE == EASE - 1:
            soft = active[rank[active] < SOFT]
            p[soft], moved[soft] = stored(neighbour_sums(p, faces[near])[soft]), True
        # what full steps have not mended goes round in circles with them
        steps = STEP * 0.1 ** rng.random(len(active)) if turn >= EASE else np.full(len(active), STEP)
        shift = least_moves(p, faces[near], active, rank[active], steps)
        going = shift.any(1)
        p[active[going]], moved[active[going]] = stored(p[active[going]] + shift[going]), True
        bad = near[too_small(p, faces[near])]
    raise UntanglingError(
        f"{len(bad)} faces of the sphere stay flipped or too small, the first {bad[:5].tolist()}; look at the "
        "registration there, made without a sphere, and at the cortex labels of both sides"
    )


def stored(points):
    """Points (n, 3) put on the sphere of RADIUS, as float32 holds them."""
    return (points * (RADIUS / norms(points)[:, None])).astype(np.float32).astype(float)


def too_small(p, faces):
    """Which faces are flipped, or too near to the least area or edge, (F,) bool."""
    lengths, areas = edge_lengths(p[faces]), doubled_areas(p, faces)[0] / 2
    return (areas < BAD * LEAST_AREA) | (lengths.min(1) < BAD * LEAST_EDGE)


def doubled_areas(p, faces):
    """Twice the area of each face, `det(a, b, c) / RADIUS` (F,), negative where it looks inward, and its gradient by
    each corner, (F, 3, 3)."""
    a, b, c = (p[corner] for corner in faces.T)
    gradient = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1) / RADIUS
    return np.einsum("fi,fi->f", a, gradient[:, 0]), gradient


def neighbour_sums(p, faces):
    """The sum of the neighbours of each vertex, (V, 3), each as often as faces join the two."""
    total = np.zeros_like(p)
    for k in range(3):
        np.add.at(total, faces[:, k], p[faces[:, k - 1]] + p[faces[:, k - 2]])
    return total


def least_moves(p, faces, active, rank, steps):
    """The moves (k, 3) of the `active` vertices (k,) across the sphere that give the faces (m, 3) their heights.

    A linear program: `min sum_v PRICE^rank_v |x_v|_1 + MISSING sum_f s_f`, where the height of each face over its
    longest side, linear in x, is at least what its area and its shortest edge need, less s_f >= 0. A vertex goes at
    most `steps` (k,) times the length of the edges around it. The sum of the lengths is least, so that few move.
    """
    n, m, number = len(active), len(faces), np.full(len(p), -1)
    number[active] = np.arange(n)
    lengths, (area, gradient) = edge_lengths(p[faces]), doubled_areas(p, faces)
    longest = np.maximum(lengths.max(1), LEAST_EDGE)
    wanted = GOOD * np.maximum(LEAST_EDGE, 2 * LEAST_AREA / longest)
    axes = across(p[active])
    face, corner = np.nonzero(number[faces] >= 0)
    at = number[faces[face, corner]]
    slopes = np.einsum("ki,kji->kj", gradient[face, corner], axes[at]) / longest[face, None]
    places = np.repeat(face, 2), (2 * at[:, None] + [0, 1]).ravel()
    slopes = sparse.csr_array((slopes.ravel(), places), shape=(m, 2 * n))
    reach = np.full(len(p), np.inf)
    np.minimum.at(reach, faces, np.median(lengths, 1)[:, None])
    reach = np.repeat(steps * np.maximum(reach[active], 10 * LEAST_EDGE), 2)
    price = np.repeat(PRICE**rank, 2)
    found = scipy.optimize.linprog(
        np.concatenate([price, price, np.full(m, MISSING)]),  # forth, back, and what is missing
        sparse.hstack([-slopes, slopes, -sparse.eye_array(m)]).tocsr(),
        area / longest - wanted,
        bounds=np.stack([np.zeros(4 * n + m), np.r_[reach, reach, np.full(m, np.inf)]], 1),
    )
    x = found.x[: 2 * n] - found.x[2 * n : 4 * n]
    return np.einsum("nj,nji->ni", np.where(abs(x) < 1e-6, 0, x).reshape(n, 2), axes)


def across(p):
    """Two orthonormal directions across each point (n, 3) of a sphere around 0, (n, 2, 3)."""
    third = p / norms(p)[:, None]
    first = np.cross(third, np.eye(3)[abs(third).argmin(1)])
    first /= norms(first)[:, None]
    return np.stack([first, np.cross(third, first)], 1)
