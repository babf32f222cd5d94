"""Draw the README's picture, book/_assets/registration.png: fsaverage5's mirrored right hemisphere
on its left one."""

import io
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import qclearn as qc
from qcbook.figures import registration_disks
from qcbook.scenes import registration_scene, require_renderer
from qclearn.surfaces.curvature import grey_levels

PICTURE = Path(__file__).resolve().parents[2] / "book" / "_assets" / "registration.png"


def screenshot(result, control, registered):
    """The landmarks on the inflated control, coloured by the folded one's curvature, without the
    white around it."""
    values = grey_levels(qc.mean_curvature(control), control.vertex_areas)
    scene = registration_scene(result, qc.fsaverage5("left", "inflated"), registered, values=values, clim=(-80, 335))
    scene.enable_anti_aliasing("ssaa")
    pixels = scene.screenshot(window_size=(1500, 1100), return_img=True)
    scene.close()
    rows, columns = (np.flatnonzero((pixels < 250).any(axis=(other, 2))) for other in (1, 0))
    return pixels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def main():
    require_renderer()
    moving, control = qc.mirror(qc.fsaverage5("right")), qc.fsaverage5("left")
    result = qc.register(moving, control, qc.demo_landmarks(), features=None, progress=True)
    figure = Figure(figsize=(11, 7.4), dpi=110)
    grid = figure.add_gridspec(
        2, 4, left=0.01, right=0.94, bottom=0.05, top=0.93, wspace=0.04, hspace=0.1, height_ratios=(1.35, 1)
    )
    for k, title in enumerate(("best Möbius map only", "registered")):
        ax = figure.add_subplot(grid[0, 2 * k : 2 * k + 2])
        ax.imshow(screenshot(result, control, registered=bool(k)))
        ax.axis("off")
        ax.set_title(title)
    axes = [figure.add_subplot(grid[1, k]) for k in range(4)]
    colours = registration_disks(axes, result, moving)
    for ax in axes:
        ax.title.set_fontsize(10)
    figure.colorbar(colours, cax=figure.add_axes((0.95, 0.1, 0.012, 0.28)), ticks=(0, 0.3, 0.6), extend="max")
    buffer = io.BytesIO()
    figure.savefig(buffer)
    # 256 colours are enough here, and a third of the size; the k-means keeps the rare ones, of the
    # curves and of |mu|
    Image.open(buffer).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=5).save(PICTURE, optimize=True)
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
