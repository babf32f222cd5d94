"""A finished registration, read from the folder that `qclearn register` wrote, and its maps on the control."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..io.safe import read_bytes
from ..plane.disk import Disk
from ..registration.features import Features
from ..registration.mapfile import read_registration
from ..registration.metrics import SMALLEST_RATIO
from ..registration.smoothing import FINEST, Smoothing
from ..surfaces.conformal import Side
from ..surfaces.curvature import mean_curvature
from ..surfaces.surface import Surface, SurfaceError

FILES = ("registration.npz", "report.json")
# What a page says of report.json, key by key, with its type.
SAID = {
    "inputs": dict, "command": list, "suspect": list, "fallbacks": list, "curves": list, "seconds": dict, "r": dict,
    "features": dict, "held_out_mm": dict, "versions": dict, "method": str, "bijective": bool, "flipped": int,
    "degenerate": int, "alpha": float, "beta": float, "gamma": float, "delta": float, "mean_abs_mu": float,
    "sd_abs_mu": float, "max_abs_mu": float, "log2_area": list, "log2_shape": list,
}  # fmt: skip


class ReportError(ValueError):
    """A folder of which no report can be made: says which, why, and what to do."""


@dataclass(frozen=True, eq=False)
class Maps:
    """Per-vertex maps (W,) on a control: curvature at FINEST in standard deviations, the control's own and the moving
    one's `before` (best Möbius map) and `after`; |mu|, and log2 of the ratio of areas control : moving."""

    control: np.ndarray
    before: np.ndarray
    after: np.ndarray
    mu: np.ndarray
    log2_area: np.ndarray


@dataclass(frozen=True, eq=False)
class Finished:
    """The arrays of a registration.npz of format 2 and the report.json of the same run."""

    folder: Path
    arrays: dict
    report: dict

    @cached_property
    def control(self):
        """The control's `Side` with its curvature."""
        return self.side("control")

    @cached_property
    def moving(self):
        """The moving `Side`, laid upon the control's disk, with its curvature."""
        return self.side("moving")

    def side(self, name):
        try:
            surface = Surface(self.arrays[f"vertices_{name}"], self.arrays[f"faces_{name}"])
        except SurfaceError as error:
            raise ReportError(f"{self.folder / FILES[0]}: the {name} surface: {error}") from None
        features = Smoothing(surface, ["curvature"], mean_curvature(surface)[:, None])
        return Side(surface, Disk(self.arrays[f"disk_{name}"], surface.faces), features)

    def names(self):
        """What the moving surface and the control are called: the last parts of their paths, as many as tell."""
        paths = [Path(self.report["inputs"][side]["path"]).parts for side in ("moving", "control")]
        return ["/".join(parts[-3:]) for parts in paths]

    def r(self):
        """Correlation of the curvatures after the best Möbius map and after the registration: the report's own, or
        measured alike where curvature was no feature."""
        if "curvature" in self.report["r"]:
            return tuple(self.report["r"]["curvature"])
        features = Features(self.moving, self.control)
        return tuple(float(features.correlation(self.arrays[name])[0]) for name in ("disk_moving", "disk_map"))

    def high_mu(self):
        """The |mu| below which 95 % of the moving triangles are."""
        return float(np.percentile(abs(self.arrays["mu"]), 95))

    def held_out(self):
        """Mean distance of the held-out curves before and after, in mm, NaN without any."""
        rows = list(self.report["held_out_mm"].values())
        return tuple(np.mean(rows, axis=0).tolist()) if rows else (np.nan, np.nan)

    def maps(self):
        """The `Maps` of this registration on its control."""
        moving, control, f = self.moving, self.control, self.arrays["disk_map"]
        points, faces = self.arrays["points"], moving.surface.faces
        a, b, c = (points[corner] for corner in faces.T)
        there = np.bincount(faces.ravel(), np.repeat(np.linalg.norm(np.cross(b - a, c - a), axis=1), 3))
        here = moving.surface.vertex_areas
        ratio = np.maximum((there / there.sum()) / (here / here.sum()), SMALLEST_RATIO)
        weights = np.repeat(moving.surface.face_areas, 3)
        mu = np.bincount(faces.ravel(), weights * np.repeat(abs(self.arrays["mu"]), 3)) / (3 * here)
        curvature = moving.features.at(FINEST)[:, 0]
        before = carried(curvature[:, None], moving.disk, control.disk.z)[:, 0]
        values = np.stack([curvature, mu, np.log2(ratio)], axis=1)
        after, *others = carried(values, moving.disk.at(f), control.disk.z).T
        return Maps(control.features.at(FINEST)[:, 0], before, after, *others)


def carried(values, disk, z):
    """Values (V, k) of the vertices of a `Disk` at points z (W,): (W, k)."""
    return disk.interpolate(values, disk.locate(z))


def read_finished(folder):
    """The `Finished` registration of a folder; ReportError where files are missing or of two runs, SurfaceError where
    registration.npz is not sound or of an older version."""
    folder = Path(folder)
    missing = [name for name in FILES if not (folder / name).is_file()]
    if missing:
        raise ReportError(f"{folder}: has no {' and no '.join(missing)}; give a folder that `qclearn register` wrote")
    arrays = read_registration(folder / FILES[0], surfaces=True)
    report = read_report(folder / FILES[1])
    size = abs(arrays["mu"])
    if not np.allclose([size.mean(), size.max()], [report["mean_abs_mu"], report["max_abs_mu"]], rtol=1e-9, atol=0):
        raise ReportError(
            f"{folder}: report.json is of another run than registration.npz (mean |mu| {report['mean_abs_mu']:.6f} "
            f"and {size.mean():.6f}); copy both from one folder, or run `qclearn register` again"
        )
    return Finished(folder, arrays, report)


def read_report(path):
    """A report.json as dict, whose keys that pages tell have the types they are told by; ReportError otherwise."""
    data = read_bytes(path)
    try:
        report = json.loads(data)
    except ValueError:
        raise ReportError(f"{path}: not JSON; run `qclearn register` again, or copy the file again") from None
    bad = [key for key, kind in SAID.items() if not isinstance(report, dict) or not of_kind(report.get(key), kind)]
    if bad:
        raise ReportError(f"{path}: not a report of `qclearn register` (see {bad[0]!r}); give the folder that it wrote")
    return report


def of_kind(value, kind):
    """Whether a value of a report.json has a type; a whole number is a float, too, and no truth is a number."""
    kinds = (int, float) if kind is float else (kind,)
    return isinstance(value, kinds) and (kind is bool or not isinstance(value, bool))
