"""A cohort of synthetic hemispheres, made once and stored in the user's cache folder."""

import os
import tempfile
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from platformdirs import user_cache_path
from tqdm import tqdm

from qclearn.io.checkpoint import require_home

from .cortex import CortexError, make_cortex, require_generation
from .generations import GENERATION
from .subjects import load_cortex, save_cortex

SEEDS = tuple(range(1001, 1025))


class CohortWarning(UserWarning):
    """A damaged file of the cohort was made again."""


def cohort(
    count=24, n_vertices=10_000, folder=None, progress=True, workers=2, generation=GENERATION
):
    """The first `count` (1 to 24) left hemispheres of the fixed seeds, a list of Cortex.

    CortexError for a bad count or generation, or an unwritable folder.
    """
    if not isinstance(count, int) or not 1 <= count <= len(SEEDS):
        raise CortexError(f"the cohort has 1 to {len(SEEDS)} subjects, not {count!r}.")
    return hemispheres(SEEDS[:count], n_vertices, folder, progress, workers, generation)


def hemispheres(
    seeds, n_vertices=10_000, folder=None, progress=True, workers=2, generation=GENERATION
):
    """The left hemispheres of `seeds`, a list of Cortex, from files made where missing.

    Files lie in `folder` (default: `default_folder()`); a damaged one is made again with a
    CohortWarning, and an interrupted run continues where it stopped. `workers` run at the same
    time, a hemisphere of 10,000 vertices takes one about ten seconds. CortexError for an unwritable
    folder, and for a file of another generation among them.
    """
    if not isinstance(workers, int) or workers < 1:
        raise CortexError(f"workers is {workers!r}; give a whole number from 1.")
    require_generation(generation)
    folder = default_folder() if folder is None else Path(folder)
    paths = [subject_path(folder, seed, n_vertices, generation) for seed in seeds]
    _require_writable(subject_path(folder, SEEDS[0], n_vertices, generation).parent)
    missing = [(seed, path) for seed, path in zip(seeds, paths) if not _is_whole(path)]
    # Threads suffice: the growth runs outside the interpreter's lock.
    with ThreadPoolExecutor(workers) as pool:
        jobs = [pool.submit(_make, seed, n_vertices, path, generation) for seed, path in missing]
        try:
            for job in tqdm(jobs, desc="synthetic hemispheres", disable=not progress or not jobs):
                job.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [_of_generation(generation, path, load_cortex(path)) for path in paths]


def default_folder():
    """The default folder of the cohort: QCLEARN_SUBJECTS, or the user's cache folder."""
    named = os.environ.get("QCLEARN_SUBJECTS")
    return Path(named) if named else require_home(user_cache_path("qclearn") / "cohort")


def subject_path(folder, seed, n_vertices, generation=GENERATION, hemisphere="left"):
    """The file of one subject of the cohort."""
    return Path(folder) / f"generation-{generation}" / f"{hemisphere}-{n_vertices}-{seed}.npz"


def _make(seed, n_vertices, path, generation):
    save_cortex(path, make_cortex(seed, n_vertices, generation=generation))


def _of_generation(generation, path, subject):
    if subject.generation != generation:
        raise CortexError(
            f"{path} holds a subject of generation {subject.generation} where those of generation "
            f"{generation} lie; remove it, and it is made again."
        )
    return subject


def _is_whole(path):
    """Whether the file is there and can be read; warns where it is there and cannot."""
    if not path.is_file():
        return False
    try:
        load_cortex(path)
    except CortexError as error:
        warnings.warn(f"{error} It is made again now.", CohortWarning, stacklevel=3)
        return False
    return True


def _require_writable(inner):
    try:
        inner.mkdir(parents=True, exist_ok=True)
        # Of a name of its own: others may try at the same time.
        tempfile.TemporaryFile(dir=inner).close()
    except OSError as error:
        raise CortexError(
            f"the cohort's folder {inner.parent} cannot be written ({error.strerror or error}); "
            "give another folder."
        ) from None
