"""Synthetic hemispheres, each grown once for all tests and pages, in a folder that they share."""

import fcntl
from dataclasses import replace

from book.builder.subjects import folder
from data_synth import load_cortex, make_cortex, save_cortex
from data_synth.cohort import subject_path
from data_synth.generations import GENERATION

FOLDER = folder()


def grown(seed, n_vertices, hemisphere="left", generation=GENERATION):
    """`make_cortex`, grown by whoever asks first. Each call reads arrays of its own, so that a test may change them."""
    path = subject_path(FOLDER, seed, n_vertices, generation, hemisphere)
    path.parent.mkdir(exist_ok=True)
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            save_cortex(path, make_cortex(seed, n_vertices, hemisphere, generation=generation))
    return load_cortex(path)


def stand_in(seed, n_vertices, hemisphere="left", generation=GENERATION):
    """In place of `make_cortex` where two subjects serve as all: the first or the second, under this seed."""
    return replace(grown(1 + (seed + seed // 1000) % 2, n_vertices, hemisphere, generation), seed=seed)
