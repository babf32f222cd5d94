"""CAT-Surface as a program of its own, since the package cat-surf is under the GPL.

    python catsurf.py sphere SURFACE OUT
    python catsurf.py demons MOVING MOVING_SPHERE CONTROL CONTROL_SPHERE OUT

Nothing of the library imports this file or cat_surf. Source: Yeo et al. (2010), Spherical Demons;
Gaser et al. (2024).
"""

import sys


def main(task, *paths):
    import cat_surf

    *given, out = paths
    meshes = [cat_surf.read_surface(path) for path in given]
    if task == "sphere":
        result = cat_surf.surf_to_sphere(*meshes[0], stop_at=5, relax=True)
    else:
        # Its defaults, its own search for a rotation among them.
        result = cat_surf.spherical_demon(*meshes)
    cat_surf.write_surface(out, *result)


if __name__ == "__main__":
    main(*sys.argv[1:])
