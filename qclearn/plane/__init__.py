"""The complex plane: meshes of the disk, Beltrami coefficients and their maps, Möbius maps, the certificate."""
