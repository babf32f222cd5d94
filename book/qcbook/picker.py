"""Landmarks clicked on two surfaces in JupyterLab: PyVista draws in the kernel, the browser shows
its pictures and tells of clicks, drags and keys, so that nothing else has to be served."""

import io
import json
from itertools import count
from pathlib import Path

import anywidget
import numpy as np
import traitlets
from PIL import Image
from scipy import sparse

from qcbook.scenes import surface_scene
from qclearn.interrupts import signals_wait
from qclearn.io.safe import write_whole
from qclearn.plane.linear import heat_flow
from qclearn.registration.curves import OTHER_SIDE, SIDES, check_curves, fundus_metric, fundus_path, read_landmarks
from qclearn.registration.problem import LandmarkError
from qclearn.surfaces.checks import counted
from qclearn.surfaces.curvature import mean_curvature
from qclearn.surfaces.surface import Surface, require_surface

from .live import MODULES

with signals_wait():
    import pyvista
    from vtkmodules.vtkRenderingCore import vtkCellPicker

WIDTH, HEIGHT = 400, 360  # of a picture, in pixels; two fit beside each other
DEGREES = 0.4  # of turn a pixel of drag
ZOOM = 1.4  # of the first picture
INFLATION = 3e-3  # of the area: the time of the heat flow to the surface that is shown where none is given
COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # of one curve after the other


class View:
    """A surface as it is shown, with balls at ends of curves and tubes along the sulci between
    them."""

    def __init__(self, surface, shown=None):
        self.surface, self.shown = surface, shown or inflated(surface)
        curvature = mean_curvature(surface)
        limit = curvature.std()
        self.plotter = surface_scene(self.shown, curvature, cmap="gray", clim=(-limit, limit))
        self.plotter.off_screen, self.plotter.window_size = True, (WIDTH, HEIGHT)
        self.plotter.camera.Zoom(ZOOM)
        self.actor = next(iter(self.plotter.actors.values()))
        self.metric, self.marks = fundus_metric(surface), {}  # (ends, colour) -> what shows them

    def turn(self, right, down, zoom):
        """Turn by so many pixels of drag, and zoom."""
        camera = self.plotter.camera
        camera.Azimuth(-DEGREES * right)
        camera.Elevation(DEGREES * down)
        camera.OrthogonalizeViewUp()
        camera.Zoom(zoom)

    def picture(self):
        """The bytes of a JPEG picture."""
        self.plotter.renderer.ResetCameraClippingRange()
        self.plotter.render()  # a second screenshot alone would be the first one
        buffer = io.BytesIO()
        Image.fromarray(self.plotter.screenshot(return_img=True)).save(buffer, "JPEG", quality=85)
        # JupyterLab's messages come in another thread than the cell.
        self.plotter.render_window.ReleaseCurrent()
        return buffer.getvalue()

    def vertex_at(self, x, y):
        """The vertex that is seen at a pixel, from the upper left corner, or None beside the
        surface."""
        picker = vtkCellPicker()
        picker.SetTolerance(0)
        picker.AddPickList(self.actor)
        picker.PickFromListOn()
        if not picker.Pick(x, HEIGHT - 1 - y, 0, self.plotter.renderer):
            return None
        corners = self.shown.faces[picker.GetCellId()]
        away = np.linalg.norm(self.shown.vertices[corners] - picker.GetPickPosition(), axis=1)
        return int(corners[away.argmin()])

    def mark(self, curves):
        """Show these curves and no others: pairs (ends, colour)."""
        for gone in set(self.marks) - set(curves):
            self.plotter.remove_actor(self.marks.pop(gone))
        for ends, colour in set(curves) - set(self.marks):
            parts = [self.plotter.add_mesh(part, color=colour, reset_camera=False) for part in self.parts(ends)]
            self.marks[ends, colour] = parts

    def parts(self, ends):
        """Balls at ends, and a tube along the sulcus that is found between two, or along a whole path."""
        points = self.shown.vertices.astype(np.float32)
        radius = 0.012 * np.linalg.norm(np.ptp(points, axis=0))
        yield from (pyvista.Sphere(radius=radius, center=points[end]) for end in {*ends[:1], *ends[-1:]})
        if len(set(ends)) >= 2:
            path = fundus_path(self.surface, *ends, self.metric) if len(ends) == 2 else list(ends)
            yield pyvista.lines_from_points(points[path]).tube(radius=0.5 * radius)


def inflated(surface):
    """The surface after a heat flow of its vertices, `(A + t K) x' = A x`, so that one sees into
    its sulci."""
    mass, step = sparse.diags_array(surface.vertex_areas), INFLATION * surface.area
    return Surface(heat_flow(mass, step * surface.stiffness, mass @ surface.vertices, 1), surface.faces)


