"""A cohort of synthetic hemispheres, made once and kept in the user's cache folder."""

import hashlib
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from platformdirs import user_cache_path
from tqdm import tqdm

from data_synth.cortex import CortexError, make_cortex
from data_synth.subjects import load_cortex, save_cortex
from qclearn.files.meshes import write_whole

GENERATION = 2  # raise it when the generator's output changes, so that old files are not taken for new ones
SEEDS = tuple(range(1001, 1025))


class CohortWarning(UserWarning):
    """A damaged file of the cohort was found and made again."""


def cohort(count=24, n_vertices=10_000, folder=None, progress=True, workers=2):
    """The first `count` (1 to 24) left hemispheres of the fixed seeds, a list of Cortex: `hemispheres` of those seeds.

    CortexError for a bad count or an unwritable folder.
    """
    if not isinstance(count, int) or not 1 <= count <= len(SEEDS):
        raise CortexError(f"the cohort has 1 to {len(SEEDS)} subjects, not {count!r}.")
    return hemispheres(SEEDS[:count], n_vertices, folder, progress, workers)


def hemispheres(seeds, n_vertices=10_000, folder=None, progress=True, workers=2):
    """The left hemispheres of `seeds`, a list of Cortex, from files made where missing.

    Files lie in `folder` (default: `default_folder()`), each with its SHA-256 beside it; one that does not match is
    made again with a CohortWarning, and an interrupted run continues where it stopped. `workers` run at the same time,
    a hemisphere of 10,000 vertices takes one about ten seconds. CortexError for an unwritable folder.
    """
    if not isinstance(workers, int) or workers < 1:
        raise CortexError(f"workers is {workers!r}; give a whole number from 1.")
    folder = default_folder() if folder is None else Path(folder)
    _require_writable(folder)
    paths = [subject_path(folder, seed, n_vertices) for seed in seeds]
    missing = [(seed, path) for seed, path in zip(seeds, paths) if not _is_whole(path)]
    # Threads suffice: the growth runs outside the interpreter's lock.
    with ThreadPoolExecutor(workers) as pool:
        jobs = [pool.submit(_make, seed, n_vertices, path) for seed, path in missing]
        try:
            for job in tqdm(jobs, desc="synthetic hemispheres", disable=not progress or not jobs):
                job.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [load_cortex(path) for path in paths]


def default_folder():
    """Where the cohort is kept unless a folder is given: the user's cache folder of this platform."""
    return user_cache_path("qclearn") / "cohort"


def subject_path(folder, seed, n_vertices):
    """The file of one subject of the cohort."""
    return Path(folder) / f"generation-{GENERATION}" / f"left-{n_vertices}-{seed}.npz"


def _make(seed, n_vertices, path):
    save_cortex(path, make_cortex(seed, n_vertices))
    write_whole(_checksum_path(path), lambda place: place.write_text(_digest(path)))


def _checksum_path(path):
    return path.with_name(path.name + ".sha256")


def _digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _is_whole(path):
    """Whether the file is there and matches its checksum; warns where it is there and does not."""
    if not path.is_file():
        return False
    checksum = _checksum_path(path)
    if checksum.is_file() and checksum.read_bytes().decode(errors="replace").strip() == _digest(path):
        return True
    warnings.warn(f"{path} does not match its checksum; it is made again.", CohortWarning, stacklevel=3)
    return False


def _require_writable(folder):
    inner = subject_path(folder, SEEDS[0], 0).parent
    try:
        inner.mkdir(parents=True, exist_ok=True)
        trial = inner / ".writable"
        trial.touch()
        trial.unlink()
    except OSError as error:
        raise CortexError(
            f"the cohort's folder {folder} cannot be written ({error.strerror or error}); give another folder."
        ) from None
