"""Figures of one map for a row of the benchmark, and the difference of two runs' figures."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from ..plane.linear import corner_angles, edge_lengths
from ..registration.curves import weigh_edges
from ..registration.report import coefficient_statistics, log2_distortions


def coefficient_measures(surface, disk, mu):
    """Statistics of |mu| over the faces of the moving mesh: each face counts once, as in the
    paper's table; by its area in the disk for `_disk`, in space for `_area`. Infinite where a
    face's orientation is exactly reversed."""
    size = abs(mu)
    result = {**coefficient_statistics(mu), "p95_abs_mu": float(np.percentile(size, 95))}
    for name, areas in (("disk", disk.areas), ("area", surface.face_areas)):
        mean = np.average(size, weights=areas)
        result[f"mean_abs_mu_{name}"] = float(mean)
        result[f"sd_abs_mu_{name}"] = float(np.sqrt(np.average((size - mean) ** 2, weights=areas)))
    return result


def landmark_measures(mapped, target, off_mm):
    """Mean and standard deviation over landmarks of their distance from the target: in the disk,
    and in mm (M,)."""
    off = abs(mapped - target)
    return {
        "landmark_error": float(off.mean()),
        "sd_landmark_error": float(off.std()),
        "landmark_error_mm": float(np.mean(off_mm)),
        "sd_landmark_error_mm": float(np.std(off_mm)),
    }


def near_curves(surface, curves, reach):
    """Whether vertices (V,) lie within `reach` of one of the curves (vertex paths) along the
    surface's edges."""
    lengths = weigh_edges(surface, np.ones(len(surface.vertices)))
    graph = csr_array((lengths, tuple(surface.edges.T)), shape=(len(surface.vertices),) * 2)
    starts = np.unique(np.concatenate(curves))
    return dijkstra(graph, directed=False, indices=starts, limit=reach, min_only=True) <= reach


def correspondence_measures(points, truth, near):
    """Distance in mm of points (V, 3) from the true ones; the last mean is over `near` (V,), near
    primary sulci."""
    off = np.linalg.norm(points - truth, axis=1)
    return {
        "correspondence_mm": float(off.mean()),
        "median_correspondence_mm": float(np.median(off)),
        "p95_correspondence_mm": float(np.percentile(off, 95)),
        "correspondence_sulci_mm": float(off[near].mean()),
    }


def distortion_measures(surface, points):
    """Distortion of the registration in space, moving surface -> points (V, 3) on the control.

    `angle_distortion`: mean over corners of |angle there - angle here|, degrees; `area_distortion`:
    `log2_area`, its mean over the area.
    """
    here = corner_angles(surface.edge_lengths)
    there = corner_angles(edge_lengths(points[surface.faces]))
    return {
        "angle_distortion": float(np.degrees(abs(there - here)).mean()),
        "area_distortion": log2_distortions(surface, points)["log2_area"][0],
    }
