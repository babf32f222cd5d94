"""Settings that every test shares: nothing opens a window, and hypothesis draws the same examples in every run."""

import os

from hypothesis import settings

os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
os.environ.setdefault("MPLBACKEND", "agg")

settings.register_profile("qclearn", deadline=None, derandomize=True)
settings.load_profile("qclearn")
