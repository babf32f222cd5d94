"""An unbiased template: what subjects have in common, after all are registered to it, round after round.

A round registers each subject to the mean by features, f_k from its disk to the mean's, and takes each map on by the
average of the inverses, `c = mean f_k^-1`: that of the maps `c o f_k` is the identity, and nobody's shape is preferred
(Guimond, Meunier and Thirion 2000; Joshi and others 2004). What the subjects have at the same vertex of the mean is
averaged: features, positions, areas. That is the next mean.
"""

from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from jaxtyping import Complex, Float
from numpy import ndarray
from tqdm import tqdm

from ..files.provenance import commit
from ..registration.features import FOLDS
from ..registration.problem import DELTA, Weights
from ..registration.register import check_delta
from ..surfaces.surface import Surface
from .kept import Folder, TemplateError
from .members import members_of
from .rounds import Group
from .workers import client_of

CHANGED = "folds: its map, once the average of all is taken off"


@dataclass(frozen=True)
class Template:
    """Result of `template`.

    surface: the mean shape; disk: its disk map; maps: feature -> mean over the subjects at its vertices, in their
    units; disks: name -> a subject's disk map, laid upon the others by a Möbius map; disk_maps: name -> its certified
    registration, where its vertices lie in the template's disk; left_out: name -> why a subject takes no part;
    report: dict for JSON.
    """

    surface: Surface
    disk: Complex[ndarray, " N"]
    maps: dict[str, Float[ndarray, " N"]]
    disks: dict[str, Complex[ndarray, " _"]]
    disk_maps: dict[str, Complex[ndarray, " _"]]
    left_out: dict[str, list[str]]
    report: dict


def template(
    subjects: list | tuple | dict,
    features: list | tuple = FOLDS,
    rounds: int = 4,
    delta: float = DELTA,
    folder: str | Path | None = None,
    scheduler: str | None = None,
    workers: int = 2,
    progress: bool = False,
) -> Template:
    """The mean of surfaces that are registered to it by features: a Template, which is unbiased and certified.

    subjects: at least two outward disks of one side, a list or name -> surface (what `data_synth.make_cortex` returns
    will do). features: "depth" and "curvature" are computed; (name, [one array (V,) a subject]) are the user's own;
    landmarks take no part. rounds: at most so many; they end once the template moves less than SETTLED on average, and
    `report["settled"]` says whether it does; 0: the mean after Möbius maps alone. delta: the features' weight, as in
    `register`. The result does not depend on the subjects' order. A subject whose registration folds or is suspect
    takes no part in the mean and is named in `left_out`.
    folder: where each registration is kept once it is found; called again, a run that was stopped goes on. scheduler:
    address of a dask scheduler, None for `workers` processes of this machine (1: this process itself).
    Errors: TemplateError, SurfaceError, FeatureError, WorkersError; ImportError where several workers are asked for
    and dask is not installed.
    """
    members, names = members_of(subjects, features)
    weights = Weights(delta=check_delta(delta, features))
    if not isinstance(rounds, int) or rounds < 0 or not isinstance(workers, int) or workers < 1:
        raise TemplateError(f"{rounds!r} rounds, {workers!r} workers: give 0 rounds or more, and at least one worker")
    settings = {"subjects": [member.key for member in members], "features": names, "delta": delta}
    kept = Folder(folder, settings | {"version": version("qclearn"), "commit": commit()})
    with (
        tqdm(total=len(members) * (rounds + 1), desc="template", disable=not progress) as bar,
        client_of(scheduler, workers) as client,
    ):
        group = Group(client, members, names, kept, bar)
        mean, centre, fits, rows = group.run(rounds, weights)
        ends, off = group.finish(mean, centre, fits)
        disks = [group.result(disk, member) for disk, member in zip(group.disks(), members)]
    maps = {members[k].name: f for k, (f, bijective, _) in ends.items() if bijective}
    left_out = {member.name: fit.reasons or [CHANGED] for member, fit in zip(members, fits) if member.name not in maps}
    report = {
        "subjects": sorted(member.name for member in members),
        "features": names,
        "delta": delta,
        "rounds": rows,
        "settled": rows[-1]["settled"],
        "centre_mm": off,
        "r": {member.name: fit.r for member, fit in zip(members, fits)},
        "words": {member.name: fit.words for member, fit in zip(members, fits) if fit.words},
        "left_out": left_out,
        "version": version("qclearn"),
    }
    surface, means = Surface(mean.points, mean.disk.faces), dict(zip(names, mean.values.T))
    laid = {member.name: disk for member, disk in zip(members, disks)}
    return Template(surface, mean.disk.z, means, laid, maps, left_out, report)
