"""Nested dissection: an order of elimination for the sparse systems of a planar mesh.

The study of sizes measures the harmonic map with it. The library leaves the order to SuperLU's
minimum degree, which does as well on small meshes and better on the matrices of folded surfaces.
"""

import numpy as np

LEAF = 16  # vertices of a part that is halved no further


def elimination_order(matrix, points, loop):
    """The vertices but the boundary loop, ordered for small factors of a mesh's matrix; points (V,)
    complex or (V, d).

    A part is halved across its longer side; the vertices of one half with a neighbour in the other
    come last. Source: George (1973), Nested dissection of a regular element mesh.
    """
    inner = np.setdiff1d(np.arange(len(points)), loop)
    matrix, points = matrix.tocsr()[inner][:, inner], points[inner]
    points = np.stack([points.real, points.imag], 1) if np.iscomplexobj(points) else points
    starts, neighbours, other = matrix.indptr, matrix.indices, np.zeros(len(points), bool)

    def ordered(part):
        if len(part) <= LEAF:
            return [part]
        own = points[part]
        along = own[:, np.ptp(own, axis=0).argmax()]
        halves, middle = np.argpartition(along, len(part) // 2), len(part) // 2
        one, two = part[halves[:middle]], part[halves[middle:]]
        counts = starts[one + 1] - starts[one]
        entries = np.arange(counts.sum()) + np.repeat(starts[one] - np.cumsum(counts) + counts, counts)
        other[two] = True
        touching = np.zeros(len(one), bool)
        touching[np.repeat(np.arange(len(one)), counts)[other[neighbours[entries]]]] = True
        other[two] = False
        return [*ordered(one[~touching]), *ordered(two), one[touching]]

    return inner[np.concatenate(ordered(np.arange(len(points))))]
