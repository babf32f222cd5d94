"""The explorable of a growing cortex: what Python knows of it."""

from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from qcbook.scenes import surface_picture
from qclearn.surfaces.surface import Surface

from .live import Live
from .livefiles import packed


class Growth(Live):
    """Frames of a growing cortex, of the chapter on synthetic cortex."""

    page, own = "growth", True
    initial = MappingProxyType({"frame": 0, "turn": 0, "tilt": 10, "colour": "curvature"})

    def __init__(self, positions, faces, factors, crossing):
        """positions (K, V, 3) in mm; factors (K,) by which rest lengths have grown; crossing (K,)
        faces that cross."""
        self.positions, self.faces, self.factors, self.crossing = (positions, faces, factors, crossing)

    def files(self):
        """The frames, in half precision: to a sixteenth of a millimetre."""
        config = {"factors": self.factors.tolist(), "crossing": [int(count) for count in self.crossing]}
        return {"growth.bin": packed(config, {"positions": self.positions.astype(np.float16), "faces": self.faces})}

    def areas(self):
        """Areas (K,) of the frames, as the browser has their positions."""
        corners = np.moveaxis(self.positions.astype(np.float16).astype(float)[:, self.faces], 2, 0)
        normals = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        return np.linalg.norm(normals, axis=-1).sum(-1) / 2

    def answer(self, state):
        """By what factor the area has grown until a frame; a frame beyond the last is the last, as
        in the browser."""
        areas = self.areas()
        return {"area": areas[min(state["frame"], len(areas) - 1)] / areas[0]}

    def picture(self, state):
        """A Matplotlib figure of three of the frames, and a description."""
        figure = Figure(figsize=(9, 3))
        shown = [0, len(self.positions) // 2, len(self.positions) - 1]
        for ax, frame in zip(figure.subplots(1, 3), shown):
            ax.imshow(surface_picture(Surface(self.positions[frame], self.faces), None, (-1, 0, 0), height=170))
            ax.set_title(f"frame {frame}", fontsize=10)
            ax.axis("off")
        return (figure, "A smooth shell, the same shell with furrows, and a hemisphere that is folded all over.")
