"""The complex plane: meshes of the disk, Beltrami coefficients and their maps, Möbius maps, the
certificate."""

from ..interrupts import attach

TABLE = {
    "bijectivity": "mean_value_matrix repair",
    "coefficients": "bounded",
    "disk": "Disk",
    "fourier": "coefficient_count compress compression_effect fourier_coefficients fourier_matrix "
    "frequencies from_coefficients from_square to_square",
    "grids": "pixel_centres polar",
    "linear": "Dirichlet corner_angles edge_lengths",
    "mobius": "centring_mobius",
}

__getattr__, __dir__, __all__ = attach(__name__, TABLE)
