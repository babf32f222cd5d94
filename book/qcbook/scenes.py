"""Three-dimensional scenes without server or network: a self-contained page inside an iframe.

PyVista's own notebook backends leave links to the author's machine in the built book. A `Scene`
holds geometry and viewer, 1 to 2 MB of HTML for a surface of 10,000 vertices.
"""

import ctypes
import html
import io
import os
import re
import sys
import warnings

import numpy as np
from scipy.spatial import cKDTree

from qclearn.interrupts import signals_wait
from qclearn.plane.disk import Disk
from qclearn.plot import CURVE_STYLES, map_curves

with signals_wait():
    import pyvista as pv
    from matplotlib.colors import LinearSegmentedColormap

    from qcbook.figures import picture_html

# Lit from one side, black to white is too dark.
SHADES = LinearSegmentedColormap.from_list("shades", ["0.38", "1.0"])
LIFT = 0.6  # of tubes in 3-D above the surface, in their radius
# Styles stand in the elements: JupyterLab knows no style sheet of the book.
FRAME = 'class="scene" width="100%" style="border:0"'
POSTER = "position:relative;display:block;width:100%;padding:0;border:0;background:none;"
POSTER += "cursor:pointer"
CAPTION = (
    "position:absolute;left:50%;bottom:16px;transform:translateX(-50%);padding:5px "
    "13px;border-radius:16px;background:#595959;color:white;font:16px sans-serif"
)


class RendererError(RuntimeError):
    """No way to draw without a screen: VTK would crash the process."""


def _loads(*libraries):
    for library in libraries:
        try:
            return ctypes.CDLL(library)
        except OSError:
            continue
    return None


def _egl_finds_a_device():
    """Whether EGL can draw: besides the library it needs a driver (Mesa's or a graphics card's)."""
    egl = _loads("libEGL.so.1")
    if egl is None:
        return False
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        return False
    arguments = ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int)
    query = ctypes.CFUNCTYPE(ctypes.c_uint, *arguments)(address)
    count = ctypes.c_int(0)
    return bool(query(0, None, ctypes.byref(count))) and count.value > 0


def require_renderer():
    """Choose how VTK draws without a screen; RendererError instead of its segmentation fault.

    Does nothing with a screen, outside Linux, or where VTK_DEFAULT_OPENGL_WINDOW is set.
    """
    chosen = os.environ.get("DISPLAY") or "VTK_DEFAULT_OPENGL_WINDOW" in os.environ
    if chosen or not sys.platform.startswith("linux"):
        return
    if _egl_finds_a_device():
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkEGLRenderWindow"
    elif _loads("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"):
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkOSOpenGLRenderWindow"
    else:
        advice = "on Debian: apt-get install libegl1 libegl-mesa0 (or libosmesa6)"
        raise RendererError(f"no screen, and neither EGL nor OSMesa to draw without one; {advice}")


class Scene:
    """A 3-D view to turn with the mouse, as the result of a notebook cell.

    description: alternative text; poster: show a picture, and load the scene by a click: browsers
    keep only 8 to 16 scenes alive on one page; legend: dict label -> CSS colour, written over the
    scene.
    """

    def __init__(self, plotter, description, poster=False, height=480, legend=None):
        require_renderer()
        self.description, self.height = description, height
        plotter.off_screen = True
        _keep_what_is_shown(plotter)
        self.picture = None
        if poster:
            buffer = io.BytesIO()
            plotter.screenshot(buffer, transparent_background=True)
            self.picture = buffer.getvalue()
        with warnings.catch_warnings():
            # trame-vtk 2.8 calls what VTK 9.6 deprecates.
            warnings.simplefilter("ignore", DeprecationWarning)
            page = _named(plotter.export_html(None).getvalue(), description)
        self.page = page.replace("</body>", _legend(legend) + "</body>") if legend else page
        plotter.close()

    def _repr_html_(self):
        page = html.escape(self.page)
        frame = f'{FRAME} title="{html.escape(self.description)}" height="{self.height}"'
        if self.picture is None:
            return f'<iframe {frame} srcdoc="{page}"></iframe>'
        picture = picture_html(self.picture, self.description, ' style="width:100%"')
        load = "const f=this.nextElementSibling;f.srcdoc=f.dataset.page;f.hidden=false;this.remove()"
        return (
            f'<button class="scene-poster" type="button" style="{POSTER}" onclick="{load}">'
            f'{picture}<span style="{CAPTION}">turn it in 3-D</span></button>'
            f'<iframe {frame} data-page="{page}" hidden></iframe>'
        )


