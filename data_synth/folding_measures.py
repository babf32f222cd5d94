"""Measurements of a folded sheet: smoothing, bending, gaps, fold wavelengths, sulcal pits."""

import numpy as np
from scipy import sparse

from qclearn.interrupts import signals_wait
from qclearn.plane.linear import factorise, heat_flow

from .cortex import vertex_normals


def smooth(surface, values, length, steps=3):
    """Values (V,) after heat flow over the surface for the time length^2, a low pass."""
    mass = sparse.diags_array(surface.vertex_areas)
    return heat_flow(mass, length**2 / steps * surface.stiffness, mass @ values, steps)


def principal_curvatures(surface, rings=4):
    """Both principal curvatures (V,), k1 >= k2, positive where an outward surface is convex.

    From a quadric through the vertex, fitted by least squares to the neighbours within `rings`
    edges whose normals do not oppose its own (Cazals and Pouget 2005; the neighbourhood of Panozzo
    et al. 2010).
    """
    normal = vertex_normals(surface.vertices, surface.faces)
    centre, other = _ring_pairs(surface, rings)
    facing = np.einsum("pk,pk->p", normal[centre], normal[other]) > 0
    enough = np.bincount(centre[facing], minlength=len(normal)) >= 6
    keep = facing | ~enough[centre]
    centre, other = centre[keep], other[keep]
    across = np.eye(3)[abs(normal).argmin(axis=1)]
    x_axis = np.cross(normal, across)
    x_axis /= np.linalg.norm(x_axis, axis=1, keepdims=True)
    frame = np.stack([x_axis, np.cross(normal, x_axis), normal], axis=1)
    # Heights and distances in this unit: well-conditioned sums.
    scale = np.sqrt(surface.vertex_areas)
    offset = (surface.vertices[other] - surface.vertices[centre]) / scale[centre, None]
    u, v, height = np.einsum("pak,pk->ap", frame[centre], offset)
    quadric = _least_squares(
        np.stack([u * u, u * v, v * v, u, v], axis=1), height, centre, len(normal)
    )
    return tuple(k / scale for k in _bending(*quadric.T))


def _ring_pairs(surface, rings):
    """All ordered pairs of different vertices at most `rings` edges apart: two index arrays."""
    a, b = surface.edges.T
    n = len(surface.vertices)
    near = sparse.coo_array(
        (np.ones(2 * len(a), bool), (np.r_[a, b], np.r_[b, a])), shape=(n, n)
    ).tocsr()
    near = reach = near + sparse.eye_array(n, dtype=bool, format="csr")
    for _ in range(rings - 1):
        reach = reach @ near
    centre, other = reach.nonzero()
    return centre[centre != other], other[centre != other]


def _least_squares(design, target, group, n_groups):
    """Solutions (n_groups, k) of one least-squares problem per group, with a small ridge."""

    def total(values):
        return np.bincount(group, values, n_groups)

    k = design.shape[1]
    matrix = np.array(
        [[total(design[:, i] * design[:, j]) for j in range(k)] for i in range(k)]
    ).transpose(2, 0, 1)
    right = np.array([total(design[:, i] * target) for i in range(k)]).T
    ridge = 1e-12 * np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(k)
    return np.linalg.solve(matrix + ridge, right[..., None])[..., 0]


def _bending(a, b, c, d, e):
    """Principal curvatures at 0 of a u^2 + b uv + c v^2 + d u + e v, positive if it bends down."""
    g11, g12, g22 = 1 + d * d, d * e, 1 + e * e
    determinant = 1 + d * d + e * e
    h11, h12, h22 = (-x / np.sqrt(determinant) for x in (2 * a, b, 2 * c))
    mean = (h11 * g22 - 2 * h12 * g12 + h22 * g11) / (2 * determinant)
    gauss = (h11 * h22 - h12 * h12) / determinant
    spread = np.sqrt(np.maximum(mean**2 - gauss, 0))
    return mean + spread, mean - spread


