"""The training lab: what its buttons do, and what stands in its place on a page without a kernel."""

import re
from functools import partial
from types import SimpleNamespace

import pytest

from qcbook.traininglab import LabPicture, TrainingLab, training_lab


@pytest.fixture
def lab(one_thread):
    lab = TrainingLab()
    lab.seconds = SimpleNamespace(value=0.2)  # the slider has whole seconds
    yield lab
    lab.halt()


def test_it_trains_stops_and_goes_on(lab):
    lab.go_on.click()
    assert "There is no network yet" in lab.text.value
    lab.seconds.value = 60
    lab.start.click()
    lab.stop.click()
    lab.wait()
    stopped = len(lab.lesson.history)
    assert stopped >= 1 and f"{stopped} steps" in lab.text.value
    assert "L_CP of CP-Net in training is" in lab.text.value and "<img" in lab.picture.value
    lab.seconds.value = 0.2
    first = lab.lesson
    lab.go_on.click()
    lab.wait()
    assert lab.lesson is first and len(first.history) > stopped


def test_settings_hold_from_the_next_start(lab):
    lab.network.value = "DBS-Net"
    assert lab.own["CP-Net"].layout.display == "none" and not lab.own["DBS-Net"].layout.display
    lab.rho.value = 1e-4
    lab.start.click()
    lab.wait()
    assert lab.lesson.rho == pytest.approx(1e-4)
    assert float(re.search(r"map is ([\d.e-]+) from the exact", lab.text.value)[1]) > 0
    assert "triangles are folded" in lab.text.value


def test_bad_weights_are_said(lab):
    lab.rate.value = 0.1
    lab.network.value = "DBS-Net"
    lab.start.click()
    lab.wait()
    lab.lesson.network.fourier.M.data.fill_(float("nan"))
    lab.go_on.click()
    lab.wait()
    assert "Stopped" in lab.text.value and "lower rate" in lab.text.value


def test_a_page_without_a_kernel_shows_a_short_run(monkeypatch, one_thread):
    monkeypatch.setenv("QCLEARN_PAGES", "static")
    monkeypatch.setattr("qcbook.traininglab.LabPicture", partial(LabPicture, seconds=0.5))
    page = training_lab()
    assert isinstance(page, LabPicture)
    assert page._repr_html_().count("<img alt=") == 2 and "JupyterLab" in page._repr_html_()
