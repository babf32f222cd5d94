"""The problems of the benchmark's sets by name, and how dask makes the pair of surfaces of each."""

from dataclasses import dataclass

from data_synth.cohort import SEEDS

from ..files.conte69 import installed_folder
from .cortex import AMPLITUDES, HALVES, PARTS, conte69_pair, conte69_sides, fsaverage_side, heldout_pair, warp_pair
from .measured import BenchmarkError
from .pairs import CONTROL, cohort_pair, displacement_pair, fsaverage_pair, mapped_subject
from .runs import SETS

DISTANCES, CURVE_COUNTS = (0.05, 0.1, 0.2, 0.3, 0.4), (4, 8)


@dataclass(frozen=True)
class Spec:
    """One problem by name: the set, the pair's name and what it is made from.

    distance: of the landmarks in the disk, or of a warp in mm; part: which curves are fitted, the others held out;
    hemisphere: the moving one.
    """

    set: str
    pair: str
    moving: int | None = None
    control: int | None = None
    distance: float = 0.0
    curves: int = 0
    part: str = "all"
    hemisphere: str = "right"


def problems(subjects, sets):
    """The problems of the sets, list of Spec; BenchmarkError for an unknown set or a bad count of subjects."""
    unknown = sorted(set(sets) - set(SETS))
    if unknown or not sets:
        raise BenchmarkError(f"no set of problems {', '.join(unknown) or 'given'}; there are {', '.join(SETS)}")
    if not isinstance(subjects, int) or not 1 <= subjects <= len(SEEDS):
        raise BenchmarkError(f"{subjects!r} subjects: the cohort has 1 to {len(SEEDS)}")
    specs = []
    if "cohort" in sets:
        specs += [Spec("cohort", f"{seed} to {CONTROL}", seed, CONTROL) for seed in SEEDS[:subjects]]
    if "displacement" in sets:
        specs += [
            Spec("displacement", f"{distance:g}, {curves} curves", None, CONTROL, distance, curves)
            for curves in CURVE_COUNTS
            for distance in DISTANCES
        ]
    if "fsaverage5" in sets:
        specs.append(Spec("fsaverage5", "right to left"))
    return specs + cortex_problems(sets)


def cortex_problems(sets):
    """The problems of the sets on real cortex; ImportError where the files of one are not installed."""
    specs = []
    if "heldout" in sets:
        specs += [
            Spec("heldout", f"{side} to {other}, {part}", part=part, hemisphere=side)
            for side, other in (("right", "left"), ("left", "right"))
            for part in HALVES
        ]
    if "warp" in sets:
        specs += [
            Spec("warp", f"{name}, {amplitude:g} mm", control=control, distance=amplitude)
            for name, control in (("fsaverage5", None), ("synthetic", CONTROL))
            for amplitude in AMPLITUDES
        ]
    if "conte69" in sets:
        installed_folder()
        specs += [Spec("conte69", f"right to left, {part}", part=part) for part in PARTS]
    return specs


def submit_pair(client, spec, grown):
    """The future of a problem's Pair. Subjects, `grown` with (vertices, folder, generation), have keys of their own, so
    that pairs share them.
    """
    if spec.set in MAKERS and spec.control is None:
        return MAKERS[spec.set](client, spec)
    # The generation goes along: the workers' own default may be another.
    control = client.submit(mapped_subject, spec.control, *grown)
    if spec.set == "displacement":
        return client.submit(displacement_pair, control, spec.distance, spec.curves, 0)
    if spec.set == "warp":
        return client.submit(warp_pair, control, spec.distance)
    moving = client.submit(mapped_subject, spec.moving, *grown)
    return client.submit(cohort_pair, moving, control)


def submit_heldout(client, spec):
    other = "left" if spec.hemisphere == "right" else "right"
    sides = (client.submit(fsaverage_side, side) for side in (spec.hemisphere, other))
    return client.submit(heldout_pair, *sides, spec.part)


MAKERS = {  # set -> who submits a problem that needs no synthetic subject
    "fsaverage5": lambda client, spec: client.submit(fsaverage_pair),
    "heldout": submit_heldout,
    "warp": lambda client, spec: client.submit(warp_pair, client.submit(fsaverage_side, "left"), spec.distance),
    "conte69": lambda client, spec: client.submit(conte69_pair, client.submit(conte69_sides), spec.part),
}
