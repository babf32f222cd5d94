"""Small networks in training: losses fall, a run goes on where it was stopped, and bad rates are refused."""

import numpy as np
import pytest

import qclearn as qc
from qcbook.lessons import CPLesson, DBSLesson, lesson
from qclearn.nets import TrainingError
from qclearn.registration.problem import Weights

SETTINGS = {"alpha": 1.0, "beta": 0.01, "gamma": 1e3, "equation": "as corrected", "rho": 1e-6, "rate": 3e-3}


def steps(lesson, count):
    for _ in range(count):
        lesson.step()


@pytest.mark.parametrize("network", ["CP-Net", "DBS-Net"])
def test_a_network_learns(network, one_thread):
    taught = lesson(network, SETTINGS)
    before = taught.unseen()
    steps(taught, 25)
    assert taught.least < taught.unseen() < 0.7 * before


def test_a_run_that_was_stopped_goes_on(one_thread):
    whole, parts = (CPLesson(Weights(1.0, 0.01, 1e3)) for _ in range(2))
    steps(whole, 4)
    for count in (2, 4):
        parts.train(60, stop=lambda count=count: len(parts.history) == count)
        assert len(parts.history) == count
    assert parts.history == whole.history


def test_its_loss_is_that_of_the_map(one_thread):
    """L_CP in torch against the library's, by the exact solver."""
    taught = CPLesson(Weights(2.0, 0.03, 50.0))
    steps(taught, 3)
    problem = taught.problem
    mu = taught.answer(problem.moving)
    f = qc.solve_beltrami_disk(problem.disk.z, problem.disk.faces, mu)
    w = problem.samples @ f
    w = qc.mobius(w, *qc.best_mobius(w, problem.target))
    areas = qc.signed_areas(problem.disk.z, problem.disk.faces)
    L_mu, L_Landmark = areas @ abs(mu) ** 2 / areas.sum(), (abs(w - problem.target) ** 2).mean()
    least = 2.0 * L_mu + 50.0 * L_Landmark
    heavy = CPLesson(Weights(2.0, 0.0, 50.0))
    heavy.network.load_state_dict(taught.network.state_dict())
    assert heavy.unseen() == pytest.approx(least, rel=1e-3) and taught.unseen() > least


def test_the_printed_equation_is_another_loss(one_thread):
    """Its rows on the boundary are not 0 at the right map: the loss of the untrained network is larger."""
    right, printed = DBSLesson("as corrected", rho=0.0), DBSLesson("as printed", rho=0.0)
    mu = right.draw()
    assert printed.loss(mu).item() > 1.2 * right.loss(mu).item()


def test_a_rate_that_is_too_high_is_said(one_thread):
    wild = DBSLesson(rate=1e-3)
    for parameter in wild.network.parameters():
        parameter.data.fill_(np.nan)
    with pytest.raises(TrainingError, match="at step 0; start anew with a lower rate"):
        wild.step()
