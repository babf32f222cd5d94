"""The template hemisphere: hull, medial wall, sulci and random diffeomorphisms.

Frame: x lateral, y anterior, z superior, the same for both sides; unit = half the hemisphere's
length. A point of the template is a unit vector, the direction from CENTRE; `hull_radius` says how
far the hull lies in that direction.
"""

import numpy as np
from scipy.interpolate import make_interp_spline

CENTRE = np.array([0.30, -0.02, -0.06])

# Smooth union of ellipsoids that all contain CENTRE, so that the hull is star-shaped: centre,
# semi-axes, tilt about x.
LOBES = (
    ((0.29, 0.40, 0.14), (0.46, 0.58, 0.51), 0.0),  # frontal
    ((0.31, -0.15, 0.12), (0.50, 0.66, 0.58), 0.0),  # parietal
    ((0.29, -0.44, -0.03), (0.43, 0.55, 0.47), 0.0),  # occipital
    ((0.45, -0.05, -0.32), (0.33, 0.49, 0.32), 0.20),  # temporal
)
UNION_POWER = 10.0
MEDIAL_POWER = 9.0

STEP = 1e-4  # radians, of differences on the sphere

WALL_CENTRE = np.array([0.11, -0.08])
WALL_AXES = np.array([0.44, 0.23])

# Courses of the named sulci, approximate MNI coordinates in mm with |x| (read off standard atlases'
# anatomy; mean courses).
SULCI = {
    "central sulcus": ((25, -30, 67), (32, -26, 60), (39, -20, 51), (46, -15, 41), (52, -10, 32)),
    "sylvian fissure": ((36, 14, -18), (44, 8, -10), (50, -8, 1), (54, -24, 11), (55, -40, 22)),
    "superior temporal sulcus": (
        (52, 2, -26),
        (57, -14, -14),
        (58, -32, -3),
        (54, -46, 8),
        (48, -58, 20),
    ),
    "calcarine sulcus": ((16, -100, -6), (0, -88, 1), (0, -73, 5), (0, -58, 3), (0, -42, -5)),
    "parieto-occipital sulcus": ((0, -63, 13), (0, -70, 24), (0, -78, 38)),
    "intraparietal sulcus": ((46, -36, 42), (37, -47, 47), (30, -60, 46), (27, -72, 36)),
    "cingulate sulcus": (
        (0, 44, 0),
        (0, 46, 16),
        (0, 32, 34),
        (0, 12, 43),
        (0, -8, 46),
        (0, -26, 56),
    ),
    "superior frontal sulcus": ((24, 36, 36), (24, 22, 46), (24, 8, 55), (26, -4, 60)),
}

# Longest fundus in units of the square root of the folded area, where people agree on one: about
# what real ones reach.
LONGEST = {"central sulcus": 0.295, "calcarine sulcus": 0.315}

# Companions that give the gyri between the named sulci their shape; they carry no curve.
COMPANIONS = {
    "precentral sulcus": ((30, -8, 62), (42, 0, 46), (52, 6, 26), (56, 8, 14)),
    "postcentral sulcus": ((28, -42, 66), (40, -33, 54), (52, -24, 40), (58, -20, 26)),
    "inferior frontal sulcus": ((36, 42, 10), (44, 28, 20), (48, 12, 28)),
    "inferior temporal sulcus": ((52, -10, -34), (56, -28, -24), (54, -48, -12), (46, -64, -4)),
    "collateral sulcus": ((26, -8, -34), (28, -30, -24), (28, -52, -16), (26, -70, -12)),
    "olfactory sulcus": ((14, 48, -20), (14, 30, -20), (16, 14, -18)),
    "orbital sulcus": ((30, 44, -12), (30, 32, -16), (34, 22, -16)),
    "lateral occipital sulcus": ((38, -74, 2), (34, -86, 2), (26, -94, 2)),
    "subparietal sulcus": ((0, -44, 34), (0, -52, 38), (0, -58, 32)),
    "transverse occipital sulcus": ((22, -82, 34), (32, -80, 26), (40, -76, 16)),
    "paracentral sulcus": ((0, -6, 58), (0, -12, 70)),
    "paracingulate sulcus": ((0, 58, 20), (0, 46, 38), (0, 28, 50)),
    "precuneal sulcus": ((0, -54, 46), (0, -60, 58)),
    "rostral sulcus": ((0, 58, -4), (0, 46, -11), (0, 34, -12)),
}


