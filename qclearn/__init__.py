"""Quasi-conformal registration of cortical surfaces: exact geometry first, networks second."""

from .beltrami import (
    BeltramiError,
    beltrami_coefficient,
    compose_coefficients,
    cotangent_stiffness,
    hat_gradients,
    inverse_coefficient,
    jacobian,
    signed_areas,
    solve_beltrami,
    stiffness,
    wirtinger,
)
from .bijectivity import BijectivityError, Certificate, RepairWarning, check_bijective, check_embedding
from .curvature import curvature_image, mean_curvature, sulcal_depth
from .disk import BeltramiDiskSolver, angle_distortion, disk_conformal_map, solve_beltrami_disk
from .diskmesh import disk_to_square, locate, polar_disk, square_disk, square_to_disk
from .files import read_surface, write_surface
from .fit import LandmarkError, LandmarkFit, fit_landmarks
from .fsaverage import demo_landmarks, fsaverage5
from .landmarks import detect_curves, fundus_metric, fundus_path, sample_curve
from .logform import solve_beltrami_disk_log
from .mobius import best_mobius, compose_mobius, mobius, mobius_inverse
from .opening import open_surface
from .register import Registration, register, transfer
from .surface import Surface, SurfaceError, mirror, require_disk, require_outward
from .values import read_mask, read_values, write_values

__all__ = [
    "BeltramiDiskSolver",
    "BeltramiError",
    "BijectivityError",
    "Certificate",
    "LandmarkError",
    "LandmarkFit",
    "Registration",
    "RepairWarning",
    "Surface",
    "SurfaceError",
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
    "transfer",
    "wirtinger",
    "write_surface",
    "write_values",
]
