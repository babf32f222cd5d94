"""The page of a group: a line a subject, worst first, and the mean curvature before and after; a csv of the same."""

import csv
import io
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .finished import ReportError, read_finished
from .markup import asset, escape, flip, items, number, page, require_html, write_text
from .views import Look, Shown, both_sides, grey

# What is compared within a group: label, and which way is bad.
MEASURES = {
    "r_after": ("r(curvature)", -1),
    "held_out_after_mm": ("held out, mm", 1),
    "log2_area_95": ("95 % |log2 J|", 1),
    "mu_95": ("95 % |μ|", 1),
}
FEWEST = 3  # subjects of whom z-scores say something
ODD = 2.0  # z-score on the bad side from which a line is marked
MOST_PICTURES = 150  # more would make the page too heavy
RULE = (
    "First those that are suspect or have flipped triangles, then by the largest z-score on the bad side: lower "
    "r(curvature), larger held-out distances, |log2 J| and |μ|. z = (value − mean) / standard deviation over those "
    f"that are neither suspect nor flipped, over all where these are fewer than {FEWEST}. Red: suspect or flipped; "
    f"amber: a z-score of {ODD:g} or more on the bad side; green: neither."
)
SPREAD = Look("spread over the subjects, after", "viridis", 0, 1.5, "standard deviation, in SD")
PICTURES = {
    "before": "mean curvature of the subjects before registration",
    "after": "mean curvature of the subjects after registration",
    "control": "curvature of the control",
}


@dataclass(frozen=True)
class Line:
    """A subject of a group: its name, its folder, its figures (name -> number) and the reasons that make it suspect."""

    name: str
    folder: Path
    figures: dict
    suspect: list
    picture: str = ""
    z: dict | None = None

    @property
    def worst(self):
        """The largest z-score on the bad side; -inf without any."""
        return max(
            (sign * self.z[key] for key, (_, sign) in MEASURES.items() if self.z[key] == self.z[key]), default=-np.inf
        )

    @property
    def broken(self):
        """Whether it is suspect or has flipped triangles."""
        return bool(self.suspect or self.figures["flipped"])

    @property
    def state(self):
        return "bad" if self.broken else "odd" if self.worst >= ODD else "good"


def write_group(folders, out):
    """Write the page of the registrations in `folders`, all on one control, to `out`, and a csv of their figures beside
    it; ReportError where a folder is not whole, or has another control than the first."""
    out = require_html(out)
    twice = [folder for k, folder in enumerate(folders) if folder in folders[:k]]
    if twice:
        raise ReportError(f"{twice[0]}: given twice")
    lines, text = group_page(folders, out)
    write_text(out.with_suffix(".csv"), csv_of(lines))
    write_text(out, text)


def group_page(folders, out):
    """(lines worst first, page as text) of a group whose page will stand at `out`."""
    first, lines, means = read_finished(folders[0]), [], Means()
    shown = Shown(first.control.surface)
    names = short_names(folders)
    for folder, name in zip(folders, names):
        one = read_finished(folder)
        if one.control.surface.fingerprint != first.control.surface.fingerprint:
            raise ReportError(f"{folder}: its control is not that of {folders[0]}; give folders of one control")
        maps = one.maps()
        means.add(maps)
        small = len(folders) <= MOST_PICTURES
        picture = shown.picture(maps.after, grey("curvature"), width=200) if small else ""
        lines.append(Line(name, Path(folder), figures_of(one), one.report["suspect"], picture))
    lines = sorted(scored(lines), key=lambda line: (not line.broken, -line.worst))
    pictures = {name: both_sides(shown, means.curvatures[name], words) for name, words in PICTURES.items()}
    scene = [
        (grey(f"{'' if name == 'control' else 'mean '}curvature, {name}"), means.curvatures[name])
        for name in ("after", "before", "control")
    ]
    bad = [line for line in lines if line.broken]
    return lines, page(
        "group.html",
        f"{len(lines)} registrations",
        shown.scene([*scene, (SPREAD, means.spread)]),
        count=len(lines),
        control=escape(first.names()[1]),
        state="bad" if bad else "good",
        verdict=f"{len(bad)} of {len(lines)} suspect" if bad else "Nothing suspicious was found in any of them",
        words=summary(lines),
        rule=escape(RULE),
        lines=line_table(lines, out),
        csv=escape(out.with_suffix(".csv").name),
        blurred=number(means.contrast("before", first)),
        sharp=number(means.contrast("after", first)),
        views=flip("group", pictures),
        scene=asset("viewer.html"),
    )


class Means:
    """Sums of the subjects' maps on one control."""

    def __init__(self):
        self.count, self.sums, self.control = 0, 0.0, None

    def add(self, maps):
        self.count, self.control = self.count + 1, maps.control
        self.sums = self.sums + np.stack([maps.before, maps.after, maps.after**2])

    @property
    def curvatures(self):
        before, after, _ = self.sums / self.count
        return {"before": before, "after": after, "control": self.control}

    @property
    def spread(self):
        """The standard deviation over the subjects after registration, (W,)."""
        _, after, square = self.sums / self.count
        return np.sqrt(np.maximum(square - after**2, 0))

    def contrast(self, name, one):
        """The standard deviation of a mean map over the control's area."""
        areas, values = one.control.features.areas, self.curvatures[name]
        return float(np.sqrt(areas @ (values - areas @ values) ** 2))


