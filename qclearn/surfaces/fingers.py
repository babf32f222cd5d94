"""Fingers: blind tubes that a reconstruction left on a surface. Along a tube of radius r the
conformal factor falls like exp(-length / r), so that its tip would vanish in the disk."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra

from ..plane.linear import Dirichlet
from .units import size_of

SMALLEST = 1e-6  # edge in the unit disk: of folded cortex the shortest is 2e-5
SHRUNK = 1e-2  # of its length on the surface, both of area pi: else an edge is short in space
REACH = 1e-3  # in the unit disk, around the shortest edge: a finger's vertices
OUTWARD = 100.0  # weight of a neighbour straight towards the root, over one as deep


def find_fingers(surface, z):
    """The fingers of a surface in its disk map z (V,), arrays of inner vertices, [] if no inner
    edge is shorter than SMALLEST and SHRUNK: around the shortest one the connected piece within
    REACH, then of what is left. A piece that reaches the boundary is none: a narrow end of the
    surface."""
    inner = np.ones(len(z), bool)
    inner[surface.boundary] = False
    left = np.ones(len(z), bool)
    one, two = surface.edges.T
    length = abs(z[one] - z[two])
    short = (length < SMALLEST) & inner[one] & inner[two]
    some = np.flatnonzero(short)
    in_space = np.linalg.norm(surface.vertices[one[some]] - surface.vertices[two[some]], axis=1)
    short[some] = length[some] < SHRUNK * np.sqrt(np.pi / surface.area) * in_space
    fingers = []
    while short.any():
        tip = one[short][length[short].argmin()]
        near = left & (abs(z - z[tip]) < REACH)
        joined = near[one] & near[two]
        graph = _graph(one[joined], two[joined], np.ones(joined.sum()), len(z))
        label = connected_components(graph)[1]
        piece = near & (label == label[tip])
        if inner[piece].all():
            fingers.append(np.flatnonzero(piece))
        left &= ~piece
        short &= left[one] & left[two]
    return fingers


def opened_rows(surface, fingers, matrix):
    """A matrix (V, V) whose rows at the fingers' vertices are averages of their neighbours, those
    nearer to the root with more weight: OUTWARD ** cos, cos an edge's steepness over that of the
    steepest edge there. Weights stay positive, as Floater's theorem asks, and each ring of a tube
    hardly shrinks against the ring before it.

    Nearer is where u, `K u` the areas inside and 0 at the root, is lower: heat flows straight along
    each tube, also along one that leaves another, where shortest paths to the root all meet.
    """
    inside = np.zeros(len(surface.vertices), bool)
    inside[np.concatenate(fingers)] = True
    heat = Dirichlet(surface.stiffness, np.flatnonzero(~inside))
    u = heat.solve(0.0, np.where(inside, surface.vertex_areas, 0.0)).real
    i, j = np.concatenate([surface.edges, surface.edges[:, ::-1]]).T
    i, j = i[inside[i]], j[inside[i]]
    slope = (u[i] - u[j]) / np.linalg.norm(surface.vertices[i] - surface.vertices[j], axis=1)
    steepest = np.zeros(len(u))
    np.maximum.at(steepest, i, abs(slope))
    weights = OUTWARD ** (slope / steepest[i])
    averages = sparse.csr_array((weights, (i, j)), shape=matrix.shape)
    averages = sparse.diags_array(averages.sum(1)) - averages
    return sparse.diags_array(1.0 - inside) @ matrix + averages


def uniform_matrix(surface):
    """Tutte's matrix (V, V): each vertex the average of its neighbours."""
    one, two = surface.edges.T
    adjacent = _graph(one, two, np.ones(len(one)), len(surface.vertices))
    adjacent = adjacent + adjacent.T
    return sparse.diags_array(adjacent.sum(1)) - adjacent


def finger_message(surface, finger):
    """Where a finger is: its vertices, length, and mean place in space."""
    unit = size_of(surface).unit
    unit = f" {unit}" if unit else ""
    place = ", ".join(f"{x:.0f}" if unit else f"{x:.2g}" for x in surface.vertices[finger].mean(0))
    # Its depth: the longest of the shortest edge paths out of it.
    one, two = surface.edges.T
    lengths = np.linalg.norm(surface.vertices[one] - surface.vertices[two], axis=1)
    graph = _graph(one, two, lengths, len(surface.vertices))
    outside = np.setdiff1d(np.arange(len(surface.vertices)), finger)
    length = dijkstra(graph, directed=False, indices=outside, min_only=True)[finger].max()
    return (
        f"a finger of {len(finger)} vertices, {length:.3g}{unit} long, near ({place}){unit}: the "
        "map is not conformal there, and the fit leaves it out"
    )


def _graph(one, two, values, count):
    return sparse.csr_array((values, (one, two)), shape=(count, count))
