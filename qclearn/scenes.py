"""Three-dimensional scenes that need no server and no network: a self-contained page inside an iframe.

PyVista's own notebook backends leave links to a server on the author's machine in the built book. A `Scene` is the
scene itself: geometry, viewer and all, 1 to 2 MB of HTML for a surface of 10,000 vertices.
"""

import base64
import ctypes
import html
import io
import os
import re
import sys
import warnings

import numpy as np
import pyvista as pv


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
    """Whether EGL can draw: the library alone is not enough, it needs a driver (Mesa's, or a graphics card's)."""
    egl = _loads("libEGL.so.1")
    if egl is None:
        return False
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        return False
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int))(address)
    count = ctypes.c_int(0)
    return bool(query(0, None, ctypes.byref(count))) and count.value > 0


def require_renderer():
    """Choose how VTK draws without a screen; RendererError instead of VTK's segmentation fault where nothing can draw.

    Does nothing where there is a screen, outside Linux, or where VTK_DEFAULT_OPENGL_WINDOW is set already.
    """
    if not sys.platform.startswith("linux") or os.environ.get("DISPLAY") or "VTK_DEFAULT_OPENGL_WINDOW" in os.environ:
        return
    if _egl_finds_a_device():
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkEGLRenderWindow"
    elif _loads("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"):
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = "vtkOSOpenGLRenderWindow"
    else:
        raise RendererError("no screen, and neither EGL nor OSMesa to draw without one; "
                            "on Debian: apt-get install libegl1 libegl-mesa0 (or libosmesa6)")


class Scene:
    """A 3-D view to turn with the mouse, as the result of a notebook cell.

    `description` says in words what is to be seen (alternative text). With `poster` the page shows a picture, and the
    scene is loaded by a click: browsers keep only 8 to 16 scenes alive on one page. legend: dict label -> CSS colour,
    written over the scene.
    """

    def __init__(self, plotter, description, poster=False, height=480, legend=None):
        require_renderer()
        self.description = description
        self.height = height
        plotter.off_screen = True
        _keep_what_is_shown(plotter)
        self.picture = _png(plotter) if poster else None
        with warnings.catch_warnings():
            # trame-vtk 2.8 calls what VTK 9.6 deprecates.
            warnings.simplefilter("ignore", DeprecationWarning)
            page = _named(plotter.export_html(None).getvalue(), description)
        self.page = page.replace("</body>", _legend(legend) + "</body>") if legend else page
        plotter.close()

    def _repr_html_(self):
        title, page = html.escape(self.description), html.escape(self.page)
        if self.picture is None:
            return f'<iframe class="scene" title="{title}" height="{self.height}" srcdoc="{page}"></iframe>'
        load = "const f=this.nextElementSibling;f.srcdoc=f.dataset.page;f.hidden=false;this.remove()"
        return (f'<button class="scene-poster" type="button" onclick="{load}">'
                f'<img alt="{title}" src="data:image/png;base64,{self.picture}"><span>turn it in 3-D</span></button>'
                f'<iframe class="scene" title="{title}" height="{self.height}" data-page="{page}" hidden></iframe>')


def _named(page, title):
    """The page with a language and a title, and with the reader's zoom, which trame-vtk's template forbids."""
    head = f'<html lang="en"><head><title>{html.escape(title)}</title><meta name="viewport" content="width=device-width">'
    page = re.sub(r'<meta name="viewport"[^>]*>', "", page, count=1)
    return re.sub(r"<html>\s*<head>", lambda found: head, page, count=1)


def _legend(colours):
    rows = "".join(f'<div><span style="color:{colour}" aria-hidden="true">\u25a0</span> {html.escape(label)}</div>'
                   for label, colour in colours.items())
    return (f'<div style="position:fixed;left:8px;bottom:8px;padding:4px 8px;background:white;color:black;'
            f'font:14px sans-serif;pointer-events:none">{rows}</div>')


def _png(plotter):
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(plotter.screenshot(return_img=True)).save(buffer, "PNG")
    return base64.b64encode(buffer.getvalue()).decode()


# At least as many steps over an array's range: below a pixel, below a grey level.
POINT_STEPS, VALUE_STEPS = 2**13, 2**8


def _rounded(array, steps):
    """The array in single precision, rounded to a power of two: the digits that nobody sees cost most on the page."""
    unit = 2.0 ** np.floor(np.log2(max(np.ptp(array), np.finfo(np.float32).tiny) / steps))
    return (np.round(array / unit) * unit).astype(np.float32)


def _keep_what_is_shown(plotter):
    """Digits that show, and only the array that colours the surface: a third of the bytes on the page."""
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
