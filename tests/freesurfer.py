"""What FreeSurfer writes after a surface: the geometry of its volume, for tests."""

GEOMETRY = {
    "head": [2, 0, 20], "valid": "1  # volume info valid", "filename": "orig.mgz", "volume": [256, 256, 256],
    "voxelsize": [1.0, 1.0, 1.0], "xras": [-1.0, 0.0, 0.0], "yras": [0.0, 0.0, -1.0], "zras": [0.0, 1.0, 0.0],
    "cras": [3.5, 12.25, -7.0],
}  # fmt: skip
