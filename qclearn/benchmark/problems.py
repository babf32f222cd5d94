"""The problems of the benchmark's sets by name, each with how its pair of surfaces is made."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

from data_synth.cohort import SEEDS

from ..io.conte69 import installed_folder
from . import cortex
from .measured import BenchmarkError
from .pairs import CONTROL, cohort_pair, displacement_pair, fsaverage_pair, mapped_subject
from .runs import SETS

DISTANCES, CURVE_COUNTS = (0.05, 0.1, 0.2, 0.3, 0.4), (4, 8)


@dataclass(frozen=True)
class Spec:
    """One problem: its set, its pair's name, and `make(*sides, *options)` -> `Pair`.

    sides: (function, arguments) of each part, such as a subject, that problems share: made once.
    """

    set: str
    pair: str
    make: Callable
    sides: tuple = ()
    options: tuple = ()

    @property
    def seeds(self):
        """Seeds of its synthetic subjects, list."""
        return [given[0] for function, *given in self.sides if function is mapped_subject]


def problems(subjects, sets):
    """The Specs of the sets, list; "folder:DIR" is the set of a folder's people. BenchmarkError, or
    ImportError where a set's files are missing."""
    folders = [name for name in sets if name.removeprefix("folder:") not in ("", name)]
    sets = [name for name in sets if name not in folders]
    unknown = sorted(set(sets) - set(SETS[:-1]))
    if unknown or not sets + folders:
        names = ", ".join(unknown) or "given"
        raise BenchmarkError(f"no set of problems {names}; there are {', '.join(SETS)}:DIR")
    if not isinstance(subjects, int) or not 1 <= subjects <= len(SEEDS):
        raise BenchmarkError(f"{subjects!r} subjects: the cohort has 1 to {len(SEEDS)}")
    if "conte69" in sets:
        installed_folder()
    people = [spec for name in folders for spec in people_problems(Path(name.partition(":")[2]))]
    return [spec for spec in every_problem(subjects) if spec.set in sets] + people


def people_problems(folder):
    """The Specs of a folder's people, each onto each other, with either half of their curves."""
    paths = sorted(folder.glob("*.npz"))
    if len(paths) < 2:
        raise BenchmarkError(
            f"{folder}: {len(paths)} files *.npz; give at least two open hemispheres of one side, "
            "with their curves (curve_NAME, as write_surface keeps them)"
        )
    for moving, control in permutations(paths, 2):
        sides = tuple((cortex.person, str(path.absolute())) for path in (moving, control))
        for part in cortex.HALVES:
            name = f"{moving.stem} to {control.stem}, {part}"
            yield Spec("folder", name, cortex.heldout_pair, sides, (part, False))


def every_problem(subjects):
    """Every Spec of all sets, in their order."""
    control = (mapped_subject, CONTROL)
    left = (cortex.fsaverage_side, "left")
    right = (cortex.fsaverage_side, "right")
    for seed in SEEDS[:subjects]:
        yield Spec("cohort", f"{seed} to {CONTROL}", cohort_pair, ((mapped_subject, seed), control))
    for curves in CURVE_COUNTS:
        for distance in DISTANCES:
            name = f"{distance:g}, {curves} curves"
            yield Spec("displacement", name, displacement_pair, (control,), (distance, curves, 0))
    yield Spec("fsaverage5", "right to left", fsaverage_pair)
    for sides in ((right, left), (left, right)):
        for part in cortex.HALVES:
            name = f"{sides[0][1]} to {sides[1][1]}, {part}"
            yield Spec("heldout", name, cortex.heldout_pair, sides, (part,))
    for name, side in (("fsaverage5", left), ("synthetic", control)):
        for amplitude in cortex.AMPLITUDES:
            yield Spec("warp", f"{name}, {amplitude:g} mm", cortex.warp_pair, (side,), (amplitude,))
    sides = ((cortex.conte69_sides,),)
    for part in cortex.PARTS:
        yield Spec("conte69", f"right to left, {part}", cortex.conte69_pair, sides, (part,))
