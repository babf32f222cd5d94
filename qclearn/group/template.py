"""An unbiased template: subjects are registered to their mean, round after round.

A round registers each subject to the mean by features, f_k from its disk to the mean's. With the
inverses' average, `c = mean f_k^-1`, the inverses of the maps `c o f_k` have the identity as
average, and no subject's shape is preferred (Guimond, Meunier and Thirion 2000; Joshi and others 2004).
The next mean averages features, positions, areas there.
"""

from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from jaxtyping import Complex, Float
from numpy import ndarray
from tqdm import tqdm

from ..io.provenance import commit
from ..registration.features import FOLDS
from ..registration.problem import DELTA_BY_DISKS, Weights
from ..surfaces.surface import Surface
from .members import TemplateError, members_of
from .rounds import Folder, Group
from .workers import client_of

CHANGED = "folds: its map, once the average of all is taken off"


@dataclass(frozen=True)
class Template:
    """Result of `template`.

    surface: the mean shape; disk: its disk map; maps: feature -> the subjects' mean at its
    vertices, in their units; disks: name -> a subject's disk map, aligned with the others by a
    Möbius map; disk_maps: name -> its vertices' places in the template's disk, certified; left_out:
    name -> why a subject is left out; report: dict for JSON.
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
    delta: float = DELTA_BY_DISKS,
    folder: str | Path | None = None,
    scheduler: str | None = None,
    workers: int = 2,
    progress: bool = False,
) -> Template:
    """Register surfaces to their mean by features, without landmarks: a Template, unbiased and
    certified.

    subjects: at least two outward disks of one side, a list or name -> surface (or
    `data_synth.make_cortex`'s result); their order changes nothing. features: "depth", "curvature",
    or the user's own (name, [one array (V,) a subject]). rounds: at most so many, until the
    template moves less than SETTLED on average (`report["settled"]`); 0: the mean after Möbius maps
    alone. delta: the features' weight, as in `register`. folder: stores each registration, so that
    a stopped run goes on. scheduler: address of a dask scheduler, None for `workers` processes of
    this machine (1: this process itself). A subject whose registration folds or is suspect is left
    out of the mean: see `left_out`. Errors: TemplateError, SurfaceError, FeatureError,
    WorkersError; ImportError for several workers without dask.
    """
    members, names = members_of(subjects, features)
    weights = Weights(delta=DELTA_BY_DISKS if delta is None else delta)
    if not isinstance(rounds, int) or rounds < 0 or not isinstance(workers, int) or workers < 1:
        raise TemplateError(
            f"{rounds!r} rounds, {workers!r} workers: give 0 rounds or more, and at least one "
            "worker"
        )
    settings = {"subjects": [member.key for member in members], "features": names, "delta": delta}
    settings |= {"version": version("qclearn"), "commit": commit()}
    rounds_folder = Folder(folder, settings)
    total = len(members) * (rounds + 1)
    with (
        tqdm(total=total, desc="template", disable=not progress) as bar,
        client_of(scheduler, workers) as client,
    ):
        group = Group(client, members, names, rounds_folder, bar)
        mean, centre, fits, rows = group.run(rounds, weights)
        ends, off = group.finish(mean, centre, fits)
        disks = {member.name: z for member, z in zip(members, group.disks())}
    maps = {members[k].name: f for k, (f, bijective, _) in ends.items() if bijective}
    fit_of = {member.name: fit for member, fit in zip(members, fits)}
    left_out = {n: fit.reasons or [CHANGED] for n, fit in fit_of.items() if n not in maps}
    report = {
        "subjects": sorted(fit_of),
        "features": names,
        "delta": delta,
        "rounds": rows,
        "settled": rows[-1]["settled"],
        "centre_mm": off,
        "r": {name: fit.r for name, fit in fit_of.items()},
        "words": {name: fit.messages for name, fit in fit_of.items() if fit.messages},
        "left_out": left_out,
        "version": version("qclearn"),
    }
    surface = Surface(mean.points, mean.disk.faces)
    means = dict(zip(names, mean.values.T))
    return Template(surface, mean.disk.z, means, disks, maps, left_out, report)