class LandmarkPicker(anywidget.AnyWidget):
    """Click the ends of sulci on a moving and a control surface, name them, and save the landmarks
    file `path`.

    A curve has two ends on each side, the same one first; between them the sulcus is shown that
    `register` will find. A file that is there is taken up, its curves stay as they are; LandmarkError
    where it cannot be read or belongs to other surfaces.

    shown: the surfaces to be looked at, (moving, control), with the same faces (inflated ones); by
    default smoothed ones. Keys, on a picture: arrows turn, + and - zoom, Enter marks what is under
    the cross in the middle, u undoes, s saves.
    """

    _esm = traitlets.Unicode().tag(sync=True)
    pictures, names = traitlets.Dict().tag(sync=True), traitlets.List().tag(sync=True)
    said = traitlets.Unicode().tag(sync=True)

    def __init__(self, moving, control, path="landmarks.json", shown=(None, None)):
        self.path, self.picks = Path(path).absolute(), []
        self.surfaces = {"moving": moving, "control": control}
        for surface in (moving, control):
            require_surface(surface)
        self.known, self.read = None, {"curves": []}  # the file's bytes and what they hold
        if self.path.exists():
            contents = read_landmarks(self.path)
            try:
                check_curves(contents, moving, control, fewest=0)
            except ValueError as error:
                raise LandmarkError(f"{path}: {error}; the picker leaves it alone: give another path") from None
            self.read = contents if isinstance(contents, dict) else {"curves": contents}
            self.known = self.path.read_bytes()
        names = [curve["name"] for curve in self.read["curves"]]
        self.views = {side: View(one, other) for (side, one), other in zip(self.surfaces.items(), shown)}
        pictures = {side: view.picture() for side, view in self.views.items()}
        module = (MODULES / "picker.js").read_text(encoding="utf-8")
        super().__init__(_esm=module, pictures=pictures, names=names or ["curve 1"])
        self.said = "Click the first end on either side."
        if names:
            for side in SIDES:
                self.show(side)
            self.said = f"{counted(names, 'curve')} of {self.path}. {self.said}"
        self.on_msg(self.asked)

    @property
    def curves(self):
        """The curves as in a landmarks file, those read from it first; the last one may lack ends."""
        ends = [dict(curve) for curve in self.read["curves"]]
        ends += [{"name": "", "moving": [], "control": []} for _ in self.names[len(ends) :]]
        for number, side, vertex in self.picks:
            ends[number][side].append(vertex)
        return [{**curve, "name": name} for name, curve in zip(self.names, ends)]

    def asked(self, _, message, buffers):
        """What the browser tells: the name of a method below, and its arguments."""
        what = message.pop("do")
        {"turn": self.turn, "click": self.click, "undo": self.undo, "save": self.save}[what](**message)

    def turn(self, side, right=0, down=0, zoom=1.0):
        """Turn a side's view by pixels of drag, and zoom."""
        self.views[side].turn(right, down, zoom)
        self.pictures = {**self.pictures, side: self.views[side].picture()}
        self.send({"turned": side})

    def click(self, side, x, y):
        """Take the vertex under a pixel of a side's picture as the next end."""
        vertex = self.views[side].vertex_at(x, y)
        if vertex is None:
            self.said = "There is no surface; click on it."
        else:
            self.pick(side, vertex)

    def pick(self, side, vertex):
        """Take a vertex as the next end on a side, of the last curve or of a new one where that is
        complete."""
        if is_complete(self.curves[-1]):
            new = (f"curve {number}" for number in count(len(self.names) + 1))
            self.names = [*self.names, next(name for name in new if name not in self.names)]
        last = self.curves[-1]
        if len(last[side]) == 2:
            self.said = f"{last['name']} has both ends on the {side} side; click them on the {OTHER_SIDE[side]} side."
        else:
            self.picks.append((len(self.names) - 1, side, vertex))
            self.show(side)

    def undo(self):
        """Take the last click back; curves of the file stay."""
        if self.picks:
            number, side, _ = self.picks.pop()
            self.names = self.names[: number + 1]
            self.show(side)

    def show(self, side):
        """Mark a side anew, and say what the last curve lacks."""
        colours = (COLOURS[number % len(COLOURS)] for number in range(len(self.names)))
        self.views[side].mark([(tuple(curve[side]), colour) for curve, colour in zip(self.curves, colours)])
        self.pictures = {**self.pictures, side: self.views[side].picture()}
        last = self.curves[-1]
        lacks = " and ".join(f"{2 - len(last[one])} on the {one} side" for one in SIDES if len(last[one]) < 2)
        self.said = f"{last['name']} " + (f"lacks ends: {lacks}." if lacks else "is complete; name it, go on, or save.")

    def save(self):
        """Write the complete curves to `path`, or say what is wrong with them or the file."""
        marks = {side: surface.fingerprint for side, surface in self.surfaces.items()}
        complete = [curve for curve in self.curves if is_complete(curve)]
        contents = {**self.read, "surfaces": marks, "curves": complete}
        data = (json.dumps(contents, indent=2) + "\n").encode()
        try:
            if self.path.exists() and self.path.read_bytes() != self.known:
                advice = "move it away and save again, or make a picker anew, which reads it"
                raise LandmarkError(f"{self.path} has changed since it was read or written: {advice}")
            check_curves(contents, *self.surfaces.values())
            write_whole(self.path, lambda place: place.write_bytes(data))
            self.known = data
            rest = "" if is_complete(self.curves[-1]) else f"; {self.names[-1]} lacks ends and is not in it"
            self.said = f"{counted(complete, 'curve')} written to {self.path}{rest}."
        except (ValueError, OSError) as error:
            self.said = f"Not saved: {error}"


def is_complete(curve):
    return all(len(curve[side]) >= 2 for side in SIDES)
