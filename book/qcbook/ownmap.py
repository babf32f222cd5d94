"""A folder that `qclearn register` wrote, as the tuner takes it: its surfaces, curves and settings."""

import shlex

import numpy as np

from qclearn.cli.registration import register
from qclearn.io.mapfile import numbering_of_side
from qclearn.plane.grids import COARSE, polar, thinned
from qclearn.registration.curves import SIDES, check_curves
from qclearn.registration.problem import DELTA, ETA, Problem
from qclearn.reports.finished import ReportError, read_finished
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.curvature import area_radius
from qclearn.surfaces.surface import Surface

from .examples import Courses, Example, curves_between
from .liveproblems import FSAVERAGE

MOST = 128  # landmarks that the browser's fit takes
DRAWN = 20_000  # vertices of a surface that a page turns without waiting


class OwnMap:
    """moving, control: the surfaces as registered; curves: the landmarks, in their numbers, as `qc.register`
    takes them; pair: their `Courses`; example: the `Example`; start: the state that the tuner begins with;
    again: words of the command that wrote the folder; note: what the tuner does not show.

    ReportError, in a sentence, for a folder that is none, has no curves, or was stopped before the fit.
    """

    def __init__(self, folder):
        finished = read_finished(folder)
        report, arrays = finished.report, finished.arrays
        if report.get("stopped"):
            why = "; ".join(report["suspect"])
            raise ReportError(
                f"{folder}: `register` found the landmarks or the surfaces wrong, and fitted nothing to tune; {why}"
            )
        self.moving, self.control = finished.moving.surface, finished.control.surface
        self.again = command_words(report["command"])
        if self.again:
            lines = [f"own = Tuner({str(folder)!r})", "moving, control, curves = own.moving, own.control, own.curves"]
            self.again["python"] = ["from qcbook import Tuner", "", *lines]
        given = report.get("landmarks", {}).get("curves")
        if not given or not report["curves"]:
            advice = "register with --landmarks to tune them"
            if self.again:
                if "--no-landmarks" in self.again["register"]:
                    advice = "leave out --no-landmarks to tune its curves"
                held = [word for name in report["held_out_mm"] for word in ("--hold-out", name)]
                words = shlex.join(["qclearn", "register", *self.again["register"], *held])
                advice += f", or change δ and η in: {words} --delta {DELTA:g} --eta {ETA:g} --out tuned"
            raise ReportError(f"{folder}: was registered by folds alone, and the tuner moves landmarks; {advice}")

        # The curves are given by numbers of whole surfaces, where such were given.
        self.curves = [curve | {"hold_out": False} for curve in given]  # the tuner says which it holds out
        for side in SIDES:
            numbering = numbering_of_side(arrays, side)
            if numbering.known and report["inputs"][side]["vertices"] == numbering.count:
                for curve in self.curves:
                    curve[side] = numbering.places(np.array(curve[side])).tolist()
        checked = check_curves(self.curves, self.moving, self.control)
        names = tuple(curve.name for curve in checked)
        points = MOST // len(checked)
        if points < 2:
            raise ReportError(f"{folder}: has {len(checked)} curves, and the tuner takes {MOST // 2}; hold some out")
        paths = [curves_between(getattr(self, side), checked, side) for side in SIDES]
        self.pair = Courses(str(folder), finished.moving, finished.control, names, paths)
        sides = self.pair.sample_landmarks(min(points, 5))
        labels = np.repeat(np.arange(len(names)), len(sides[0][0]))
        problem = Problem(polar(*COARSE), *map(np.concatenate, sides), labels)
        self.example = Example(str(folder), problem, area_radius(self.moving, finished.moving.disk.z))

        held = [k for k, curve in enumerate(checked) if curve.hold_out or curve.name in report["held_out_mm"]]
        weights = {name: report[name] for name in ("alpha", "beta", "gamma")}
        if report["features"] and self.again:
            of_folds = {"delta": report["delta"], "eta": report.get("eta", 0.0)}
            self.again["withFolds"] = [*(weights | of_folds).items()]
        self.start = weights | {"problem": "own", "held": held if len(held) < len(names) else [], "shade": "mu"}
        self.note = note_of(report, len(self.control.vertices))

    def drawn_control(self):
        """The control's `ParameterizedSurface`, on DRAWN of its vertices if it has more."""
        full = self.pair.control
        surface = full.surface
        if len(surface.vertices) <= DRAWN:
            return full
        some, disk = thinned(full.disk, surface.vertex_areas / surface.area, DRAWN)
        return ParameterizedSurface(Surface(surface.vertices[some], disk.faces), disk)


def note_of(report, vertices):
    """What the tuner does not show of a registration, in a sentence."""
    says = ["Landmarks alone, on your own surfaces"]
    if report["features"]:
        weights = f"δ = {report['delta']:g}, η = {report.get('eta', 0.0):g}"
        says.append(
            f"the folder's map also fits folds ({weights}), which need `register` again by Command with folds, at the "
            "folder's α, β and γ"
        )
    if vertices > DRAWN:
        says.append(f"drawn on {DRAWN:,} of {vertices:,} vertices")
    return "; ".join(says) + "."


def command_words(command):
    """Of the command that wrote a folder what `Copy as command` goes on from; None if it is not of `qclearn
    register`."""
    if command[1:2] == ["demo"]:
        return dict(FSAVERAGE)
    if command[1:2] != ["register"]:
        return None
    settings = {"ignore_unknown_options": True, "allow_extra_args": True, "resilient_parsing": True}
    given = register.make_context("register", list(command[2:]), **settings).params
    words = [given["moving"], given["control"]]
    for name in ("cortex", "control_cortex", "units", "landmarks"):
        if given[name] and given[name] != "mm":
            words += [f"--{name.replace('_', '-')}", given[name]]
    words += [f"--{name.replace('_', '-')}" for name in ("merge", "mirror", "no_landmarks") if given[name]]
    features = [word for pair in given["given"] or () for word in ("--feature", *pair)]
    return {"before": [], "register": words, "features": features}
