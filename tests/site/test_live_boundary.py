"""The free boundary on its page and in JupyterLab: harmonic measure and descents."""

import numpy as np
import pytest
from explorables import InJupyterLab, OnTheSite

import qclearn as qc

TO = "(e, value) => { e.value = value; e.dispatchEvent(new Event('change')); }"


class TestOnTheSite(OnTheSite):
    page, name, slider = "certificate.html", "boundary", "strength"

    def test_for_no_coefficient_the_measure_is_the_poisson_kernel(self, shown):
        shown.reset()
        shown.press(shown.slider("strength"), "Home")
        shown.drag_with_the_mouse(shown.root.locator("canvas").first, (0.5, 0.6), (0.3, 0.4))
        x, y = shown.state()["pole"]
        assert abs(complex(x, y) - 0.3 - 0.4j) < 0.02
        turns = np.exp(2j * np.pi * np.arange(74) / 73)
        images = qc.mobius(turns, complex(x, y))
        exact = np.angle(images[1:] / images[:-1]) / (2 * np.pi / 73)
        assert shown.number("boundary steps are") == pytest.approx(exact.min(), rel=1e-2)
        assert shown.number("times the mean; .* gets") > 50

    def test_the_printed_loss_collapses_and_energy_minus_area_does_not(self, shown):
        shown.reset()
        step = shown.slider("steps of the descent")
        shown.after(lambda: step.evaluate(TO, "20"))
        assert "The disk has collapsed" in shown.words
        shown.choose("loss that descends", "right")
        shown.after(lambda: step.evaluate(TO, "60"))
        assert "where it ended" in shown.words and shown.number("the map is up to") < 5e-3


class TestInJupyterLab(InJupyterLab):
    name, live, sets = "boundary", "Boundary()", {"strength": 0.3, "loss": "right", "step": 4}

    def test_the_pole_is_dragged(self, shown):
        shown.reset()
        shown.drag(shown.root.locator("canvas").first, (0.5, 0.6), (0.4, 0.5), (0.3, 0.4))
        shown.tab.until("abs(complex(*boundary.state['pole']) - 0.3 - 0.4j) < 1e-3")
        shown.tab.until("abs(boundary.map - boundary.live.map(boundary.state))[boundary.live.rim].max() < 1e-9")
