"""What a fit is given, checked once: landmarks of one disk with their targets, and weights."""

from dataclasses import dataclass, field
from functools import cached_property
from operator import itemgetter

import numpy as np

from ..plane.checks import BeltramiError, complex_numbers, unmasked
from ..plane.disk import Disk
from ..plane.mobius import best_mobius

# Default weights of features and, beside them, of areas.
DELTA = 3.0
ETA = 3.5
# Default weight of features without areas; in a group, too, as its mean is no surface.
DELTA_BY_DISKS = 1.0
# A weight over the larger of alpha and beta, and by itself. On fsaverage5 with folds the landmarks
# end 0.62 mm from their targets at gamma = 1e3, 0.12 at 1e5, 0.04 at 1e6, 0.51 at 1e7 and 1.05 at
# 1e8: farther than by default. All weights times 1e6 give the same map, times 1e8 another.
LARGEST = 1e7
LARGEST_ALONE = 1e9
MEETING = 1e-9  # in the unit disk: landmarks closer than this are one point
NOTHING = MEETING**2  # an objective, or squared distances, that only rounding tells apart


class LandmarkError(ValueError):
    """Landmarks that cannot be fitted: says which, where and what to do."""


@dataclass(frozen=True)
class Weights:
    """alpha of |mu|^2, beta of its gradient, gamma of the landmarks' mismatch (paper, eq. RegLoss),
    delta of features', eta of the areal term; with eta > 0 alpha's mean, too, is over the moving
    surface's area, else over its disk's.

    The defaults, DELTA and ETA were chosen on real pairs and known truths:
    book/studies/choose_weights.py, qclearn/benchmark/results/weights.json. LandmarkError unless
    alpha > 0, beta >= 0, gamma > 0, delta >= 0 and eta >= 0 are finite, and none is so large that
    rounding rules: LARGEST times the larger of alpha and beta.
    """

    alpha: float = 1.0
    beta: float = 1e-2
    gamma: float = 1e3
    # Landmarks alone; `register` with features has DELTA and ETA by default.
    delta: float = 0.0
    eta: float = 0.0

    def __post_init__(self):
        rule = "alpha and gamma must be positive, the others not negative, and all finite"
        for name, value in vars(self).items():
            positive = name in ("alpha", "gamma")
            if not (is_finite(value) and (value > 0 if positive else value >= 0)):
                raise LandmarkError(f"{name} = {value!r}: {rule}")
            vars(self)[name] = float(value)  # reports are JSON, which knows no numbers of NumPy
        most = min(LARGEST * max(self.alpha, self.beta), LARGEST_ALONE)
        name, value = max(vars(self).items(), key=itemgetter(1))
        if value > most:
            raise LandmarkError(
                f"{name} = {value:g}: over {most:g} rounding decides; give at most {LARGEST:g} times "
                f"the larger of alpha and beta, and {LARGEST_ALONE:g}"
            )

    @property
    def factors(self):
        """Term of the paper's loss -> weight."""
        return {"L_mu": self.alpha, "L_grad_mu": self.beta, "L_Landmark": self.gamma}

    def losses(self, mean_square, mean_gradient, off):
        """The paper's loss and its terms, name -> number, from the means of |mu|^2 and of |grad
        mu|^2 over the disk, L_mu and L_grad_mu, and from the landmarks' distances `off` (M,):
        `L_Landmark = mean off^2`, `L_CP = alpha L_mu + beta L_grad_mu + gamma L_Landmark`. Source:
        paper, eqs. muloss, musmooth, lmloss, RegLoss."""
        mismatch = (off**2).mean() if len(off) else 0.0
        whole = self.alpha * mean_square + self.beta * mean_gradient + self.gamma * mismatch
        numbers = map(float, (mean_square, mean_gradient, mismatch, whole))
        return dict(zip(("L_mu", "L_grad_mu", "L_Landmark", "L_CP"), numbers))


