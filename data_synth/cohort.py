"""A cohort of synthetic hemispheres, made once and stored in the user's cache folder."""

import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from platformdirs import user_cache_path
from tqdm import tqdm

from qclearn.io.checkpoint import require_home

from .cortex import CortexError, make_cortex, require_generation
from .generations import GENERATION
from .subjects import load_cortex, save_cortex

SEEDS = tuple(range(1001, 1025))


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

    Files lie in `folder` (default: `default_folder()`), and an interrupted run continues where it
    stopped. `workers` run at the same time, a hemisphere of 10,000 vertices takes one about ten
    seconds. CortexError for an unwritable folder, and for a file that cannot be read or is of
    another generation.
    """
    if not isinstance(workers, int) or workers < 1:
        raise CortexError(f"workers is {workers!r}; give a whole number from 1.")
    require_generation(generation)
    folder = default_folder() if folder is None else Path(folder)
    paths = [subject_path(folder, seed, n_vertices, generation) for seed in seeds]
    inner = subject_path(folder, SEEDS[0], n_vertices, generation).parent
    try:
        inner.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=inner).close()  # of a name of its own: others may try, too
    except OSError as error:
        raise CortexError(
            f"the cohort's folder {folder} cannot be written ({error.strerror or error}); give "
            "another folder."
        ) from None

    def make(seed, path):
        save_cortex(path, make_cortex(seed, n_vertices, generation=generation))

    missing = [(seed, path) for seed, path in zip(seeds, paths) if not path.is_file()]
    # Threads suffice: the growth runs outside the interpreter's lock.
    with ThreadPoolExecutor(workers) as pool:
        jobs = [pool.submit(make, seed, path) for seed, path in missing]
        try:
            for job in tqdm(
                jobs, desc="synthetic hemispheres", disable=not (progress and jobs) or None
            ):
                job.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    subjects = [load_cortex(path) for path in paths]
    for path, subject in zip(paths, subjects):
        if subject.generation != generation:
            raise CortexError(
                f"{path} holds a subject of generation {subject.generation} where those of "
                f"generation {generation} lie; remove it, and it is made again."
            )
    return subjects


def default_folder():
    """The default folder of the cohort: QCLEARN_SUBJECTS, or the user's cache folder."""
    named = os.environ.get("QCLEARN_SUBJECTS")
    return Path(named) if named else require_home(user_cache_path("qclearn") / "cohort")


def subject_path(folder, seed, n_vertices, generation=GENERATION, hemisphere="left"):
    """The file of one subject of the cohort."""
    return Path(folder) / f"generation-{generation}" / f"{hemisphere}-{n_vertices}-{seed}.npz"
