"""What a page shows of a control: its surface inflated, pictures of maps on it, and the same for the WebGL viewer."""

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
from ..registration.smoothing import HEAT_STEPS, HEMISPHERE

SMOOTHING = 24.0  # mm on a surface with the area of a HEMISPHERE: folds are gone, the lobes are there
MOST = 16_000  # vertices that are drawn: a page of 2 MB holds them and six maps
TONES = 64  # of a colour scale
PIXELS = 520  # width of a picture
BACK, INSIDE = 0.55, np.array([0.55, 0.52, 0.49])  # light on what stands edge on, colour of the surface's inner side


@dataclass(frozen=True)
class Look:
    """How a map is coloured: label, matplotlib's name of the colours, values at their ends, and the unit."""

    label: str
    colours: str
    low: float
    high: float
    unit: str

    def tones(self, values):
        """Values as parts of the scale, 0 to 1."""
        return np.clip((values - self.low) / (self.high - self.low), 0, 1)


def grey(label):
    """The `Look` of a curvature: gyri light, sulci dark."""
    return Look(label, "gray", -2.0, 2.0, "SD, gyri light")


class Shown:
    """An inflated surface with about MOST of its vertices at most, `kept` (K,) their numbers, and the view of it."""

    def __init__(self, surface):
        self.kept, self.vertices, self.faces = decimated(inflated(surface), surface.faces)
        off = surface.vertices.mean(0) - surface.vertices[surface.boundary].mean(0)
        axis = int(abs(off).argmax())
        eye, up = np.eye(3)[axis] * np.sign(off[axis]), np.eye(3)[1 if axis == 2 else 2]
        self.view = np.stack([np.cross(up, eye), up, eye])  # right, up, and towards the reader, off the opening

    @cached_property
    def normals(self):
        a, b, c = (self.vertices[corner] for corner in self.faces.T)
        across = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        sums = np.stack([np.bincount(self.faces.ravel(), across[:, k]) for k in range(3)], axis=1)
        return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), np.finfo(float).tiny)

    def picture(self, values, look, side=1, width=PIXELS):
        """A picture of a map (W,) on the surface as a data: address; side: 1 from outside, -1 from the other side."""
        right, up, eye = self.view * [[side], [1], [side]]
        colours = colormaps[look.colours](look.tones(values[self.kept]))[:, :3]
        light = BACK + (1 - BACK) * abs(self.normals @ eye)[:, None]
        both = np.concatenate([colours * light, INSIDE * light])  # the vertices' colours outside and inside
        x, y, depth = (np.tile(self.vertices @ way, 2) for way in (right, up, eye))
        a, b, c = (x + 1j * y)[self.faces].T
        inside = ((b - a).conj() * (c - a)).imag < 0
        faces = self.faces + len(self.vertices) * inside[:, None]
        mesh = TriMesh(Triangulation(x, y, faces[np.argsort(depth[faces].mean(1))]))  # the nearest last
        mesh.set_facecolor(np.column_stack([both, np.ones(len(both))]))
        figure = Figure(figsize=(width / 100, 0.74 * width / 100), dpi=100)
        ax = figure.add_axes((0, 0, 1, 1))
        ax.add_collection(mesh)
        ax.set(aspect="equal", xlim=(-1.02, 1.02), ylim=(-0.75, 0.75))
        ax.axis("off")
        file = io.BytesIO()
        figure.savefig(file, format="webp", transparent=True, pil_kwargs={"quality": 82})
        return "data:image/webp;base64," + base64.b64encode(file.getvalue()).decode()

    def scene(self, maps):
        """What the viewer needs to show maps, pairs (`Look`, values (W,)): a dict for JSON."""
        places = np.round(32767 * self.vertices).astype("<i2")
        shown = [
            {
                "label": look.label,
                "ends": [f"{look.low:g}", f"{look.high:g}"],
                "unit": look.unit,
                "colours": text_of((255 * colormaps[look.colours](np.linspace(0, 1, TONES))[:, :3]).astype(np.uint8)),
                "tones": text_of(np.round(255 * look.tones(values[self.kept])).astype(np.uint8)),
            }
            for look, values in maps
        ]
        view = self.view.tolist()
        return {"places": text_of(places), "faces": text_of(self.faces.astype("<u2")), "view": view, "maps": shown}


def both_sides(shown, values, words):
    """Pictures of a curvature from outside and from the other side, pairs (address, description)."""
    sides = {"from outside": 1, "from the inner side": -1}
    return [(shown.picture(values, grey(words), side), f"{words}, seen {place}") for place, side in sides.items()]


def text_of(array):
    return base64.b64encode(array.tobytes()).decode()


def inflated(surface):
    """The vertices (V, 3) after a heat flow of the coordinates on the surface, which keeps what is far apart along the
    cortex apart; in a ball of radius 1 about their middle."""
    time = SMOOTHING**2 * surface.area / HEMISPHERE / (2 * HEAT_STEPS)
    mass = sparse.diags_array(surface.vertex_areas)
    places = heat_flow(mass, time * surface.stiffness, mass @ surface.vertices, HEAT_STEPS)
    places = places - (places.min(0) + places.max(0)) / 2
    return places / np.linalg.norm(places, axis=1).max()


def decimated(vertices, faces):
    """(kept (K,), vertices (K, 3), faces) of a mesh decimated to about MOST vertices, which stay where they are; good
    enough to be looked at, as some faces may lie on each other."""
    if len(vertices) <= MOST:
        return np.arange(len(vertices)), vertices, faces
    import pyvista  # half a second: only where it is used

    mesh = pyvista.PolyData.from_regular_faces(vertices, faces)
    mesh.point_data["number"] = np.arange(len(vertices))
    mesh = mesh.decimate_pro(1 - MOST / len(vertices), preserve_topology=True)
    kept = np.asarray(mesh.point_data["number"])
    return kept, vertices[kept], mesh.regular_faces
