"""The repair of a piecewise linear map that folds, and the public calls of the certificate, which
is computed in disk.py (`Disk.certificate`, `Disk.certify`)."""

import numpy as np
from scipy import sparse

from .disk import Certificate, Disk, Faces, PerVertex
from .linear import Dirichlet, assemble, half_angle_squares, opposite_edges


class BijectivityError(ValueError):
    """A map that must be a bijection folds, and the repair could not unfold it."""


class RepairWarning(UserWarning):
    """The result was reached by steps that depart from the plain method, or has faces that stay
    flipped; the message says which."""


def check_bijective(z: PerVertex, faces: Faces, f: PerVertex) -> Certificate:
    """Decide whether the piecewise linear map z -> f of a triangulated disk is a bijection onto its
    image.

    It is one when every triangle keeps its positive orientation and the boundary's image is a
    simple polygon run once counter-clockwise. Decided without rounding, in exact arithmetic where
    in doubt; a triangle without area counts as flipped. BeltramiError where the source mesh is
    folded or is not a disk.
    """
    return Disk(z, faces).certify(f)


def check_embedding(faces: Faces, f: PerVertex) -> Certificate:
    """The certificate of a planar picture f of a triangulated disk, whatever its source (a surface,
    say)."""
    return Disk(f, faces).certificate


def mean_value_matrix(disk, lengths):
    """Floater's mean-value matrix (V, V) of edge lengths (F, 3) opposite the corners: u_i - an
    average of neighbours.

    The weights `(tan(a/2) + tan(b/2)) / |e_ij|`, normalised, are positive: where all rows are of
    this kind and the boundary is convex, the map is a bijection (Tutte, Floater).
    """
    upper, lower = half_angle_squares(lengths)
    smallest = 1e-24 * (lower + lengths**2)
    half = np.sqrt(np.maximum(upper, smallest) / np.maximum(lower, smallest))  # tan(a/2)
    blocks = np.zeros((len(disk.faces), 3, 3))
    for corner in range(3):
        following, last = (corner + 1) % 3, (corner + 2) % 3
        blocks[:, corner, following] = -half[:, corner] / lengths[:, last]
        blocks[:, corner, last] = -half[:, corner] / lengths[:, following]
    matrix = assemble(disk.faces, blocks, len(disk.z)).tocsr()
    total = -np.asarray(matrix.sum(1)).ravel()
    matrix.setdiag(total)
    matrix.data /= np.repeat(total, np.diff(matrix.indptr))
    return matrix


def repair(matrix, disk, lengths, before=()):
    """Unfold a Dirichlet solution, a `Disk`, by row switching: (`Disk`, switched vertices, last
    Dirichlet or None, how often it was solved again).

    The interior vertices of flipped faces get mean-value rows, and the problem is solved again with
    the same boundary values; where a flip survives on switched rows, the next ring is switched.
    With all rows switched and a convex boundary this is Floater's theorem. Not certified. before:
    rows switched already. The Dirichlet problem is None where no face is flipped.
    """
    average = dirichlet = None
    switched = np.zeros(len(disk.z), bool)
    switched[np.asarray(before, int)] = True
    for rounds in range(30):
        # The inner vertices of flipped faces; where all have switched, one ring more, as long as
        # there is one.
        wanted = _interior(disk, disk.maybe_flipped)
        reached = 0
        while wanted.sum() > reached and not (wanted & ~switched).any():
            wanted, reached = _interior(disk, wanted[disk.faces].any(1)), wanted.sum()
        if not (wanted & ~switched).any():
            return disk, np.flatnonzero(switched), dirichlet, rounds
        switched |= wanted
        average = mean_value_matrix(disk, lengths) if average is None else average
        own = sparse.diags_array(np.where(switched, 0.0, 1 / matrix.diagonal()))
        mixed = own @ matrix + sparse.diags_array(switched.astype(float)) @ average
        dirichlet = Dirichlet(mixed, disk.loop)
        disk = disk.at(dirichlet.solve(disk.z[disk.loop]))
    return disk, np.flatnonzero(switched), dirichlet, 30


def _interior(disk, some):
    """Which vertices of some faces lie inside the mesh, (V,) bool."""
    marked = np.zeros(len(disk.z), bool)
    marked[disk.faces[some]] = True
    marked[disk.loop] = False
    return marked


def unfold(solver, f):
    """A solver's last map f (V,), or a Möbius map after it, repaired in the metric of mu: (f,
    switched vertices, rounds of the repair)."""
    disk = solver.disk
    picture = disk.at(f)
    if not len(picture.maybe_flipped):
        return f, np.zeros(0, int), 0
    # Lengths in the metric |dz + mu conj(dz)|.
    sides = opposite_edges(disk.z[disk.faces])
    lengths = abs(sides + solver.mu[:, None] * sides.conj())
    picture, rows, _, rounds = repair(disk.stiffness(solver.mu), picture, lengths)
    return picture.z.copy(), rows, rounds
