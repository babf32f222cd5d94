"""What reports and tables say about a map: its coefficient, its errors, its distortion, the paper's
losses."""

import numpy as np

from ..plane.linear import around_vertices, face_areas

# Errors of a landmark or a curve, before the fit (best Möbius map) and after it, in the disk and in
# mm.
ERRORS = ("landmark_error_before", "landmark_error", "landmark_error_mm")
SMALLEST_RATIO = 1e-6  # of a face's area to its share, where it is measured
SMALLEST_IN_FILES = 1e-9  # of areas that coordinates of float32 bear out


def coefficient_statistics(mu):
    """Mean, standard deviation and maximum of |mu| over the faces of the moving mesh."""
    size = abs(mu)
    return {
        "mean_abs_mu": float(size.mean()),
        "sd_abs_mu": float(size.std()),
        "max_abs_mu": float(size.max()),
    }


def mean_rows(rows):
    """The mean of each error over the rows of the curves that have it."""
    keys = [*ERRORS, "landmark_error_true"]
    columns = {key: [row[key] for row in rows if key in row] for key in keys}
    return {key: float(np.mean(values)) for key, values in columns.items() if values}


def measured_losses(problem, weights, mu, mapped):
    """The paper's loss and its terms, L_mu, L_grad_mu, L_Landmark, L_CP, of a map's measured mu
    (F,) and its landmarks `mapped` (M,).

    `L_mu = (1/pi) sum |T| |mu_T|^2`; for `L_grad_mu = (1/pi) int |grad mu|^2` mu is made piecewise
    linear by averages over the faces around each vertex, by area. Source: paper, eqs. muloss,
    musmooth, lmloss, RegLoss.
    """
    disk = problem.disk
    nodal = disk.to_vertices @ mu
    terms = {
        "L_mu": float(disk.areas @ abs(mu) ** 2) / np.pi,
        "L_grad_mu": float((nodal.conj() @ (disk.laplace @ nodal)).real) / np.pi,
        "L_Landmark": float((abs(mapped - problem.target) ** 2).mean()),
    }
    return terms | {"L_CP": sum(factor * terms[name] for name, factor in weights.factors.items())}


def log2_distortions(surface, points):
    """How much the registration stretches, moving surface -> points (V, 3): [mean, 95 %] over the
    surface's area.

    `log2_area`: |log2 J|, J the ratio of areas, at least `SMALLEST_RATIO`, total areas made equal;
    `log2_shape`: log2 of the ratio of the principal stretches, `(1 + |mu|) / (1 - |mu|)`.
    """
    weights = surface.face_areas / surface.area
    return {
        name: [float(weights @ values), quantile(values, weights)]
        for name, values in _log2_stretches(surface, points).items()
    }


def distortion_quantiles(surface, points):
    """The same, its values at 50, 95 and 100 % of the area: name -> {"50", "95", "100"}."""
    weights = surface.face_areas / surface.area
    return {
        name: {str(share): quantile(values, weights, share / 100) for share in (50, 95, 100)}
        for name, values in _log2_stretches(surface, points).items()
    }


def _log2_stretches(surface, points):
    area, shape = stretches(surface.vertices, surface.faces, points)
    area = np.maximum(area / (surface.face_areas @ area / surface.area), SMALLEST_RATIO)
    return {"log2_area": abs(np.log2(area)), "log2_shape": np.log2(shape)}


def distortion_maps(vertices, faces, images):
    """Areal and shape distortion at the vertices (V, 3) that go to `images` (V, 3), (V,) each, as
    Workbench has them.

    Areal: log2 J, J the ratio of the areas around a vertex, at least `SMALLEST_IN_FILES`
    (`wb_command -surface-distortion`); shape: log2 of the mean, over the faces around a vertex, of
    the ratio of the principal stretches (its `-local-affine-method -log2`). Total areas are left as
    they are.
    """
    area, shape = stretches(vertices, faces, images)
    before = face_areas(vertices, faces)
    ratio = around_vertices(before * area, faces) / around_vertices(before, faces)
    mean_shape = around_vertices(shape, faces) / np.bincount(faces.ravel())
    return np.log2(np.maximum(ratio, SMALLEST_IN_FILES)), np.log2(mean_shape)


def stretches(vertices, faces, images):
    """Ratios of the areas, and of the principal stretches, `(1 + |mu|) / (1 - |mu|)`, of a map of
    faces, (F,) each."""
    p = _flattened(vertices[faces])
    q = _flattened(images[faces])
    # On each face the map is w -> a w + b conj(w).
    double_area = p[0] * p[1].conj() - p[1] * p[0].conj()
    a = (q[0] * p[1].conj() - q[1] * p[0].conj()) / double_area
    b = (q[1] * p[0] - q[0] * p[1]) / double_area
    mu = np.minimum(abs(b) / np.maximum(abs(a), np.finfo(float).tiny), 1 - SMALLEST_RATIO)
    return abs(a) ** 2 - abs(b) ** 2, (1 + mu) / (1 - mu)


def _flattened(corners):
    """Two edges of each face (F, 3, 3), from its first corner, in its plane: complex (2, F)."""
    first = corners[:, 1] - corners[:, 0]
    second = corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(first, axis=1)
    along = first / np.maximum(length, np.finfo(float).tiny)[:, None]
    x = (second * along).sum(1)
    return np.stack([length + 0j, x + 1j * np.linalg.norm(second - x[:, None] * along, axis=1)])


def quantile(values, shares, share=0.95):
    """The value of (F,) below which `share` of the area lies; shares (F,): of the area."""
    order = np.argsort(values)
    rank = np.searchsorted(np.cumsum(shares[order]), share)
    return float(values[order[min(rank, len(order) - 1)]])  # rounding may leave the sum below 1
