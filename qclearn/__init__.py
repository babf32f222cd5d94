"""Quasi-conformal registration of cortical surfaces: exact geometry first, networks second."""

from .interrupts import attach
from .moved import GONE, gone

TABLE = {
    "io.fsaverage": "demo_landmarks fsaverage5",
    "io.meshes": "read_surface write_surface",
    "io.values": "read_mask read_values write_values",
    "plane.beltrami": "BeltramiDiskSolver beltrami_coefficient hat_gradients jacobian locate "
    "signed_areas solve_beltrami solve_beltrami_disk stiffness wirtinger",
    "plane.bijectivity": "BijectivityError Certificate RepairWarning check_bijective "
    "check_embedding",
    "plane.checks": "BeltramiError",
    "plane.coefficients": "compose_coefficients inverse_coefficient",
    "plane.grids": "disk_to_square polar_disk square_disk square_to_disk",
    "plane.mobius": "best_mobius compose_mobius mobius mobius_inverse",
    "plane.linear": "cotangent_stiffness",
    "registration.features": "FeatureError",
    "registration.fit": "LandmarkFit fit_landmarks fit_registration",
    "registration.problem": "LandmarkError",
    "registration.curves": "detect_curves fundus_metric fundus_path sample_curve",
    "registration.register": "Registration register",
    "registration.transfer": "transfer",
    "surfaces.conformal": "angle_distortion disk_conformal_map",
    "surfaces.curvature": "curvature_image mean_curvature sulcal_depth",
    "surfaces.opening": "open_surface",
    "surfaces.surface": "Surface SurfaceError mirror require_disk require_outward",
}

_attribute, __dir__, __all__ = attach(__name__, TABLE)


def __getattr__(name):
    """A name of TABLE, or the line of one that went."""
    if f"qclearn.{name}" in GONE:
        # `from qclearn import ...` would replace the text of an AttributeError.
        raise ImportError(gone(f"qclearn.{name}"))
    return _attribute(name)
