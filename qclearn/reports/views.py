"""The control inflated: pictures of maps on it, and the same maps for the WebGL viewer.

The viewer is ours: pyvista's export asks a server for icons, cannot be turned by keys, shows one
map and needs trame and a renderer.
"""

import base64
import io
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import TriMesh
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from scipy import sparse

from ..plane.linear import heat_flow
from ..registration.features import HEAT_STEPS, HEMISPHERE

SMOOTHING = 24.0  # mm on a surface with the area of a HEMISPHERE: removes folds, keeps lobes
MOST_VERTICES = 16_000  # drawn: a page of 2 MB holds them and six maps
TONES = 64  # of a colour scale
PIXELS = 520  # width of a picture
HIGH = 0.74  # its height over its width
MARGIN = 1.02  # half a picture over half of what it shows
EDGE_LIGHT = 0.55  # brightness where the surface is seen edge on
INNER_SIDE = np.array([0.55, 0.52, 0.49])  # colour of the surface's inner side


@dataclass(frozen=True)
class ColorScale:
    """How a map is coloured: label, Matplotlib colormap, values at its ends, unit."""

    label: str
    colormap: str
    low: float
    high: float
    unit: str

    def tones(self, values):
        """Values as parts of the scale, 0 to 1."""
        return np.clip((values - self.low) / (self.high - self.low), 0, 1)

    def rgb(self, tones):
        """Colours (..., 3) of parts of the scale."""
        return colormaps[self.colormap](tones)[..., :3]


def curvature_scale(label):
    """The `ColorScale` of a curvature: gyri light, sulci dark."""
    return ColorScale(label, "gray", -2.0, 2.0, "SD, gyri light")