def unit(vectors):
    """Vectors (..., 3) scaled to length one."""
    vectors = np.asarray(vectors, dtype=float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def fibonacci_sphere(count):
    """Nearly even unit vectors (count, 3)."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def from_atlas(points):
    """Template directions (k, 3) of atlas points in mm with positive x lateral."""
    points = np.asarray(points, dtype=float)
    position = np.column_stack(
        [points[:, 0] / 84, (points[:, 1] + 18) / 86, (points[:, 2] - 15) / 84]
    )
    return unit(position - CENTRE)


def _ellipsoid_exit(directions, centre, axes, tilt):
    """Distance (k,) from CENTRE along each direction to where the ray leaves the ellipsoid."""
    cos, sin = np.cos(tilt), np.sin(tilt)
    rotation = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]]) / np.asarray(axes)[:, None]
    start, step = rotation @ (CENTRE - np.asarray(centre)), directions @ rotation.T
    a, b, c = (step**2).sum(1), step @ start, start @ start - 1
    return (-b + np.sqrt(b * b - a * c)) / a


def differences(function, directions):
    """Two tangents (k, 3) at unit directions, and a function's difference (k, ...) along each."""
    helper = np.where(np.abs(directions[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = unit(np.cross(directions, helper))
    tangents = first, np.cross(directions, first)
    return tangents, [
        function(unit(directions + STEP * e)) - function(unit(directions - STEP * e))
        for e in tangents
    ]


def area_vectors(position, directions):
    """Outward normals (k, 3) of a star-shaped surface position(u), of area per solid angle."""
    _, along = differences(position, directions)
    return np.cross(*along) / (2 * STEP) ** 2


def hull_radius(directions, lobe_scale=None):
    """Distance (k,) from CENTRE to the smooth hull along unit directions (k, 3)."""
    scale = np.ones(len(LOBES)) if lobe_scale is None else lobe_scale
    exits = np.stack([s * _ellipsoid_exit(directions, *lobe) for s, lobe in zip(scale, LOBES)])
    largest = exits.max(0)
    union = largest * ((exits / largest) ** UNION_POWER).sum(0) ** (1 / UNION_POWER)
    inverse_plane = np.maximum(-directions[:, 0], 0) / CENTRE[0]
    return (union**-MEDIAL_POWER + inverse_plane**MEDIAL_POWER) ** (-1 / MEDIAL_POWER)


def wall_level(directions):
    """Elliptic radius (k,) on the medial plane: below 1 inside the wall, infinite on the side."""
    depth = -directions[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = CENTRE[1:] + directions[:, 1:] * (CENTRE[0] / depth)[:, None]
    level = np.linalg.norm((plane - WALL_CENTRE) / WALL_AXES, axis=1)
    return np.where(depth > 1e-9, level, np.inf)


def wall_curve(count):
    """Directions (count, 3) along the rim of the medial wall at equal spacing on the medial plane."""
    angle = np.linspace(0, 2 * np.pi, 4001)
    plane = WALL_CENTRE + WALL_AXES * np.column_stack([np.cos(angle), np.sin(angle)])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(plane, axis=0), axis=1))])
    even = np.interp(np.arange(count) * length[-1] / count, length, angle)
    plane = WALL_CENTRE + WALL_AXES * np.column_stack([np.cos(even), np.sin(even)])
    return unit(np.column_stack([np.zeros(count), plane]) - CENTRE)


def sulcus_course(points, count=120):
    """Directions (count, 3) along the spline through atlas points, ends included."""
    knots = from_atlas(points)
    position = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    spline = make_interp_spline(position, knots, k=min(3, len(knots) - 1))
    return unit(spline(np.linspace(0, position[-1], count)))


class Diffeomorphism:
    """A random diffeomorphism of the template sphere, the identity at the medial wall."""

    def __init__(self, rng, amplitude, width=0.38, count=60):
        self.centres = unit(rng.normal(size=(count, 3)))
        self.weights = rng.normal(size=(count, 3))
        self.width = width
        # Scaled so that the root mean square displacement is about `amplitude` radians, whatever
        # the drawing of centres.
        probe = unit(rng.normal(size=(2000, 3)))
        self.weights *= amplitude / np.sqrt((self._raw(probe) ** 2).sum(1).mean())

    def _raw(self, u):
        field = np.exp((u @ self.centres.T - 1) / self.width**2) @ self.weights
        return field - (field * u).sum(1, keepdims=True) * u

    def _ramp(self, u):
        ramp = np.clip((wall_level(u) - 1.05) / 0.8, 0, 1)
        return ramp * ramp * (3 - 2 * ramp)

    def _velocity(self, u):
        return self._raw(u) * self._ramp(u)[:, None]

    def __call__(self, directions, inverse=False, steps=12):
        """Images (k, 3) of unit directions; `inverse=True` follows the field backwards."""
        u, h = unit(directions), (-1.0 if inverse else 1.0) / steps
        for _ in range(steps):
            k1 = self._velocity(u)
            k2 = self._velocity(unit(u + h / 2 * k1))
            k3 = self._velocity(unit(u + h / 2 * k2))
            k4 = self._velocity(unit(u + h * k3))
            u = unit(u + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        return u


class AreaKeeping(Diffeomorphism):
    """A random diffeomorphism that keeps areas on the hull.

    The flow of v = (u x grad psi) / rho: psi is a smooth random function, 0 at the medial wall, and
    rho the hull's area per solid angle. Then div (rho v) = 0.
    """

    def _waves(self, u):
        return np.exp((u @ self.centres.T - 1) / self.width**2) * self.weights[:, 0]

    def _ramp(self, u):
        ramp = 1 - 1.05 / np.maximum(wall_level(u), 1.05)  # wide: a steep one shears
        return ramp * ramp * (3 - 2 * ramp)

    def _raw(self, u):
        waves = self._waves(u)
        # Without the mean at the wall all would turn around it.
        above = waves.sum(1) - self._waves(wall_curve(60)).sum(1).mean()
        tangents, slopes = differences(self._ramp, u)
        up = sum(slope[:, None] * tangent for slope, tangent in zip(slopes, tangents)) / (2 * STEP)
        gradient = (
            self._ramp(u)[:, None] * (waves @ self.centres) / self.width**2 + above[:, None] * up
        )
        density = np.linalg.norm(area_vectors(lambda w: hull_radius(w)[:, None] * w, u), axis=1)
        return np.cross(u, gradient) / density[:, None]

    _velocity = _raw
