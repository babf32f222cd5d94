"""How much like cortex a surface is: 29 measurements and their ranges on real hemispheres.

The ranges are minimum to maximum over nine surfaces (pial, white and middle) of seven hemispheres
of six people from open data (pycortex S1, fsbrain subject1, the demonstration brain of Choi's disk
maps, bilgelm's pial surface, two white surfaces of HUVA), padded by about 5 %. Rows on topology,
triangles and self-intersection are demands on a mesh instead. An average brain such as fsaverage5
is too smooth and misses several rows. No row sees the large-scale shape: look at the surface too.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from qclearn.interrupts import signals_wait
from qclearn.surfaces.curvature import mean_curvature, sulcal_depth
from qclearn.surfaces.surface import Surface, require_outward

from .folding_measures import (
    facing_distance,
    fold_spectrum,
    pits_and_fundi,
    principal_curvatures,
    smooth,
    spectral_centroid,
    spectral_peak,
)
from .intersections import self_intersections

# Folding is measured at this resolution, so that meshes of 10,000 to 160,000 compare.
CANONICAL_VERTICES = 10_000
BURIED = 0.012  # deeper than this, in units of sqrt(hull area), counts as buried

TARGETS = {
    "euler_characteristic": (1, 1),
    "boundary_loops": (1, 1),
    "nonmanifold_edges": (0, 0),
    "self_intersecting_faces": (0, 0.005),  # share of the faces
    "minimum_angle_5": (14.5, 60),  # degrees, lowest 5 % of faces
    "degenerate_faces": (0, 0),
    "dihedral_flips": (0, 0.01),  # share of the edges bent by more than 120 degrees
    "gyrification_index": (1.7, 2.7),
    "curvature_sd": (27, 37),
    "curvature_skew": (-0.75, 0.25),
    "curvature_5": (-58, -42),
    "curvature_50": (-4, 18.5),
    "curvature_95": (41, 59),
    "concave_area": (0.3, 0.53),
    "curvedness_50": (16.5, 23.5),
    "curvedness_95": (50, 63),
    "mean_depth": (0.019, 0.028),
    "depth_95": (0.069, 0.088),
    "buried_area": (0.44, 0.63),
    "occluded_area": (0.45, 0.64),
    "sulcal_width": (0.0055, 0.03),
    "curvature_depth_correlation": (-0.68, -0.55),
    "pits": (30, 66),
    "fundus_length": (3.1, 6.9),
    "peak_wavelength": (0.069, 0.094),
    "centroid_wavelength": (0.081, 0.112),
    "long_wave_power": (0.004, 0.035),
    "saddle_area": (0.05, 0.09),
    "saddle_ridge_area": (0.07, 0.108),
}


class Row(NamedTuple):
    """One metric beside its target range."""

    name: str
    value: float
    low: float
    high: float
    inside: bool


def realism(surface):
    """The metrics of `TARGETS` for an outward surface, dict name -> number, free of units.

    With L = sqrt(area): curvatures times L, fundus length, widths and wavelengths over L; depths
    over sqrt(area of the convex hull); areas as shares of the patch. All but topology, triangles
    and self-intersection are taken after quadric decimation to about 10,000 vertices. SurfaceError
    if the surface looks inward.
    """
    require_outward(surface)
    patch = _canonical(surface)
    hull = ConvexHull(surface.vertices).area
    metrics = mesh_metrics(surface) | {"gyrification_index": surface.area / hull}
    inside = np.ones(len(patch.vertices), bool)
    for loop in patch.boundary_loops:
        inside[loop] = False
    length, share = np.sqrt(patch.area), patch.vertex_areas / patch.area
    curvature, depth = low_pass_curvature(patch), sulcal_depth(patch)
    metrics |= _curvature_metrics(curvature * length, share, inside)
    metrics |= _bending_metrics(patch, share, inside)
    metrics |= _depth_metrics(patch, depth, depth / np.sqrt(hull), share)
    metrics["curvature_depth_correlation"] = _correlation(curvature[inside], depth[inside])
    wavelengths, power = fold_spectrum(patch, curvature)
    metrics["peak_wavelength"] = spectral_peak(wavelengths, power)
    metrics["centroid_wavelength"] = spectral_centroid(wavelengths, power)
    metrics["long_wave_power"] = power[wavelengths > 0.5].sum()
    return {name: float(metrics[name]) for name in TARGETS}


def mesh_metrics(surface):
    """The rows on topology, self-intersection and triangle shape, dict, without decimation."""
    corners = surface.vertices[surface.faces]
    to_next, to_last = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    normal = np.cross(to_next[:, 0], to_last[:, 0])
    angle = np.arctan2(
        np.linalg.norm(normal, axis=1)[:, None], np.einsum("fck,fck->fc", to_next, to_last)
    )
    return {
        "euler_characteristic": surface.euler_characteristic,
        "boundary_loops": len(surface.boundary_loops),
        "nonmanifold_edges": 0,  # Surface refuses them
        "self_intersecting_faces": len(self_intersections(surface.vertices, surface.faces))
        / len(surface.faces),
        "minimum_angle_5": np.degrees(np.percentile(angle.min(axis=1), 5)),
        "degenerate_faces": (surface.face_areas < 1e-6 * surface.face_areas.mean()).sum(),
        "dihedral_flips": np.mean(_bend_cosines(surface.faces, normal) < -0.5),
    }


def _bend_cosines(faces, normal):
    """Cosine of the angle between the normals of the two faces at each inner edge."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    same = (ends[order[1:]] == ends[order[:-1]]).all(axis=1)
    one, two = (normal[order[part][same] // 3] for part in (np.s_[1:], np.s_[:-1]))
    return (one * two).sum(axis=1) / (np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1))


@signals_wait()  # PyVista imports where it is used
def _canonical(surface):
    if len(surface.vertices) <= 1.05 * CANONICAL_VERTICES:
        return surface
    import pyvista

    mesh = pyvista.PolyData.from_regular_faces(surface.vertices, surface.faces)
    mesh = mesh.decimate(1 - 2 * CANONICAL_VERTICES / len(surface.faces))
    return Surface(mesh.points, mesh.regular_faces)


def low_pass_curvature(surface):
    """Mean curvature (V,), 0.2 % cut at each end, smoothed over 0.006 L; 1/length."""
    curvature = mean_curvature(surface)
    return smooth(
        surface,
        np.clip(curvature, *np.percentile(curvature, [0.2, 99.8])),
        0.006 * np.sqrt(surface.area),
    )


def _curvature_metrics(curvature, share, inside):
    values, weights = curvature[inside], share[inside]
    mean = np.average(values, weights=weights)
    spread = np.sqrt(np.average((values - mean) ** 2, weights=weights))
    low, middle, high = weighted_percentiles(values, weights, [5, 50, 95])
    return {
        "curvature_sd": spread,
        # the spread over vertices, not over area, in the denominator: the range was measured so
        "curvature_skew": np.average(((values - mean) / values.std()) ** 3, weights=weights),
        "curvature_5": low,
        "curvature_50": middle,
        "curvature_95": high,
        "concave_area": share[curvature < 0].sum(),
    }


def _bending_metrics(patch, share, inside):
    """Curvedness and shape index of Koenderink and van Doorn (1992), the index in nine equal bins
    from cup to cap."""
    k1, k2 = principal_curvatures(patch)
    curvedness = np.sqrt((k1**2 + k2**2) / 2 * patch.area)
    index = 2 / np.pi * np.arctan2(k1 + k2, k1 - k2)
    bins = (
        np.histogram(index[inside], np.linspace(-1, 1, 10), weights=share[inside])[0]
        / share[inside].sum()
    )
    middle, high = weighted_percentiles(curvedness[inside], share[inside], [50, 95])
    return {
        "curvedness_50": middle,
        "curvedness_95": high,
        "saddle_area": bins[4],
        "saddle_ridge_area": bins[5],
    }


def _correlation(a, b):
    return np.corrcoef(a, b)[0, 1] if np.ptp(a) > 0 and np.ptp(b) > 0 else np.nan


def _depth_metrics(patch, depth, relative, share):
    """Rows on sulci; `relative` is the depth in units of sqrt(hull area)."""
    length, buried = np.sqrt(patch.area), relative > BURIED
    gap = facing_distance(patch, 0.0015 * length) / length
    between_banks = gap[buried & (gap < 0.12)]
    smoothed = smooth(patch, depth, 0.004 * length) / length
    pits, fundus_length = pits_and_fundi(patch, smoothed, deep=0.012, persistence=0.006)
    return {
        "mean_depth": share @ relative,
        "depth_95": weighted_percentiles(relative, share, [95])[0],
        "buried_area": share[buried].sum(),
        "occluded_area": share[np.isfinite(gap)].sum(),
        "sulcal_width": np.median(between_banks) if len(between_banks) else np.nan,
        "pits": pits,
        "fundus_length": fundus_length / length,
    }


def weighted_percentiles(values, weights, percent):
    """Percentiles of weighted values (k,), linear between the middles of the sorted weights."""
    order = np.argsort(values)
    share = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(np.asarray(percent) / 100 * weights.sum(), share, values[order])


def score(metrics):
    """The metrics beside their ranges, a list of `Row`; what cannot be measured (NaN) is outside."""
    return [
        Row(name, metrics[name], low, high, bool(low <= metrics[name] <= high))
        for name, (low, high) in TARGETS.items()
    ]