def facing_distance(surface, start):
    """Distance (V,) from each vertex along its outward normal to the next sheet, or infinity.

    The ray begins at the distance `start`, so that it leaves its own faces. At a buried vertex: the
    sulcal width.
    """
    with signals_wait():  # PyVista imports where it is used
        import pyvista
        from vtkmodules.vtkCommonCore import reference
        from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator

        mesh = pyvista.PolyData.from_regular_faces(surface.vertices, surface.faces)
    locator = vtkStaticCellLocator()
    locator.SetDataSet(mesh)
    locator.BuildLocator()
    normal = vertex_normals(surface.vertices, surface.faces)
    reach = 2 * np.ptp(surface.vertices, axis=0).max()
    distance = np.full(len(normal), np.inf)
    t, hit, local, part = reference(0.0), [0.0] * 3, [0.0] * 3, reference(0)
    begins, ends = surface.vertices + start * normal, surface.vertices + reach * normal
    for i, (begin, end) in enumerate(zip(begins, ends)):
        if locator.IntersectWithLine(begin, end, 1e-9, t, hit, local, part):
            distance[i] = np.linalg.norm(hit - surface.vertices[i])
    return distance


def fold_spectrum(surface, values):
    """Power of a map over wavelength in sqrt(area): (wavelengths (25,), shares of power (25,)).

    Band-pass filters `(4 x / (1 + x)^2)^4`, x = eigenvalue / centre, of the Laplace-Beltrami
    operator at 25 centres with wavelength 2 pi / sqrt(eigenvalue) from 0.04 to 1.2: rational, so
    that sparse solves replace eigenvectors.
    """
    mass, stiffness = surface.vertex_areas, surface.stiffness
    wavelengths = np.geomspace(0.04, 1.2, 25)
    power = []
    for centre in (2 * np.pi / wavelengths) ** 2 / surface.area:
        factors = factorise(sparse.diags_array(mass) + stiffness / centre)
        band = values - np.average(values, weights=mass)
        for _ in range(4):
            band = 4 * factors.solve(stiffness @ factors.solve(mass * band)) / centre
        power.append(mass @ band**2)
    return wavelengths, np.array(power) / np.sum(power)


def spectral_peak(wavelengths, power):
    """Wavelength of the highest power, by a parabola through its neighbours in log wavelength."""
    top = int(np.clip(np.argmax(power), 1, len(power) - 2))
    left, middle, right = power[top - 1 : top + 2]
    shift = np.clip(0.5 * (left - right) / (left - 2 * middle + right), -1, 1)
    return float(wavelengths[top] * (wavelengths[1] / wavelengths[0]) ** shift)


def spectral_centroid(wavelengths, power):
    """Mean wavelength by power, in log wavelength."""
    return float(np.exp(np.average(np.log(wavelengths), weights=power)))


def pits_and_fundi(surface, depth, deep, persistence):
    """Number of sulcal pits and total length of the fundus lines of a depth map (V,).

    The region deeper than `deep` is flooded from the bottom up (Meng et al. 2014, Le Guen et al.
    2018). A pit is a maximum of depth that rises by more than `persistence` above the saddle where
    it joins a deeper one, or above `deep`; the fundus lines are the steepest ascents from both
    sides of every such saddle, each edge counted once.
    """
    a, b = surface.edges.T
    matrix = sparse.coo_array((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a]))).tocsr()
    neighbours = np.split(matrix.indices, matrix.indptr[1:-1])
    pits, saddles = _merge_tree(depth, neighbours, deep, persistence)
    ascent = [near[np.argmax(depth[near])] for near in neighbours]
    walked, length = set(), 0.0
    for saddle, side in saddles:
        here, there = saddle, side
        while (min(here, there), max(here, there)) not in walked:
            walked.add((min(here, there), max(here, there)))
            length += np.linalg.norm(surface.vertices[here] - surface.vertices[there])
            if depth[ascent[there]] <= depth[there]:
                break
            here, there = there, ascent[there]
    return pits, float(length)


def _merge_tree(depth, neighbours, deep, persistence):
    """Persistent maxima, and (saddle, deepest neighbour) for both sides of every join."""
    parent, peak, pits, saddles = {}, {}, 0, []

    def root(vertex):
        while parent[vertex] != vertex:
            parent[vertex] = vertex = parent[parent[vertex]]
        return vertex

    for i in np.argsort(-depth, kind="stable"):
        if depth[i] < deep:
            break
        sides = {}
        for j in neighbours[i]:
            if j in parent:
                r = root(j)
                sides[r] = max(sides.get(r, j), j, key=lambda vertex: depth[vertex])
        parent[i] = i
        if not sides:
            peak[i] = depth[i]
            continue
        deepest, *others = sorted(sides, key=lambda r: -peak[r])
        parent[i] = deepest
        for r in others:
            pits += peak[r] - depth[i] > persistence
            saddles += [(i, sides[r]), (i, sides[deepest])]
            parent[r] = deepest
    pits += sum(peak[r] > deep + persistence for r in parent if parent[r] == r)
    return int(pits), saddles
