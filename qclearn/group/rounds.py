"""The rounds of a template: tasks for each subject, stored results, and the mean in between."""

import json
from dataclasses import asdict
from operator import attrgetter

import numpy as np

from ..io.checkpoint import Checkpoint
from ..io.safe import npz_arrays, npz_bytes
from ..registration.features import HEMISPHERE
from . import subject as of
from .members import TemplateError
from .subject import Fitted, alone, mean_of
from .workers import result_of

PASSES = 3  # of aligning the subjects with their mean by Möbius maps, before the first round
# Mm, on a surface of the area of a HEMISPHERE: the template has converged if it moves less.
SETTLED = 0.1
OTHER_SIDE = 0.1  # gain in correlation from which a subject is taken for one of the other side


class Folder:
    """The registrations of finished rounds in a folder, a file for each round and subject's key."""

    def __init__(self, path, settings):
        self.checkpoint = None if path is None else Checkpoint(path, settings, TemplateError)

    def read(self, number, key):
        """The `Fitted` of a subject in a round; None where its file is missing or damaged."""
        try:
            data = self.checkpoint and self.checkpoint.read(file_name(number, key))
            arrays = npz_arrays(data, lambda name: True)
            f = arrays["f"] if arrays["f"].size else None
            return Fitted(f, **json.loads(str(arrays["messages"])))
        except Exception:
            return None

    def write(self, number, key, fit):
        """Store a `Fitted`, whole or not at all."""
        messages = asdict(fit)
        f = messages.pop("f")
        f = np.zeros(0, complex) if f is None else f
        data = npz_bytes({"f": f, "messages": np.array(json.dumps(messages))})
        if self.checkpoint:
            self.checkpoint.write(file_name(number, key), data)


def file_name(number, key):
    return f"round-{number}-{key}.npz"


