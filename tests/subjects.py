"""Synthetic hemispheres, each grown once for all tests of a run and kept in a folder that all
workers share."""

import fcntl
import os
from dataclasses import replace
from pathlib import Path

from data_synth import load_cortex, make_cortex, save_cortex
from data_synth.generations import GENERATION

SHARED = "QCLEARN_TESTED_SUBJECTS"  # the environment's name for the folder; conftest.py makes it


def grown(seed, n_vertices, hemisphere="left", generation=GENERATION):
    """`make_cortex`, grown by whoever asks first. Each call reads arrays of its own, so that a test
    may change them."""
    path = Path(os.environ[SHARED], f"{generation}-{hemisphere}-{n_vertices}-{seed}.npz")
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            save_cortex(path, make_cortex(seed, n_vertices, hemisphere, generation=generation))
    return load_cortex(path)


def stand_in(seed, n_vertices, hemisphere="left", generation=GENERATION):
    """In place of `make_cortex` where two subjects serve as all: the first or the second, under this seed."""
    return replace(grown(1 + (seed + seed // 1000) % 2, n_vertices, hemisphere, generation), seed=seed)
