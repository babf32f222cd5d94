"""A finished registration, read from the folder that `qclearn register` wrote, and its maps."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..io.mapfile import read_registration
from ..io.safe import read_bytes
from ..plane.disk import Disk
from ..plane.linear import around_vertices
from ..registration.features import FINEST, Features, Smoothing
from ..registration.report import area_and_shape
from ..surfaces.conformal import ParameterizedSurface
from ..surfaces.curvature import mean_curvature
from ..surfaces.surface import Surface, SurfaceError

FILES = ("registration.npz", "report.json")
# The keys of report.json that pages show, by type.
KEYS = {
    dict: "inputs seconds r features held_out_mm versions",
    list: "command suspect fallbacks curves log2_area log2_shape",
    str: "method",
    bool: "bijective",
    int: "flipped degenerate",
    (int, float): "alpha beta gamma delta mean_abs_mu sd_abs_mu max_abs_mu",
}


class ReportError(ValueError):
    """A folder of which no report can be made: says which, why, and what to do."""


@dataclass(frozen=True, eq=False)
class Maps:
    """Maps on the vertices of a control, each (W,).

    control, before, after: curvature at FINEST in standard deviations, the control's own and the
    moving surface's after the best Möbius map and after the registration; mu: |mu|; log2_area:
    log2 of the ratio of areas control : moving.
    """

    control: np.ndarray
    before: np.ndarray
    after: np.ndarray
    mu: np.ndarray
    log2_area: np.ndarray


@dataclass(frozen=True, eq=False)
class FinishedRegistration:
    """The arrays of a registration.npz and the report.json of the same run."""

    folder: Path
    arrays: dict
    report: dict

    @cached_property
    def control(self):
        """The control's `ParameterizedSurface` with its curvature."""
        return self.side("control")

    @cached_property
    def moving(self):
        """The moving `ParameterizedSurface`, aligned with the control's disk, with its curvature."""
        return self.side("moving")

    def side(self, name):
        try:
            surface = Surface(self.arrays[f"vertices_{name}"], self.arrays[f"faces_{name}"])
        except SurfaceError as error:
            raise ReportError(f"{self.folder / FILES[0]}: the {name} surface: {error}") from None
        folds = Smoothing(surface, ["curvature"], mean_curvature(surface)[:, None])
        disk = Disk(self.arrays[f"disk_{name}"], surface.faces)
        return ParameterizedSurface(surface, disk, folds)

    def names(self):
        """The moving surface and the control, each the last three parts of its path."""
        paths = [Path(self.report["inputs"][side]["path"]) for side in ("moving", "control")]
        return ["/".join(path.parts[-3:]) for path in paths]

    def r(self):
        """Correlation of the curvatures after the best Möbius map and after the registration.

        Measured here where curvature was no feature of the registration.
        """
        if "curvature" in self.report["r"]:
            return tuple(self.report["r"]["curvature"])
        features = Features(self.moving, self.control)
        disks = self.arrays["disk_moving"], self.arrays["disk_map"]
        return tuple(float(features.correlation(disk)[0]) for disk in disks)

    def high_mu(self):
        """The |mu| below which 95 % of the moving triangles are."""
        return float(np.percentile(abs(self.arrays["mu"]), 95))

    def held_out(self):
        """Mean distance of the held-out curves before and after, in mm; NaN without any."""
        distances = list(self.report["held_out_mm"].values())
        return tuple(np.mean(distances, axis=0).tolist()) if distances else (np.nan, np.nan)

    def maps(self):
        """The `Maps` of this registration on its control."""
        surface = self.moving.surface
        faces = surface.faces
        # Per vertex: the ratio of the areas around it, and the mean of |mu| over its faces.
        log2_area, _ = area_and_shape(surface, self.arrays["points"])
        weighted_mu = surface.face_areas * abs(self.arrays["mu"])
        mu = around_vertices(weighted_mu, faces) / (3 * surface.vertex_areas)
        curvature = self.moving.smoothing.at(FINEST)[:, 0]
        # All maps live on the moving mesh: read them where the control's vertices lie.
        z = self.control.disk.z
        disk = self.moving.disk
        before = disk.interpolate(curvature, disk.locate(z))
        values = np.stack([curvature, mu, log2_area], axis=1)
        registered = self.moving.disk.at(self.arrays["disk_map"])
        after, mu, log2_area = registered.interpolate(values, registered.locate(z)).T
        return Maps(self.control.smoothing.at(FINEST)[:, 0], before, after, mu, log2_area)


def read_finished(folder):
    """The `FinishedRegistration` of a folder.

    ReportError where files are missing or of two runs, SurfaceError where registration.npz is not
    sound or of an older version.
    """
    folder = Path(folder)
    missing = [name for name in FILES if not (folder / name).is_file()]
    if missing:
        names = " and no ".join(missing)
        fault = f"has no {names}" if folder.is_dir() else f"is no folder in {Path.cwd()}"
        raise ReportError(f"{folder}: {fault}; give a folder that `qclearn register` wrote")
    arrays = read_registration(folder / FILES[0])
    report = read_report(folder / FILES[1])
    size = abs(arrays["mu"])
    reported = [report["mean_abs_mu"], report["max_abs_mu"]]
    if not np.allclose([size.mean(), size.max()], reported, rtol=1e-9, atol=0):
        raise ReportError(
            f"{folder}: report.json is of another run than registration.npz (mean |mu| "
            f"{reported[0]:.6f} and {size.mean():.6f}); copy both from one folder, or run "
            "`qclearn register` again"
        )
    return FinishedRegistration(folder, arrays, report)


def read_report(path):
    """A report.json as dict, with KEYS of the right types; ReportError otherwise."""
    try:
        report = json.loads(read_bytes(path))
    except ValueError:
        advice = "run `qclearn register` again, or copy the file again"
        raise ReportError(f"{path}: not JSON; {advice}") from None
    values = report if isinstance(report, dict) else {}
    types = {name: kind for kind, names in KEYS.items() for name in names.split()}
    wrong = [name for name, kind in types.items() if not isinstance(values.get(name), kind)]
    if wrong:
        what = f"not a report of `qclearn register` (see {wrong[0]!r})"
        raise ReportError(f"{path}: {what}; give the folder that it wrote")
    return report