def short_names(folders):
    """The folders' own names, or their paths where two have the same."""
    names = [Path(folder).resolve().name for folder in folders]
    return names if len(set(names)) == len(names) else [str(folder) for folder in folders]


def figures_of(one):
    """The figures of a `Finished` registration that a group compares, dict."""
    (r_before, r_after), (held_before, held_after) = one.r(), one.held_out()
    return {
        "r_before": r_before,
        "r_after": r_after,
        "held_out_before_mm": held_before,
        "held_out_after_mm": held_after,
        "log2_area_95": one.report["log2_area"][1],
        "mu_95": one.high_mu(),
        "flipped": one.report["flipped"],
    }


def scored(lines):
    """The lines with z-scores of their MEASURES by the sound ones, or all if there are few; NaN where too few have a
    figure, or all have the same."""
    sound = [line for line in lines if not line.broken]
    sound = sound if len(sound) >= FEWEST else lines
    for line in lines:
        z = {}
        for key in MEASURES:
            values = np.array([other.figures[key] for other in sound], float)
            values, own = values[np.isfinite(values)], line.figures[key]
            spread = values.std(ddof=1) if len(values) >= FEWEST else 0.0
            z[key] = float((own - values.mean()) / spread) if spread > 0 else np.nan
        yield Line(line.name, line.folder, line.figures, line.suspect, line.picture, z)


def summary(lines):
    """Who is to be looked at, in words."""
    bad = [
        f"{line.name}: {'; '.join(word_of(text) for text in line.suspect) or 'flipped triangles'}"
        for line in lines
        if line.state == "bad"
    ]
    odd = [line.name for line in lines if line.state == "odd"]
    words = f"Sound, but unlike the rest by a z-score of {ODD:g} or more: {', '.join(odd) or 'nobody'}."
    return (items(bad) if bad else "") + f"<p>{escape(words)}</p>"


def word_of(reason):
    """The fixed word that a reason begins with."""
    return reason.split(":")[0]


def line_table(lines, out):
    """The lines as a table that a telephone shows as cards."""
    head = ("subject", "curvature after", *(label for label, _ in MEASURES.values()), "flipped", "suspect")
    titles = "".join(f'<th scope="col">{escape(text)}</th>' for text in head)
    rows = "".join(row_of(line, head, out) for line in lines)
    frame = f"<caption>Worst first</caption><thead><tr>{titles}</tr></thead><tbody>{rows}</tbody>"
    return f'<table class="lines">{frame}</table>'


def row_of(line, head, out):
    figures, name = line.figures, escape(line.name)
    own = line.folder / "report.html"
    if own.is_file():
        name = f'<a href="{escape(Path(os.path.relpath(own.resolve(), out.resolve().parent)).as_posix())}">{name}</a>'
    picture = "–"
    if line.picture:
        words = f"Curvature of {escape(line.name)} carried to the control"
        picture = f'<img src="{line.picture}" alt="{words}" width="200" height="148">'
    cells = [picture, bar(figures["r_before"], figures["r_after"]) + z_of(line, "r_after")]
    cells += [number(figures[key]) + z_of(line, key) for key in list(MEASURES)[1:]]
    cells += [str(figures["flipped"]), escape("; ".join(map(word_of, line.suspect)) or "no")]
    body = "".join(f'<td data-label="{escape(label)}"><div>{cell}</div></td>' for label, cell in zip(head[1:], cells))
    return f'<tr class="{line.state}"><th scope="row">{name}</th>{body}</tr>'


def bar(before, after):
    """A correlation before and after as numbers and a bar."""
    low, high = (f"{100 * min(max(value, 0), 1):.0f}%" for value in (before, after))
    track = f'<span class="bar" aria-hidden="true" style="--before:{low};--after:{high}"></span>'
    return f"{number(before)} → <b>{number(after)}</b>{track}"


def z_of(line, key):
    z, sign = line.z[key], MEASURES[key][1]
    mark = " marked" * (sign * z >= ODD)
    return f' <span class="z{mark}">z {number(z, 1)}</span>' if z == z else ""


def csv_of(lines):
    """The lines as csv, worst first."""
    file = io.StringIO()
    names = list(lines[0].figures)
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["subject", "folder", "state", *names, *(f"z_{key}" for key in MEASURES), "suspect"])
    for line in lines:
        numbers = [*line.figures.values(), *line.z.values()]
        written = ["" if value != value else f"{value:.6g}" for value in numbers]
        writer.writerow([line.name, line.folder, line.state, *written, "; ".join(line.suspect)])
    return file.getvalue()
