"""What the benchmark's tests share."""

import pytest


@pytest.fixture
def once(monkeypatch):
    """A map is computed once: the benchmark does so again for the sake of its time alone."""
    monkeypatch.setattr("qclearn.benchmark.trial.REPETITIONS", 1)