@dataclass(frozen=True, eq=False)
class Problem:
    """Landmarks of one moving disk to be carried to their targets in the control's disk.

    disk: the moving surface's `Disk`, its boundary on the unit circle; moving, target (M,) complex:
    landmarks p in that disk and q in the control's; curve (M,) int: which curve each belongs to, in
    order; sliding: inner points of a curve may move along their target curve, where a method can
    let them; fewest: how many landmarks there must be; pair: the `SurfacePair` of start.py
    for methods that look at folds or areas, or None; its moving surface is the disk's. A method
    returns f (V,) complex: where each vertex lies in the control's disk. LandmarkError for unusable
    landmarks.
    """

    disk: Disk
    moving: np.ndarray
    target: np.ndarray
    curve: np.ndarray = field(default=None)
    sliding: bool = False
    fewest: int = 1
    pair: object = None

    def __post_init__(self):
        try:
            moving = np.atleast_1d(complex_numbers(self.moving, "moving landmarks"))
            target = np.atleast_1d(complex_numbers(self.target, "target landmarks"))
        except BeltramiError as error:
            raise LandmarkError(str(error)) from None
        if moving.ndim != 1 or moving.shape != target.shape or len(moving) < self.fewest:
            raise LandmarkError(
                f"{moving.shape} moving and {target.shape} target landmarks: give one target a "
                "landmark"
            )
        # Landmarks lie in the closed disk, and no two in one place.
        for name, points in (("moving", moving), ("target", target)):
            outside = np.flatnonzero(~(abs(points) <= 1 + 1e-9))
            if len(outside):
                raise LandmarkError(
                    f"{name} landmarks {outside[:5].tolist()} are not in the closed unit disk "
                    f"({points[outside[0]]:.4g}); map them with the surface's disk map first"
                )
            order = np.lexsort((points.imag, points.real))
            twice = np.flatnonzero(abs(np.diff(points[order])) < 1e-12)
            if len(twice):
                first, second = sorted(order[twice[0] : twice[0] + 2].tolist())
                raise LandmarkError(
                    f"{name} landmarks {first} and {second} coincide at {points[first]:.4g}; drop "
                    "one of them (a bijection cannot part or merge points)"
                )
        # Each belongs to a curve: to the only one, unless labels are given.
        if self.curve is None and self.sliding:
            raise LandmarkError(
                "sliding landmarks need the curve each belongs to: give curve (M,) of integer "
                "labels"
            )
        curve = np.zeros(len(moving), int) if self.curve is None else self.curve
        curve = unmasked(curve, "curve labels", LandmarkError)
        if curve.dtype.kind not in "iu":
            raise LandmarkError(f"curve labels have type {curve.dtype}: give integers (M,)")
        if curve.shape != moving.shape:
            raise LandmarkError(
                f"{curve.shape} curve labels for {len(moving)} landmarks: give one label a landmark"
            )
        vars(self).update(moving=moving, target=target, curve=curve)

    @cached_property
    def samples(self):
        """Sparse (M, V): per-vertex data at the moving landmarks."""
        return self.disk.interpolation(self.moving)

    @cached_property
    def mobius(self):
        """(a, theta) of the best Möbius map of these landmarks, the distinct ones of a pair, where
        a fit begins; without any, identity."""
        return best_mobius(self.moving, self.target) if len(self.moving) else (0j, 0.0)


def is_finite(value):
    """Whether a value is one finite real number."""
    return isinstance(value, (int, float, np.integer, np.floating)) and bool(np.isfinite(value))


def meeting(points):
    """Whether two points (M,) are one: (M, M) bool, true at (earlier, later) alone."""
    return np.triu(abs(points[:, None] - points) < MEETING, 1)


def distinct(p, q):
    """Landmarks (k,) int of two sides (M,) such that each point of either counts once."""
    return np.flatnonzero(~(meeting(p) | meeting(q)).any(0))