def _named(page, title):
    """The page with language, title and the reader's zoom, and without a picture from a server.

    trame-vtk's template forbids zooming, and its viewer asks for a picture while it has no scene.
    """
    zoom = '<meta name="viewport" content="width=device-width">'
    head = f'<html lang="en"><head><title>{html.escape(title)}</title>{zoom}'
    page = re.sub(r'<meta name="viewport"[^>]*>', "", page, count=1)
    page = re.sub(r'\w+\.p\+"[0-9a-f]+\.jpg"', '"data:,"', page)
    return re.sub(r"<html>\s*<head>", lambda match: head, page, count=1)


def _legend(colours):
    rows = "".join(
        f'<div><span style="color:{colour}" aria-hidden="true">\u25a0</span> {html.escape(label)}</div>'
        for label, colour in colours.items()
    )
    return (
        f'<div style="position:fixed;left:8px;bottom:8px;padding:4px 8px;background:white;color:black;'
        f'font:14px sans-serif;pointer-events:none">{rows}</div>'
    )


# At least as many steps over an array's range: below a pixel, below a grey level.
POINT_STEPS, VALUE_STEPS = 2**13, 2**8


def _rounded(array, steps):
    """The array in float32, rounded to a power of two: fewer digits take fewer bytes."""
    unit = 2.0 ** np.floor(np.log2(max(np.ptp(array), np.finfo(np.float32).tiny) / steps))
    return (np.round(array / unit) * unit).astype(np.float32)


def _keep_what_is_shown(plotter):
    """Keep digits that show, and the array that colours the surface: a third of the bytes."""
    for actor in plotter.actors.values():
        mapper = getattr(actor, "mapper", None)
        if mapper is None:
            continue
        mapper.Update()  # before that, a surface that nobody but the plotter holds looks empty
        if not isinstance(mapper.dataset, pv.PolyData):
            continue
        shown = mapper.dataset.copy()
        shown.points = _rounded(shown.points, POINT_STEPS)
        for arrays in (shown.point_data, shown.cell_data):
            for name in list(arrays):
                if name not in (mapper.array_name, "Normals"):
                    del arrays[name]
                elif np.issubdtype(arrays[name].dtype, np.floating):
                    arrays[name] = _rounded(arrays[name], VALUE_STEPS)
        mapper.dataset = shown


def surface_scene(surface, values=None, curves=(), cmap=SHADES, clim=None, title=None):
    """A PyVista Plotter of the surface, coloured by values (V,), with curves; show it by `Scene`.

    curves: pairs (points (k, 3) or vertex path (k,), style of `CURVE_STYLES`), as tubes a little
    above the surface. An open surface is seen from the side away from its opening. A page carries
    all arrays: float32.
    """
    require_renderer()
    plotter = pv.Plotter(window_size=(700, 500))
    plotter.set_background("white")
    mesh = _add_surface(plotter, surface, values, cmap=cmap, clim=clim, title=title)
    radius = 0.006 * np.linalg.norm(np.ptp(surface.vertices, axis=0))
    for curve, style in curves:
        curve = np.asarray(curve)
        points = surface.vertices[curve] if curve.ndim == 1 else curve
        # A tube about a line within the surface would sink and rise with its faces, and flicker
        # where the two meet.
        nearest = cKDTree(surface.vertices).query(points)[1]
        points = points + LIFT * radius * mesh["Normals"][nearest]
        tube = pv.lines_from_points(points.astype(np.float32)).tube(radius=radius, n_sides=8)
        tube.clear_data()
        plotter.add_mesh(tube, color=CURVE_STYLES[style]["color"])
    if surface.boundary_loops:
        rim = np.concatenate(surface.boundary_loops)
        away = surface.vertices.mean(0) - surface.vertices[rim].mean(0)
        is_vertical = abs(away[2]) > 0.9 * np.linalg.norm(away)
        plotter.view_vector(away, viewup=(0, 1, 0) if is_vertical else (0, 0, 1))
    return plotter


