"""The page of a group: a row per subject, worst first, and the mean curvature before and after.

A csv with the same figures stands beside it.
"""

import csv
import io
import os
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import quote

import numpy as np

from .finished import ReportError, read_finished
from .render import render, require_html, write_text
from .views import ColorScale, InflatedView, curvature_scale

# What is compared within a group: label, and which sign of its z-score is bad.
MEASURES = {
    "r_after": ("r(curvature)", -1),
    "held_out_after_mm": ("held out, mm", 1),
    "log2_area_95": ("95 % |log2 J|", 1),
    "mu_95": ("95 % |μ|", 1),
}
FEWEST = 3  # subjects for a z-score
ODD = 2.0  # z-score on the bad side from which a row is marked
MOST_PICTURES = 150  # more would make the page too heavy
SPREAD_UNIT = "standard deviation, in SD"
SPREAD = ColorScale("spread over the subjects, after", "viridis", 0, 1.5, SPREAD_UNIT)
PICTURES = {
    "before": "mean curvature of the subjects before registration",
    "after": "mean curvature of the subjects after registration",
    "control": "curvature of the control",
}


@dataclass(frozen=True)
class Subject:
    """A subject of a group with its registration's folder.

    figures: name -> number; suspect: reasons; picture, page: addresses, "" without; z: of MEASURES.
    """

    name: str
    folder: Path
    figures: dict
    suspect: list
    picture: str = ""
    page: str = ""
    z: dict | None = None

    @property
    def worst(self):
        """The largest z-score on the bad side; -inf without any."""
        scores = [sign * self.z[key] for key, (_, sign) in MEASURES.items()]
        return max((score for score in scores if np.isfinite(score)), default=-np.inf)

    @property
    def broken(self):
        """Whether it is suspect or has flipped triangles."""
        return bool(self.suspect or self.figures["flipped"])

    @property
    def state(self):
        return "bad" if self.broken else "odd" if self.worst >= ODD else "good"

    @property
    def reasons(self):
        """The kinds of reasons, such as "error"."""
        return [reason.split(":")[0] for reason in self.suspect]


def write_group(folders, out):
    """Write the page of registrations onto one control to `out`, and a csv of their figures.

    ReportError where a folder is given twice, is not whole, or has another control than the first.
    """
    out = require_html(out)
    first = read_finished(folders[0])
    view = InflatedView(first.control.surface)
    subjects = []
    seen = {}
    sums = 0.0
    for folder, name in zip(folders, short_names(folders)):
        registration = read_finished(folder)
        if registration.control.surface.fingerprint != first.control.surface.fingerprint:
            difference = f"its control is not that of {folders[0]}"
            raise ReportError(f"{folder}: {difference}; give folders of one control")
        twin = seen.setdefault(registration.moving.surface.fingerprint["sha256"], folder)
        if len(seen) == len(subjects):
            again = "given twice" if twin == folder else f"its subject is that of {twin}"
            raise ReportError(f"{folder}: {again}; a group counts each subject once")
        maps = registration.maps()
        sums = sums + np.stack([maps.before, maps.after, maps.after**2])
        picture = ""
        if len(folders) <= MOST_PICTURES:
            picture = view.picture(maps.after, curvature_scale("curvature"), width=200)
        figures, suspect = figures_of(registration), registration.report["suspect"]
        page = address_of(Path(folder, "report.html"), out)
        subjects.append(Subject(name, Path(folder), figures, suspect, picture, page))
    subjects = sorted(scored(subjects), key=lambda subject: (not subject.broken, -subject.worst))
    text = group_page(subjects, first, view, sums / len(folders), out.with_suffix(".csv").name)
    write_text(out.with_suffix(".csv"), csv_of(subjects), "utf-8-sig")  # Excel needs the mark
    write_text(out, text)


def group_page(subjects, first, view, means, csv_name):
    """The page as text; means: (3, W), of the curvature before, after, and its square after."""
    before, after, square = means
    control = first.maps().control
    curvatures = {"before": before, "after": after, "control": control}
    spread = np.sqrt(np.maximum(square - after**2, 0))
    scene = [
        (curvature_scale("mean curvature, after"), after),
        (curvature_scale("mean curvature, before"), before),
        (curvature_scale("curvature, control"), control),
        (SPREAD, spread),
    ]
    areas = first.control.smoothing.areas
    return render(
        "group.html",
        subjects=subjects,
        control=first.names()[1],
        measures=MEASURES,
        fewest=FEWEST,
        odd_z=ODD,
        csv=csv_name,
        csv_address=quote(os.fsencode(csv_name)),
        contrast={name: deviation(curvatures[name], areas) for name in ("before", "after")},
        pictures=view.pictures(curvatures, PICTURES),
        scene=view.scene(scene),
    )


def deviation(values, areas):
    """The standard deviation of a map (W,) over the area; areas (W,) sum to 1."""
    return float(np.sqrt(areas @ (values - areas @ values) ** 2))


def address_of(page, out):
    """The address of a subject's own page as seen from the group's; "" if there is none."""
    if not page.is_file():
        return ""
    return quote(
        os.fsencode(Path(os.path.relpath(page.resolve(), out.resolve().parent)).as_posix())
    )


def short_names(folders):
    """The folders' own names, or their paths where two have the same."""
    names = [Path(folder).resolve().name for folder in folders]
    return names if len(set(names)) == len(names) else [str(folder) for folder in folders]


def figures_of(registration):
    """The figures of a `FinishedRegistration` that a group compares, dict."""
    r_before, r_after = registration.r()
    held_out_before, held_out_after = registration.held_out()
    return {
        "r_before": r_before,
        "r_after": r_after,
        "held_out_before_mm": held_out_before,
        "held_out_after_mm": held_out_after,
        "log2_area_95": registration.report["log2_area"][1],
        "mu_95": registration.high_mu(),
        "flipped": registration.report["flipped"],
    }


def scored(subjects):
    """The subjects with z-scores relative to the sound ones, or to all if few are sound.

    NaN where fewer than FEWEST have a figure, or all have the same.
    """
    sound = [subject for subject in subjects if not subject.broken]
    sound = sound if len(sound) >= FEWEST else subjects
    scores = [{} for _ in subjects]
    for key in MEASURES:
        values = np.array([subject.figures[key] for subject in sound], float)
        values = values[np.isfinite(values)]
        enough = len(values) >= FEWEST and np.ptp(values) > 0
        mean, spread = (values.mean(), values.std(ddof=1)) if enough else (np.nan, np.nan)
        for score, subject in zip(scores, subjects):
            score[key] = float((subject.figures[key] - mean) / spread)
    return [replace(subject, z=score) for subject, score in zip(subjects, scores)]


def csv_of(subjects):
    """The subjects' figures as csv, in their order."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    scores = [f"z_{key}" for key in MEASURES]
    writer.writerow(["subject", "folder", "state", *subjects[0].figures, *scores, "suspect"])
    for subject in subjects:
        numbers = [*subject.figures.values(), *subject.z.values()]
        cells = ["" if np.isnan(value) else f"{value:.6g}" for value in numbers]
        reasons = "; ".join(subject.suspect)
        writer.writerow([subject.name, subject.folder, subject.state, *cells, reasons])
    return file.getvalue()
