"""The page of one registration."""

import shlex

from .finished import read_finished
from .render import render, require_html, write_text
from .views import ColorScale, InflatedView, curvature_scale

DIFFERENCE = ColorScale("difference, after − control", "RdBu_r", -3, 3, "SD")
MU = ColorScale("shape |μ|", "viridis", 0, 0.8, "0: conformal, 1: flat")
AREA = ColorScale("area log2 J", "PuOr_r", -2, 2, "−1: half of its area, 1: twice")
PICTURES = {
    "before": "The moving surface's curvature on the inflated control before registration",
    "after": "The moving surface's curvature on the inflated control after registration",
    "control": "The control's own curvature on its inflated surface",
}


def write_pair(folder, out):
    """Write the page of a registration's `folder` to `out`, one HTML file without network requests.

    ReportError where the folder is not a whole one of `qclearn register`, or `out` is no name of
    a page.
    """
    out = require_html(out)
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
    text = render(
        "pair.html",
        moving=moving,
        control=control,
        registration=registration,
        report=registration.report,
        command=shlex.join(map(str, registration.report["command"])),
        pictures=view.pictures(curvatures, PICTURES),
        scene=view.scene(scene),
    )
    write_text(out, text)
