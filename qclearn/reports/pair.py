"""The page of one registration."""

import math
import shlex
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..io.safe import sound_text, write_whole
from .finished import ReportError, read_finished
from .views import ColorScale, InflatedView, curvature_scale

DIFFERENCE = ColorScale("difference, after − control", "RdBu_r", -3, 3, "SD")
MU = ColorScale("shape |μ|", "viridis", 0, 0.8, "0: conformal, 1: flat")
AREA = ColorScale("area log2 J", "PuOr_r", -2, 2, "−1: half of its area, 1: twice")
PICTURES = {
    "before": "The moving surface's curvature on the inflated control before registration",
    "after": "The moving surface's curvature on the inflated control after registration",
    "control": "The control's own curvature on its inflated surface",
}


def number(value, digits=2):
    """A number as text with a true minus; an en dash for None and NaN."""
    if value is None or math.isnan(value):
        return "–"
    return f"{value:z.{digits}f}".replace("-", "−")


TEMPLATES = Environment(
    loader=PackageLoader(__package__),
    autoescape=True,  # names of files and reasons are no markup
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
TEMPLATES.filters["number"] = number


def write_pair(folder, out):
    """Write the page of a registration's `folder` to `out`, one HTML file without network requests.

    ReportError where the folder is not a whole one of `qclearn register`, or `out` is no name of
    a page.
    """
    out = Path(out)
    if out.suffix.lower() not in (".html", ".htm"):
        raise ReportError(f"{out}: give a name that ends in .html")
    registration = read_finished(folder)
    maps = registration.maps()
    curvatures = {name: getattr(maps, name) for name in PICTURES}
    view = InflatedView(registration.control.surface)
    scene = [
        (curvature_scale("curvature, after"), maps.after),
        (curvature_scale("curvature, before"), maps.before),
        (curvature_scale("curvature, control"), maps.control),
        (DIFFERENCE, maps.after - maps.control),
        (MU, maps.mu),
        (AREA, maps.log2_area),
    ]
    moving, control = registration.names()
    text = TEMPLATES.get_template("pair.html").render(
        moving=moving,
        control=control,
        registration=registration,
        report=registration.report,
        command=shlex.join(map(str, registration.report["command"])),
        pictures=view.pictures(curvatures, PICTURES),
        scene=view.scene(scene),
    )
    # What UTF-8 cannot hold, as in names of files, is escaped.
    data = sound_text(text).encode()
    write_whole(out, lambda place: place.write_bytes(data))