class Group:
    """The subjects of a template on a client, in the order of their keys, and their tasks."""

    def __init__(self, client, members, names, folder, bar):
        self.client = client
        self.members = members
        self.names = names
        self.folder = folder
        self.bar = bar
        surfaces = [self.sent(member.surface) for member in members]
        self.subjects = [
            self.submit(of.prepared, surface, names, member.given)
            for surface, member in zip(surfaces, members)
        ]

    def run(self, rounds, weights):
        """(the last `Mean`, the inverses' average c, the subjects' `Fitted`, a row per round)."""
        mean, fits = self.align_to_mean()
        centre = mean.disk.z
        rows = [self.row(mean, mean, fits)]
        for number in range(1, rounds + 1):
            before = mean
            fits = self.register_all(before, number, weights)
            mean, centre = self.mean(before, self.used(fits))
            rows.append(self.row(before, mean, fits))
            if rows[-1]["settled"]:
                break
        return mean, centre, fits, rows

    def sent(self, value):
        """A value at the workers, under a name of its own: with dask's names by content, a value
        that is sent again while its first copy is given up can be lost."""
        return self.client.scatter(value, hash=False)

    def submit(self, function, *arguments):
        return self.client.submit(function, *arguments, pure=False)

    def results(self, tasks):
        """The results of one task per subject, list."""
        return [result_of(task, member.name) for task, member in zip(tasks, self.members)]

    def disks(self):
        """The aligned disk maps (V,) of all subjects, list."""
        return self.results([self.submit(attrgetter("disk.z"), each) for each in self.subjects])

    def median(self):
        """The number of the subject of median area, on whose mesh the others are averaged."""
        areas = [member.surface.area for member in self.members]
        return int(np.argsort(areas, kind="stable")[len(areas) // 2])

    def align_to_mean(self):
        """Align the subjects with their mean by Möbius maps: that `Mean`, and their `Fitted`."""
        median = self.median()
        first = alone(result_of(self.subjects[median], self.members[median].name))
        fits = [self.folder.read(0, member.key) for member in self.members]
        if all(fits):
            pairs = zip(self.subjects, fits)
            self.subjects = [self.submit(of.at_disk, subject, fit.f) for subject, fit in pairs]
        else:
            self.align(first)
            fits = [Fitted(z) for z in self.disks()]
        for member, fit in zip(self.members, fits):
            self.folder.write(0, member.key, fit)
            self.bar.update()
        return self.average(first, self.used(fits), first.disk.z), fits

    def align(self, mean):
        """Align the subjects by Möbius maps with one of them, then twice with their mean."""
        for number in range(PASSES):
            there = self.sent(mean)
            near = number == PASSES - 1
            self.subjects = [self.submit(of.aligned, each, there, near) for each in self.subjects]
            if number == 0:
                self.check_sides(there)
            mean = self.average(mean, dict(enumerate(self.disks())), mean.disk.z)

    def check_sides(self, mean):
        """TemplateError where subjects fit the mean much better if they are mirrored."""
        gains = self.results([self.submit(of.mirrored_gain, each, mean) for each in self.subjects])
        other = [gain > OTHER_SIDE for gain in gains]
        # True: the subject that the others are aligned with is the odd one.
        most = 2 * sum(other) > len(other)
        odd = [member.name for member, is_other in zip(self.members, other) if is_other != most]
        if odd:
            advice = "mirror them first (library: qc.mirror)"
            raise TemplateError(f"{', '.join(sorted(odd))}: of the other side than most; {advice}")

    def register_all(self, mean, number, weights):
        """The `Fitted` of all subjects to the mean."""
        there = self.sent(mean)
        fits = [self.folder.read(number, member.key) for member in self.members]
        tasks = [
            fit or self.submit(of.fitted, subject, there, weights)
            for fit, subject in zip(fits, self.subjects)
        ]
        for k, (task, member) in enumerate(zip(tasks, self.members)):
            if fits[k] is None:
                fits[k] = result_of(task, member.name)
                self.folder.write(number, member.key, fits[k])
            self.bar.update()
        return fits

    def used(self, fits):
        """The disk maps that are averaged, dict subject's number -> f; TemplateError below two."""
        maps = {k: fit.f for k, fit in enumerate(fits) if not fit.reasons}
        if len(maps) < 2:
            pairs = zip(self.members, fits)
            reasons = [f"{one.name}: {fit.reasons[0]}" for one, fit in pairs if fit.reasons]
            message = "fewer than two subjects can be registered"
            raise TemplateError(f"{message} ({'; '.join(sorted(reasons))})")
        return maps

    def mean(self, before, maps):
        """The next `Mean`, and the average c (N,) of the inverses of the maps.

        maps: subject's number -> f. The next mean averages the subjects under c o f.
        """
        inverses = self.each(of.inverse, maps, before.disk.z)
        centre = sum(inverses) / len(maps)
        loop = before.disk.loop
        centre[loop] /= abs(centre[loop])
        image = before.disk.at(centre)
        if not image.certificate.bijective:
            raise TemplateError(
                "the mean of the subjects' maps folds: they have too little in common; lower delta"
            )
        back = image.interpolate(before.disk.z, image.locate(before.disk.z))
        return self.average(before, maps, back), centre

    def average(self, before, maps, points):
        """The `Mean` of the subjects where their maps reach points (N,), on the mesh of `before`."""
        return mean_of(self.each(of.carried, maps, points, before), len(maps), before)

    def each(self, function, maps, *arguments):
        """The results of function(subject, its map, *arguments), one by one."""
        there = [self.sent(argument) for argument in arguments]
        tasks = {k: self.submit(function, self.subjects[k], f, *there) for k, f in maps.items()}
        return (result_of(task, self.members[k].name) for k, task in tasks.items())

    def row(self, before, after, fits):
        """What a round has changed, dict for JSON."""
        distances = np.linalg.norm(after.points - before.points, axis=1)
        moved_mm = float(after.vertex_shares @ distances)
        unit = np.sqrt(after.areas.sum() / HEMISPHERE)
        used = [fit for fit in fits if not fit.reasons]
        r = {name: [fit.r[name] for fit in used if name in fit.r] for name in self.names}
        return {
            "moved_mm": moved_mm,
            "most_moved_mm": float(distances.max()),
            "settled": before is not after and bool(moved_mm < SETTLED * unit),
            "r": {name: float(np.mean(values)) for name, values in r.items() if values},
            "variance": dict(zip(self.names, after.variance.tolist())),
        }

    def finish(self, mean, centre, fits):
        """(subject's number -> `composed`, mm between the inverses' average and the identity)."""
        used = self.used(fits)
        ends = dict(zip(used, self.each(of.composed, used, mean, centre)))
        inverses = [back for _, bijective, back in ends.values() if bijective]
        off = mean.unit * abs(sum(inverses) / max(len(inverses), 1) - mean.disk.z)
        return ends, {"mean": float(mean.vertex_shares @ off), "most": float(off.max())}
