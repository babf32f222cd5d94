"""The certificate of a piecewise linear map, and the repair of one that folds."""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Complex, Integer
from numpy import ndarray
from scipy import sparse

from .beltrami import Dirichlet, assemble
from .checks import BeltramiError, check_map, check_mesh
from .diskmesh import boundary_loop

TINY = 1e-300


class BijectivityError(ValueError):
    """A map that must be a bijection folds, and the repair could not mend it."""


class RepairWarning(UserWarning):
    """The result is certified, but only after steps that depart from the plain method; the message says which."""


@dataclass(frozen=True)
class Certificate:
    """Outcome of `check_bijective`: `bijective`, the `flipped` faces, and whether the `boundary` is simple."""

    bijective: bool
    flipped: Integer[ndarray, " k"]
    boundary: bool


def flipped_faces(faces, f):
    """Indices of the triangles that are not counter-clockwise under f beyond doubt of rounding, (k,)."""
    f, faces = check_mesh(f, faces)
    a, b, c = f[faces].T
    with np.errstate(all="ignore"):  # what overflows, or is not finite, stays in doubt
        left, right = (b - a).real * (c - a).imag, (b - a).imag * (c - a).real
        # A determinant of rounded differences is safe in sign once it exceeds this part of its terms (Shewchuk 1997
        # has 3.3e-16); TINY stands for what products lose below the smallest normal number.
        return np.flatnonzero(~(left - right > 1e-15 * (abs(left) + abs(right)) + TINY))


def reversed_faces(faces, f):
    """Indices of the triangles that are not counter-clockwise under f, decided exactly, (k,).

    The few that rounding leaves in doubt are decided in integers: a double is one, times a power of two.
    """
    f, faces = check_mesh(f, faces)
    doubt = flipped_faces(faces, f)
    doubt_corners = f[faces[doubt]]
    finite = np.isfinite(doubt_corners).all(1)
    vertices, corners = np.unique(faces[doubt[finite]], return_inverse=True)
    x, y = integers(f[vertices].real), integers(f[vertices].imag)
    (ax, bx, cx), (ay, by, cy) = (part[corners.reshape(-1, 3).T] for part in (x, y))
    sound = np.zeros(len(doubt), bool)
    sound[finite] = (bx - ax) * (cy - ay) > (by - ay) * (cx - ax)
    return doubt[~sound]


def integers(x):
    """Finite doubles (n,) times the power of two that makes all of them integers, as Python's, object (n,)."""
    mantissa, exponent = np.frexp(x)
    mantissa = np.ldexp(mantissa, 53).astype(np.int64)
    exponent -= exponent.min(initial=0, where=mantissa != 0)  # of 0 it says nothing
    whole = [m << max(e, 0) for m, e in zip(mantissa.tolist(), exponent.tolist())]
    return np.array(whole, dtype=object).reshape(len(x))


def check_bijective(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], f: Complex[ndarray, " V"]
) -> Certificate:
    """Decide whether the piecewise linear map z -> f of a triangulated disk is a bijection onto its image.

    It is one when every triangle keeps its positive orientation and the image of the boundary is a simple polygon
    run once counter-clockwise. Decided for the numbers as they are, without rounding: triangles in doubt in exact
    arithmetic; one without area counts as flipped. Raises BeltramiError where the source mesh itself is folded or is
    not a disk.
    """
    z, faces = check_mesh(z, faces)
    f = check_map(f, len(z))
    bad = reversed_faces(faces, z)
    if len(bad):
        raise BeltramiError(
            f"{len(bad)} triangles of the source mesh are folded or without area (first: "
            f"{bad[:5].tolist()}): a map of it cannot be certified"
        )
    return check_embedding(faces, f)


def check_embedding(faces: Integer[ndarray, " F 3"], f: Complex[ndarray, " V"]) -> Certificate:
    """The certificate of a planar picture f of a triangulated disk, whatever its source (a surface, say)."""
    f, faces = check_mesh(f, faces)
    flipped, loop = reversed_faces(faces, f), f[boundary_loop(faces)]
    simple = bool(np.isfinite(loop).all()) and _simple_and_positive(loop)
    return Certificate(simple and len(flipped) == 0, flipped, simple)


def _simple_and_positive(loop):
    ring = shapely.linearrings(np.stack([loop.real, loop.imag], axis=1))
    return bool(ring.is_simple and ring.is_ccw)


def mean_value_matrix(faces, lengths, n_vertices):
    """Floater's mean-value matrix, rows normalised: u_i minus an average of its neighbours, sparse (V, V).

    Weights `(tan(a/2) + tan(b/2)) / |e_ij|` from the edge lengths (F, 3), edge k opposite corner k; all positive, so
    that a map whose rows are all of this kind and whose boundary is convex is a bijection (Tutte, Floater).
    """
    opposite, left, right = lengths, np.roll(lengths, -1, axis=1), np.roll(lengths, -2, axis=1)
    # tan(a/2) = sqrt((o^2 - (l - r)^2) / ((l + r)^2 - o^2)); in a sliver rounding can make either part negative.
    smallest = 1e-24 * (left + right) ** 2
    half = np.sqrt(
        np.maximum(opposite**2 - (left - right) ** 2, smallest)
        / np.maximum((left + right) ** 2 - opposite**2, smallest)
    )
    blocks = np.zeros((len(faces), 3, 3))
    for corner in range(3):
        following, last = (corner + 1) % 3, (corner + 2) % 3
        blocks[:, corner, following] = -half[:, corner] / lengths[:, last]
        blocks[:, corner, last] = -half[:, corner] / lengths[:, following]
    matrix = assemble(faces, blocks, n_vertices).tocsr()
    total = -np.asarray(matrix.sum(1)).ravel()
    matrix.setdiag(total)
    matrix.data /= np.repeat(total, np.diff(matrix.indptr))
    return matrix


def repair(matrix, faces, lengths, f, switched=(), most_rounds=30):
    """Unfold a Dirichlet solution by row switching: (f, switched (k,) vertices, the Dirichlet problem solved last).

    The rows of the interior vertices of flipped faces are replaced by mean-value rows and the problem is solved
    again with the same boundary values; where a flip survives on switched rows one more ring is switched. With all
    rows switched and a convex boundary this is Floater's theorem. Not certified: the caller checks the result.
    `switched` holds rows switched before. Without a flipped face nothing is solved and the problem is None.
    """
    boundary, average, dirichlet = boundary_loop(faces), None, None
    already, switched = switched, np.zeros(len(f), bool)
    switched[np.asarray(already, int)] = True
    for _ in range(most_rounds):
        flipped = flipped_faces(faces, f)
        wanted, reached = _interior_of(faces[flipped], boundary, len(f)), 0
        while wanted.sum() > reached and not (wanted & ~switched).any():  # one ring more, as long as there is one
            wanted, reached = _interior_of(faces[wanted[faces].any(1)], boundary, len(f)), wanted.sum()
        if not (wanted & ~switched).any():
            break
        switched |= wanted
        average = mean_value_matrix(faces, lengths, len(f)) if average is None else average
        keep = sparse.diags_array(np.where(switched, 0.0, 1 / matrix.diagonal()))
        mixed = keep @ matrix + sparse.diags_array(switched.astype(float)) @ average
        dirichlet = Dirichlet(mixed, boundary)
        f = dirichlet.solve(f[boundary])
    return f, np.flatnonzero(switched), dirichlet


def _interior_of(faces, boundary, n_vertices):
    marked = np.zeros(n_vertices, bool)
    marked[faces] = True
    marked[boundary] = False
    return marked