class InflatedView:
    """An inflated surface with at most about MOST_VERTICES vertices, and the direction of view.

    indices: (K,), of the drawn vertices in the surface; axes: (3, 3), right, up and towards the
    reader, who looks along an axis in which the surface is thin, from the side away from the
    opening: at a hemisphere's lateral side. half: (2,), the largest part to the right and upwards.
    """

    def __init__(self, surface):
        self.indices, self.vertices, self.faces = decimated(inflated(surface), surface.faces)
        # The faces' areas as vectors add up to the opening's. By the mean of its rim alone a
        # cortex would be seen from above: that lies lower than the brain's middle.
        a, b, c = (surface.vertices[corner] for corner in surface.faces.T)
        away = np.cross(b - a, c - a).sum(0)
        extent = np.ptp(surface.vertices, axis=0)
        axis = int(abs(away / extent).argmax())
        eye = np.eye(3)[axis] * np.sign(away[axis])
        # Scanners have z upwards, and x across a hemisphere. On other axes the shorter one is up.
        others = [k for k in (2, 1, 0) if k != axis]
        up = np.eye(3)[2 if axis == 0 else min(others, key=lambda k: extent[k])]
        self.axes = np.stack([np.cross(up, eye), up, eye])
        self.half = abs(self.vertices @ self.axes[:2].T).max(0)

    @cached_property
    def normals(self):
        """Unit normals (K, 3) of the vertices, means over their faces by area."""
        a, b, c = (self.vertices[corner] for corner in self.faces.T)
        normals = np.zeros_like(self.vertices)
        np.add.at(normals, self.faces, np.cross(b - a, c - a)[:, None])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return normals / np.maximum(lengths, np.finfo(float).tiny)

    def pictures(self, curvatures, descriptions):
        """Both sides of each curvature: name -> pairs (data: address, description)."""
        pictures = {}
        for name, text in descriptions.items():
            values, scale = curvatures[name], curvature_scale(name)
            outer = self.picture(values, scale), f"{text}, seen from outside"
            inner = self.picture(values, scale, side=-1), f"{text}, seen from the inner side"
            pictures[name] = [outer, inner]
        return pictures

    def picture(self, values, scale, side=1):
        """A picture of a map (W,) as a data: address; side: 1 from outside, -1 from the inside."""
        right, up, eye = self.axes * [[side], [1], [side]]
        light = EDGE_LIGHT + (1 - EDGE_LIGHT) * abs(self.normals @ eye)[:, None]
        outside = scale.rgb(scale.tones(values[self.indices])) * light
        # Each vertex twice, with the colour of its outer and of its inner side.
        colours = np.concatenate([outside, INNER_SIDE * light])
        x, y, depth = (np.tile(self.vertices @ axis, 2) for axis in (right, up, eye))
        a, b, c = (x + 1j * y)[self.faces].T
        turned_away = ((b - a).conj() * (c - a)).imag < 0
        faces = self.faces + len(self.vertices) * turned_away[:, None]
        nearest_last = np.argsort(depth[faces].mean(1))
        mesh = TriMesh(Triangulation(x, y, faces[nearest_last]))
        mesh.set_facecolor(np.column_stack([colours, np.ones(len(colours))]))
        figure = Figure(figsize=(PIXELS / 100, HIGH * PIXELS / 100), dpi=100)
        ax = figure.add_axes((0, 0, 1, 1))
        ax.add_collection(mesh)
        half = MARGIN * max(self.half[0], self.half[1] / HIGH)
        ax.set(aspect="equal", xlim=(-half, half), ylim=(-HIGH * half, HIGH * half))
        ax.axis("off")
        file = io.BytesIO()
        figure.savefig(file, format="webp", transparent=True, pil_kwargs={"quality": 82})
        return "data:image/webp;base64," + base64_text(file.getvalue())

    def scene(self, maps):
        """What the viewer needs to show maps, pairs (`ColorScale`, values (W,)): dict for JSON."""
        return {
            "places": base64_text(np.round(32767 * self.vertices).astype("<i2")),
            "faces": base64_text(self.faces.astype("<u2")),
            "view": self.axes.tolist(),
            "half": (MARGIN * self.half).tolist(),
            "maps": [
                {
                    "label": scale.label,
                    "ends": [f"{scale.low:g}", f"{scale.high:g}"],
                    "unit": scale.unit,
                    "colours": byte_text(scale.rgb(np.linspace(0, 1, TONES))),
                    "tones": byte_text(scale.tones(values[self.indices])),
                }
                for scale, values in maps
            ],
        }


def base64_text(data):
    """Bytes, or an array's, in base64."""
    return base64.b64encode(bytes(data)).decode()


def byte_text(parts):
    """Numbers from 0 to 1 as bytes in base64."""
    return base64_text(np.round(255 * parts).astype(np.uint8))


def inflated(surface):
    """The vertices (V, 3) after a heat flow of the coordinates on the surface, in the unit ball.

    Points that are far apart along the cortex stay apart.
    """
    time = SMOOTHING**2 * surface.area / HEMISPHERE / (2 * HEAT_STEPS)
    mass = sparse.diags_array(surface.vertex_areas)
    points = heat_flow(mass, time * surface.stiffness, mass @ surface.vertices, HEAT_STEPS)
    points = points - (points.min(0) + points.max(0)) / 2
    return points / np.linalg.norm(points, axis=1).max()


def decimated(vertices, faces):
    """(indices (K,), vertices (K, 3), faces) of a mesh decimated to about MOST_VERTICES.

    The vertices stay where they are. Good enough to look at: some faces may overlap.
    """
    if len(vertices) <= MOST_VERTICES:
        return np.arange(len(vertices)), vertices, faces
    import pyvista  # half a second: only where it is used

    mesh = pyvista.PolyData.from_regular_faces(vertices, faces)
    mesh.point_data["index"] = np.arange(len(vertices))
    mesh = mesh.decimate_pro(1 - MOST_VERTICES / len(vertices), preserve_topology=True)
    indices = np.asarray(mesh.point_data["index"])
    return indices, vertices[indices], mesh.regular_faces
