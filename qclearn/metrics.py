"""What reports and tables say about a map: the size of its coefficient, its landmark errors, the paper's losses."""

import numpy as np
from scipy import sparse

from .beltrami import signed_areas, stiffness


def coefficient_statistics(mu):
    """Mean, standard deviation and maximum of |mu| over the faces of the moving mesh."""
    size = abs(mu)
    return {"mean_abs_mu": float(size.mean()), "sd_abs_mu": float(size.std()), "max_abs_mu": float(size.max())}


def curve_rows(names, before, after, millimetres):
    """Per curve: its name and mean errors before (best Möbius map) and after, in the disk and in millimetres.

    The errors (10 K,) are those of the landmarks, curve after curve.
    """
    means = [errors.reshape(len(names), -1).mean(1).tolist() for errors in (before, after, millimetres)]
    keys = "name", "landmark_error_before", "landmark_error", "landmark_error_mm"
    return [dict(zip(keys, row)) for row in zip(names, *means)]


def mean_rows(rows):
    """Means over the curves of the errors that their rows hold, each over the curves that have it."""
    keys = ["landmark_error_before", "landmark_error", "landmark_error_mm", "landmark_error_true"]
    found = {key: [row[key] for row in rows if key in row] for key in keys}
    return {key: float(np.mean(values)) for key, values in found.items() if values}


def measured_losses(z, faces, mu, mapped, target, alpha, beta, gamma):
    """The paper's loss of a map and its terms, whatever found the map: L_mu, L_grad_mu, L_Landmark and L_CP.

    mu (F,) is the map's measured coefficient on the disk mesh z, faces; mapped, target (M,) its landmarks.
    `L_mu = (1/pi) sum |T| |mu_T|^2`; for `L_grad_mu = (1/pi) int |grad mu|^2` mu is made piecewise linear by averages
    over the faces around each vertex, by area. Source: paper, eqs. muloss, musmooth, lmloss, RegLoss.
    """
    areas = signed_areas(z, faces)
    corners = sparse.csr_array((np.repeat(areas, 3), (faces.ravel(), np.repeat(np.arange(len(faces)), 3))))
    nodal = (corners @ mu) / corners.sum(1)
    terms = {"L_mu": float(areas @ abs(mu) ** 2) / np.pi,
             "L_grad_mu": float((nodal.conj() @ (stiffness(z, faces, np.zeros(len(faces))) @ nodal)).real) / np.pi,
             "L_Landmark": float((abs(mapped - target) ** 2).mean())}
    return terms | {"L_CP": alpha * terms["L_mu"] + beta * terms["L_grad_mu"] + gamma * terms["L_Landmark"]}
