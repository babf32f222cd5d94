"""Quasi-conformal registration of cortical surfaces: exact geometry first, networks second."""

from .files.fsaverage import demo_landmarks, fsaverage5
from .files.meshes import read_surface, write_surface
from .files.values import read_mask, read_values, write_values
from .group.kept import TemplateError
from .group.template import Template, template
from .group.workers import WorkersError
from .plane.beltrami import (
    beltrami_coefficient,
    cotangent_stiffness,
    hat_gradients,
    jacobian,
    locate,
    signed_areas,
    solve_beltrami,
    stiffness,
    wirtinger,
)
from .plane.bijectivity import BijectivityError, Certificate, RepairWarning, check_bijective, check_embedding
from .plane.checks import BeltramiError
from .plane.coefficients import compose_coefficients, inverse_coefficient
from .plane.grids import disk_to_square, polar_disk, square_disk, square_to_disk
from .plane.logform import solve_beltrami_disk_log
from .plane.mobius import best_mobius, compose_mobius, mobius, mobius_inverse
from .plane.solver import BeltramiDiskSolver, solve_beltrami_disk
from .registration.features import FeatureError
from .registration.fit import LandmarkFit, fit_landmarks, fit_registration
from .registration.landmarks import detect_curves, fundus_metric, fundus_path, sample_curve
from .registration.problem import LandmarkError
from .registration.register import Registration, register
from .registration.transfer import transfer
from .surfaces.conformal import angle_distortion, disk_conformal_map
from .surfaces.curvature import curvature_image, mean_curvature, sulcal_depth
from .surfaces.opening import open_surface
from .surfaces.surface import Surface, SurfaceError, mirror, require_disk, require_outward

__all__ = [
    "BeltramiDiskSolver",
    "BeltramiError",
    "BijectivityError",
    "Certificate",
    "FeatureError",
    "LandmarkError",
    "LandmarkFit",
    "Registration",
    "RepairWarning",
    "Surface",
    "SurfaceError",
    "Template",
    "TemplateError",
    "WorkersError",
    "angle_distortion",
    "beltrami_coefficient",
    "best_mobius",
    "check_bijective",
    "check_embedding",
    "compose_coefficients",
    "compose_mobius",
    "cotangent_stiffness",
    "curvature_image",
    "demo_landmarks",
    "detect_curves",
    "disk_conformal_map",
    "disk_to_square",
    "fit_landmarks",
    "fit_registration",
    "fsaverage5",
    "fundus_metric",
    "fundus_path",
    "hat_gradients",
    "inverse_coefficient",
    "jacobian",
    "locate",
    "mean_curvature",
    "mirror",
    "mobius",
    "mobius_inverse",
    "open_surface",
    "polar_disk",
    "read_mask",
    "read_surface",
    "read_values",
    "register",
    "require_disk",
    "require_outward",
    "sample_curve",
    "signed_areas",
    "solve_beltrami",
    "solve_beltrami_disk",
    "solve_beltrami_disk_log",
    "square_disk",
    "square_to_disk",
    "stiffness",
    "sulcal_depth",
    "template",
    "transfer",
    "wirtinger",
    "write_surface",
    "write_values",
]
