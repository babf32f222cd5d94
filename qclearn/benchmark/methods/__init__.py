"""Registration methods: `METHODS[name](problem, **parameters) -> f (V,)`, one short file each.

A method takes a `Problem` and keyword parameters with defaults, returns where each vertex of the
moving disk mesh lies in the control's disk, and warns with a RepairWarning of what it did beyond
its plain formula. A method of spheres, such as `rotation`, returns where each vertex of the whole
moving surface lies on the control's sphere, (V', 3). Any such function can join the benchmark.
"""

from .folds import dense, hybrid, landmark_free
from .gauss_newton import coarse_steps, gauss_newton
from .harmonic import harmonic
from .mobius_only import mobius_only
from .networks import cpnet_dbsnet, cpnet_exact, cpnet_steps, guarded
from .qc_iteration import qc_iteration
from .rotation import rotation
from .solver import LandmarkSolver
from .teichmuller import teichmuller
from .thin_plate import thin_plate

_ALL = (
    mobius_only, harmonic, thin_plate, qc_iteration, teichmuller, gauss_newton, coarse_steps, hybrid,
    dense, landmark_free, cpnet_dbsnet, cpnet_exact, cpnet_steps, guarded, rotation,
)  # fmt: skip
METHODS = {method.__name__: method for method in _ALL}

__all__ = ["METHODS", "LandmarkSolver", *METHODS]
