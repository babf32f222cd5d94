"""What every test shares: no windows, the same examples each time, public functions held to their shapes."""

import os

import numpy as np
import pytest
from hypothesis import settings

import qclearn
from qclearn.plane import Disk, linear
from shapes import hold, hold_class
from subjects import FOLDER

os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
os.environ.setdefault("MPLBACKEND", "agg")
os.environ["QCLEARN_SUBJECTS"] = str(FOLDER)

# Files that take longest, a half of the time of all unit tests between them, as of pytest --durations.
LONGEST = [
    "test_benchmark.py", "test_nbgrader.py", "test_package.py", "test_right_or_refused.py", "test_cli.py",
    "test_register.py", "test_train.py", "test_cortex.py", "test_course.py", "test_run.py",
]  # fmt: skip

settings.register_profile("qclearn", deadline=None, derandomize=True)
settings.load_profile("qclearn")

hold(qclearn)
hold_class(Disk)  # what most of the public functions make of a mesh


# Each number in every answer of the solver is off by this share, by chance, the same in each test. No
# verdict may change then; tests marked `digits` are left out.
NOISE, CHANCE = float(os.environ.get("QCLEARN_TEST_NOISE", 0)), np.random.default_rng(0)
START, SUPERLU, CHOLESKY = CHANCE.bit_generator.state, linear.splu, linear.Cholesky.solve


def noisy(x):
    return x * (1 + NOISE * CHANCE.standard_normal(x.shape))


class NoisySuperLU:
    """Factors as of `splu`, whose objects take no other `solve`."""

    def __init__(self, *given, **options):
        self.factors = SUPERLU(*given, **options)

    def __getattr__(self, name):
        return getattr(self.factors, name)

    def solve(self, load):
        return noisy(self.factors.solve(load))


if NOISE:
    linear.splu, linear.Cholesky.solve = NoisySuperLU, lambda self, load: noisy(CHOLESKY(self, load))


def pytest_runtest_setup():
    CHANCE.bit_generator.state = START


def pytest_collection_modifyitems(items):
    """The longest files first, or one of two workers would wait for the other at the end."""
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))


@pytest.fixture(scope="module")
def one_thread():
    """Threads of torch that wait for each other on a busy machine cost more than small problems do."""
    import torch  # here: most tests need none

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def plain_figure(monkeypatch):
    """Commands write an empty figure: drawing it takes longer than the registration of a bowl."""
    from matplotlib.figure import Figure

    monkeypatch.setattr("qclearn.plot.registration_figure", lambda *_: Figure())
