"""The rounds of a template: tasks for each subject, their results kept, and the mean of all in
between."""

from operator import attrgetter

import numpy as np

from ..registration.features import HEMISPHERE, mirrored_gain
from . import subject as of
from .kept import TemplateError
from .subject import Fitted, alone, mean_of
from .workers import result_of

PASSES = 3  # in which the subjects are laid upon their mean by Möbius maps, before the first round
# Mm, on a surface of the area of a HEMISPHERE: a template that moves less on average stands still.
SETTLED = 0.1
OTHER_SIDE = 0.1  # gain in correlation at which a subject is taken for one of the other side


class Group:
    """The subjects of a template on a client, in the order of their keys, and the tasks of its
    rounds."""

    def __init__(self, client, members, names, kept, bar):
        self.client = client
        self.members = members
        self.names = names
        self.kept = kept
        self.bar = bar
        surfaces = [client.scatter(member.surface, hash=False) for member in members]
        self.subjects = [
            self.submit(of.prepared, surface, names, member.given)
            for surface, member in zip(surfaces, members)
        ]

    def run(self, rounds, weights):
        """The last `Mean`, the average c of its maps' inverses, the subjects' `Fitted`, and a `row`
        for each round."""
        mean, fits = self.lay_upon_mean()
        centre, rows = mean.disk.z, [self.row(mean, mean, fits)]
        for number in range(1, rounds + 1):
            fits = self.register_all(mean, number, weights)
            before, (mean, centre) = mean, self.mean(mean, self.used(fits))
            rows.append(self.row(before, mean, fits))
            if rows[-1]["settled"]:
                break
        return mean, centre, fits, rows

    def submit(self, function, *arguments):
        return self.client.submit(function, *arguments, pure=False)

    def result(self, future, member):
        return result_of(future, member.name)

    def disks(self):
        """Tasks: the disk maps (V,) of the subjects as laid."""
        return [self.submit(attrgetter("disk.z"), subject) for subject in self.subjects]

    def median(self):
        """The subject of median area, on whose mesh the others are averaged: its number."""
        return int(
            np.argsort([member.surface.area for member in self.members], kind="stable")[
                len(self.members) // 2
            ]
        )

    def lay_upon_mean(self):
        """Lay the subjects upon their mean by Möbius maps: that `Mean`, and their disk maps as
        `Fitted`."""
        median = self.median()
        first = alone(self.result(self.subjects[median], self.members[median]))
        fits = [self.kept.read(0, member.key) for member in self.members]
        if all(fits):
            self.subjects = [
                self.submit(of.at_disk, subject, fit.f) for subject, fit in zip(self.subjects, fits)
            ]
        else:
            self.align(first)
            fits = [
                Fitted(self.result(disk, member))
                for disk, member in zip(self.disks(), self.members)
            ]
        for member, fit in zip(self.members, fits):
            self.kept.keep(0, member.key, fit)
            self.bar.update()
        return self.average(first, self.used(fits), first.disk.z), fits

    def align(self, mean):
        """Lay the subjects by Möbius maps upon one of them, then twice upon their mean."""
        for number in range(PASSES):
            there, near = self.client.scatter(mean), number == PASSES - 1
            self.subjects = [
                self.submit(of.laid, subject, there, near) for subject in self.subjects
            ]
            if number == 0:
                self.check_sides(there)
            mean = self.average(mean, dict(enumerate(self.disks())), mean.disk.z)

    def check_sides(self, mean):
        """TemplateError where subjects fit the mean much better if they are mirrored."""
        tasks = [self.submit(mirrored_gain, subject, mean) for subject in self.subjects]
        other = [
            self.result(task, member) > OTHER_SIDE for task, member in zip(tasks, self.members)
        ]
        # True: the subject that the others were laid upon is the odd one.
        most = 2 * sum(other) > len(other)
        names = ", ".join(
            sorted(member.name for member, odd in zip(self.members, other) if odd != most)
        )
        if names:
            raise TemplateError(
                f"{names}: of the other side than most; mirror them first (library: qc.mirror)"
            )

    def register_all(self, mean, number, weights):
        """The `Fitted` of all subjects to the mean."""
        there = self.client.scatter(mean)
        fits = [self.kept.read(number, member.key) for member in self.members]
        tasks = [
            fit or self.submit(of.fitted, subject, there, weights)
            for fit, subject in zip(fits, self.subjects)
        ]
        for k, (fit, task, member) in enumerate(zip(fits, tasks, self.members)):
            if fit is None:
                fits[k] = self.result(task, member)
                self.kept.keep(number, member.key, fits[k])
            self.bar.update()
        return fits

    def used(self, fits):
        """Disk maps that take part in the mean: number of the subject -> f; TemplateError for fewer
        than two."""
        maps = {k: fit.f for k, fit in enumerate(fits) if not fit.reasons}
        if len(maps) < 2:
            told = [
                f"{member.name}: {fit.reasons[0]}"
                for member, fit in zip(self.members, fits)
                if fit.reasons
            ]
            raise TemplateError(
                f"fewer than two subjects can be registered ({'; '.join(sorted(told))})"
            )
        return maps

    def mean(self, before, maps):
        """The next `Mean`, of the maps (subject's number -> f) followed by their inverses' average
        c; and c (N,)."""
        inverses = self.each(of.inverse, maps, before.disk.z)
        centre, loop = sum(inverses) / len(maps), before.disk.loop
        centre[loop] /= abs(centre[loop])
        image = before.disk.at(centre)
        if not image.certificate.bijective:
            raise TemplateError(
                "the mean of the subjects' maps folds: they have too little in common; lower delta"
            )
        back = image.interpolate(before.disk.z, image.locate(before.disk.z))
        return self.average(before, maps, back), centre

    def average(self, before, maps, points):
        """The `Mean` of what the subjects have where their maps reach points (N,), at the vertices
        before."""
        return mean_of(self.each(of.carried, maps, points, before), len(maps), before)

    def each(self, function, maps, *arguments):
        """The results of a function of a subject, its map and arguments shared by all, one by one."""
        there = [self.client.scatter(argument) for argument in arguments]
        tasks = {k: self.submit(function, self.subjects[k], f, *there) for k, f in maps.items()}
        return (self.result(task, self.members[k]) for k, task in tasks.items())

    def row(self, before, after, fits):
        """What a round has changed, dict for JSON."""
        moved = np.linalg.norm(after.points - before.points, axis=1)
        r = {
            name: [fit.r[name] for fit in fits if name in fit.r and not fit.reasons]
            for name in self.names
        }
        moved_mm, unit = float(after.shares @ moved), np.sqrt(after.areas.sum() / HEMISPHERE)
        return {
            "moved_mm": moved_mm,
            "most_moved_mm": float(moved.max()),
            "settled": before is not after and bool(moved_mm < SETTLED * unit),
            "r": {name: float(np.mean(values)) for name, values in r.items() if values},
            "variance": dict(zip(self.names, after.variance.tolist())),
        }

    def finish(self, mean, centre, fits):
        """Number of the subject -> `composed`, and how many mm the inverses' average is from the
        identity."""
        used = self.used(fits)
        ends = dict(zip(used, self.each(of.composed, used, mean, centre)))
        inverses = [back for _, bijective, back in ends.values() if bijective]
        off = mean.unit * abs(sum(inverses) / max(len(inverses), 1) - mean.disk.z)
        return ends, {"mean": float(mean.shares @ off), "most": float(off.max())}