def _add_surface(plotter, surface, values, shift=(0, 0, 0), cmap=SHADES, clim=None, title=None):
    """Add the surface, moved by `shift`, to a Plotter; returns the mesh that it shows."""
    vertices = (surface.vertices + np.asarray(shift)).astype(np.float32)
    mesh = pv.PolyData.from_regular_faces(vertices, surface.faces)
    # The plotter would compute normals only while it draws, too late for whoever looks at its
    # meshes before.
    mesh = mesh.compute_normals(cell_normals=False, split_vertices=False, consistent_normals=False)
    colour = {"color": "lightgray"}
    if values is not None:
        mesh.point_data["values"] = np.asarray(values, np.float32)
        colour = {"scalars": "values", "cmap": cmap, "clim": clim}
        colour["show_scalar_bar"] = title is not None
        colour["scalar_bar_args"] = {"title": title or "", "color": "black"}
    plotter.add_mesh(mesh, smooth_shading=True, ambient=0.15, **colour)
    return mesh


def stacked_scene(surfaces, values, **more):
    """A Plotter with surfaces one below the other, to scale, turned by one camera.

    surfaces: list, the first on top; values: list of (V,). Seen horizontally, from the first one's
    side.
    """
    plotter = surface_scene(surfaces[0], values[0], **more)
    edge = surfaces[0].vertices[:, 2].min()
    for surface, colours in zip(surfaces[1:], values[1:]):
        middle = (surfaces[0].vertices.mean(0) - surface.vertices.mean(0))[:2]
        edge -= 0.08 * np.ptp(surface.vertices[:, 2])
        shift = *middle, edge - surface.vertices[:, 2].max()
        _add_surface(plotter, surface, colours, shift, **more)
        edge -= np.ptp(surface.vertices[:, 2])
    plotter.camera.parallel_projection = True  # the lower one is as near as the upper one
    x, y, _ = plotter.camera.direction
    plotter.view_vector((-x, -y, 0), viewup=(0, 0, 1))
    return plotter


def surface_picture(surface, values=None, direction=None, up=(0, 0, 1), height=138.0, **more):
    """A photograph (rows, columns, 3) of the surface; `height` units of length fill its height.

    direction: towards the eye; by default away from its opening. `more` goes to `surface_scene`.
    """
    plotter = surface_scene(surface, values, **more)
    plotter.off_screen, plotter.window_size = True, (960, 640)
    if direction is not None:
        plotter.view_vector(direction, viewup=up)
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = height / 2
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    return pixels


def registration_scene(registration, shape, **more):
    """A Plotter of a `Registration`'s landmarks: registered curves yellow, targets red.

    shape: the control surface, or another with its faces (inflated, say). `more` goes to
    `surface_scene`.
    """
    r = registration
    moving, targets = (list(side) for side in zip(*r.curves.values()))
    moving = map_curves(Disk(r.disk_moving, r.faces_moving), r.disk_map, moving)
    disk = Disk(r.disk_control, shape.faces)
    curves = [
        (disk.interpolate(shape.vertices, disk.locate(curve)), style)
        for side, style in ((targets, "target"), (moving, "registered"))
        for curve in side
    ]
    return surface_scene(shape, curves=curves, **more)
