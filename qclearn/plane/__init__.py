"""The complex plane: meshes of the disk, Beltrami coefficients and their maps, Möbius maps, the certificate."""

from ..lazy import offer

TABLE = {
    "bijectivity": ["mean_value_matrix", "repair"],
    "coefficients": ["bounded"],
    "disk": ["Disk"],
    "exactmaps": ["affine", "radial_stretch", "sliding", "twist"],
    "fourier": [
        "coefficient_count",
        "compress",
        "compression_effect",
        "fourier_coefficients",
        "fourier_matrix",
        "frequencies",
        "from_coefficients",
        "from_square",
        "to_square",
    ],
    "grids": ["pixel_centres", "polar"],
    "linear": ["Dirichlet"],
    "mobius": ["centring_mobius"],
    "triangles": ["corner_angles", "edge_lengths"],
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
