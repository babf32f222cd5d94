"""Draw the labelled sulci of open hemispheres, to judge by eye whether they are homologous.

    python -m book.studies.people_labels FILE.npz ... --reference FILE.npz --out FOLDER [--blind]

FILE: vertices, faces, depth (mm), curv (positive on gyri), curve_NAME (vertices in order), of a left shape. The
reference has all the curves. --blind names the brains A, B, ... in random order; FOLDER/key.txt tells which is which.
"""

from pathlib import Path

import click
import numpy as np
import pyvista as pv
from matplotlib.colors import TABLEAU_COLORS
from scipy import sparse, spatial

from qclearn import Surface
from qclearn.plane.linear import heat_flow

SIDES = {"lateral": (-1, 0, 0), "medial": (1, 0, 0), "dorsal": (0, 0, 1)}  # to the reader: right, front, up
SIDES |= {"inner": (1, -0.6, 0), "front": (-0.7, 0.7, 0.3), "behind": (-0.6, -0.7, 0.5)}
NEAR = {"CS": "lateral", "STS": "lateral", "CAL": "inner", "POS": "inner", "CING": "medial"}  # a curve's best side
NEAR |= {"POC": "behind", "IPS": "behind", "SFS": "dorsal", "IFS": "lateral"}


def inflated(npz, turn):
    """The turned mesh, its coordinates smoothed by 11 mm; sulci are dark, the deeper the darker."""
    surface = Surface(npz["vertices"].astype(float), npz["faces"])
    mass = sparse.diags_array(surface.vertex_areas)
    points = heat_flow(mass, 11**2 / 8 * surface.stiffness, mass @ surface.vertices, 4)
    mesh = pv.PolyData.from_regular_faces(turn.apply(points - points.mean(0)), npz["faces"])
    mesh["tone"] = 0.5 + 0.22 * np.tanh(npz["curv"] / 0.08) - 0.28 * np.tanh((npz["depth"] - 5) / 6)
    return mesh.compute_normals(cell_normals=False, split_vertices=False)


def draw(path, panels, side, near=None):
    """Panels (mesh, curves) from a side, the curves named at their starts; near: the curve in the middle."""
    plotter = pv.Plotter(off_screen=True, window_size=(1400, 1000), shape=(1, len(panels)))
    eye, up = np.array(SIDES[side]), (1, 0, 0) if side == "dorsal" else (0, 0, 1)
    for column, (mesh, curves) in enumerate(panels):
        plotter.subplot(0, column)
        plotter.add_mesh(mesh, scalars="tone", cmap="gray", clim=(0, 1), show_scalar_bar=0, ambient=0.45, diffuse=0.6)
        for (name, curve), color in zip(curves.items(), TABLEAU_COLORS, strict=False):
            points = mesh.points[curve] + 0.6 * mesh.point_normals[curve]
            plotter.add_mesh(pv.MultipleLines(points).tube(radius=0.5), color=color)
            if mesh.point_normals[curve[0]] @ eye > 0:
                plotter.add_point_labels(points[:1], [name], text_color=color, shape_color="w", always_visible=True)
        part, share = (pv.PolyData(mesh.points[curves[near]]), 0.7) if near else (mesh, 0.3)
        plotter.enable_parallel_projection()
        plotter.camera_position = [np.add(part.center, 400 * eye), part.center, up]
        plotter.camera.parallel_scale = max(share * part.length, 30)
    plotter.show(title=path.stem, screenshot=path)


@click.command(help=__doc__)
@click.argument("files", nargs=-1, required=True, type=click.Path(exists=True))
@click.option("--reference", required=True)
@click.option("--out", required=True, type=click.Path(path_type=Path, exists=True))
@click.option("--blind", is_flag=True)
def main(files, reference, out, blind):
    files = [reference, *(np.random.default_rng().permutation(files).tolist() if blind else files)]
    names = [chr(64 + k) if blind and k else Path(file).stem for k, file in enumerate(files)]
    (out / "key.txt").write_text("\n".join(map(" is ".join, zip(names, files, strict=True))))
    panels, home = [], None
    for name, npz in zip(names, map(np.load, files), strict=True):
        curves = {key: npz[f"curve_{key}"] for key in NEAR if f"curve_{key}" in npz}
        ends = {key: npz["vertices"][c[[0, len(c) // 2, -1]]] - npz["vertices"].mean(0) for key, c in curves.items()}
        home = home or ends
        both = [np.concatenate([side[key] for key in ends]) for side in (home, ends)]
        panels.append((inflated(npz, spatial.transform.Rotation.align_vectors(*both)[0]), curves))
        for side in SIDES:
            draw(out / f"{name}_{side}.png", panels[-1:], side)
        for key, curve in curves.items():
            draw(out / f"{name}_near_{key}.png", [panels[-1], panels[0]], NEAR[key], key)
            crown, depths = (npz["curv"][curve] > 0).mean(), npz["depth"][curve].astype(int).tolist()
            click.echo(f"{name} {key}: {crown:.0%} on gyral crowns; depths in mm {depths}")


if __name__ == "__main__":
    main()
