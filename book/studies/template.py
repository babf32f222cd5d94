"""Measure the template of the synthetic cohort beside Möbius maps alone and registration to one
control.

    python -m book.studies.template

What is averaged: the maps of all subjects after each way. What is compared with the truth: where
the same way takes each subject's vertices and named sulci, which take no part, on the control's
surface; through the template by its own map to the template and back by the control's. The page
'From pairs to a group' reads the file. CPU seconds are those of this process and of its workers,
once they have ended.
"""

import json
import resource
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from tqdm import tqdm

import qclearn as qc
from data_synth.cohort import cohort
from data_synth.correspondence import correspondence
from data_synth.generations import GENERATION
from qclearn.benchmark.measured import RESULTS, write_measured
from qclearn.benchmark.measures import correspondence_measures, near_curves
from qclearn.group.members import members_of
from qclearn.group.rounds import Folder, Group
from qclearn.group.subject import alone
from qclearn.group.workers import client_of
from qclearn.io.provenance import provenance
from qclearn.plane.disk import Disk
from qclearn.registration.curves import curve_distance, curves_in_space
from qclearn.registration.features import FOLDS
from qclearn.registration.problem import DELTA_BY_DISKS, Weights
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.curvature import curvature_image

ROUNDS, WORKERS = 6, 2
NEAR = 10.0  # mm along the surface: what counts as near a sulcus
PIXELS, GREYS = 96, 100  # of the pictures, and steps from 0 to their largest value


def main():
    with tempfile.TemporaryDirectory() as folder:
        write_measured("template", RESULTS / "template.json", measure(Path(folder)))


def measure(folder):
    """The figures of the file, dict; folder: of the template's own files."""
    subjects = {str(cortex.seed): cortex for cortex in cohort()}
    seconds = {}
    with clock(seconds, "template"):
        made = qc.template(subjects, rounds=ROUNDS, folder=folder, workers=WORKERS, progress=True)
    start = qc.template(subjects, rounds=0, folder=folder, workers=1)
    with clock(seconds, "one control"):
        control, single, fits = one_control(subjects, folder)
    ways = {
        "Möbius maps": (made.disks, made.disks[control]),
        "one control": (fits, single.disk.z),
        "template": (made.disk_maps, made.disk_maps[control]),
    }
    return {
        "subjects": len(subjects),
        "generation": GENERATION,
        "vertices": len(subjects[control].surface.vertices),
        "control": control,
        "report": made.report,
        "variance": {
            "Möbius maps": made.report["rounds"][0]["variance"],
            "one control": dict(zip(FOLDS, single.variance.tolist())),
            "template": made.report["rounds"][-1]["variance"],
        },
        "truth": {way: against_truth(subjects, control, *maps) for way, maps in ways.items()},
        "pictures": pictures(subjects[control].surface, start, single, made),
        "seconds": seconds,
        "workers": WORKERS,
        "provenance": provenance(),
    }


@contextmanager
def clock(seconds, name):
    """Keep the seconds that pass: on the clock, and of processors."""
    start = time.perf_counter(), processor_seconds()
    yield
    seconds[name] = {"wall": round(time.perf_counter() - start[0], 1), "cpu": round(processor_seconds() - start[1], 1)}


def processor_seconds():
    used = [resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def one_control(subjects, folder):
    """The subject of median area, whose mesh the template has; the `Mean` of all that are
    registered to it as to a template that stays as it is, and their disk maps, name -> (V,)."""
    members, features = members_of(subjects, FOLDS)
    aligned = Folder(folder, json.loads((folder / "settings.json").read_text(encoding="utf-8")))
    with client_of(None, WORKERS) as client:
        group = Group(client, members, features, aligned, tqdm(disable=True))
        group.align_to_mean()
        group.folder, control = Folder(None, {}), group.median()
        first = alone(group.subjects[control].result())
        used = group.used(group.register_all(first, 1, Weights(delta=DELTA_BY_DISKS)))
        mean = group.average(first, used, first.disk.z)
    return members[control].name, mean, {members[k].name: f for k, f in used.items()}


def against_truth(subjects, control, maps, back):
    """Means over the subjects of how far their vertices end from their true partners on the
    control, in mm, and their sulci from the control's. maps: name -> disk map; back: that of the
    control itself."""
    there, rows = subjects[control], []
    side = ParameterizedSurface(there.surface, Disk(back, there.surface.faces))
    wanted = curves_in_space(side, [back[path] for path in there.curves.values()])
    for name, f in maps.items():
        if name == control:
            continue
        one = subjects[name]
        near = near_curves(one.surface, list(one.curves.values()), NEAR)
        row = correspondence_measures(side.lift(f), correspondence(one, there), near)
        ends = curves_in_space(side, [f[one.curves[curve]] for curve in there.curves])
        rows.append(row | {"sulci_mm": float(np.mean([curve_distance(*pair) for pair in zip(ends, wanted)]))})
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def pictures(control, start, single, made):
    """Mean curvature on the disk, whose radius follows the area, in whole steps of the largest
    value shown; null outside. All ways in one scale."""
    kinds = {
        "one subject": (control, single.disk.z, qc.mean_curvature(control)),
        "Möbius maps": (start.surface, start.disk, start.maps["curvature"]),
        "one control": (control, single.disk.z, single.values[:, FOLDS.index("curvature")]),
        "template": (made.surface, made.disk, made.maps["curvature"]),
    }
    largest = float(np.quantile(abs(kinds["template"][2]), 0.98))
    shown = {}
    for name, (surface, disk, values) in kinds.items():
        image, _ = curvature_image(surface, disk, PIXELS, values)
        steps = np.round(GREYS * np.clip(image / largest, -1, 1))
        shown[name] = [[None if np.isnan(step) else int(step) for step in row] for row in steps]
    return {"largest": largest, "steps": GREYS, "images": shown}


if __name__ == "__main__":
    main()
