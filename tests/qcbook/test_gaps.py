"""The gap between CP-Net and the fit over a grid of weights: one map for weights that differ by a
factor, and bands."""

import pytest

from qcbook.examples import example_problems
from qcbook.fitstates import exact_fit, fit_state, network_fit
from qcbook.gaps import gap_bands, gap_grid

RANGES = (-2.0, 1.0), (2.3, 5.3)


@pytest.fixture(scope="module")
def gaps():
    return gap_grid(example_problems()[0], RANGES, (1.0, 10.0), (0.1, 1.0), (1e3, 1e4))


def test_weights_that_differ_by_a_factor_have_one_gap(gaps):
    ratio = {gap.weights: gap.ratio for gap in gaps}
    assert len(ratio) == 8 and len(set(ratio.values())) == 7
    assert ratio[1.0, 0.1, 1e3] == ratio[10.0, 1.0, 1e4] != ratio[1.0, 0.1, 1e4]


def test_it_is_the_ratio_of_what_the_sliders_show(gaps):
    fitted, passed = (
        fit_state(example_problems()[0], (1.0, 1.0, 1e4), solver=solver) for solver in (exact_fit, network_fit)
    )
    (gap,) = [gap for gap in gaps if gap.weights == (1.0, 1.0, 1e4)]
    assert gap.ratio == pytest.approx(passed.loss / fitted.loss, rel=1e-9) and gap.ratio > 1


def test_bands_hold_what_was_trained(gaps):
    assert [gap.trained for gap in gaps] == [True] * 4 + [False, True, False, True]
    bands = [
        {"from": 3, "to": 4, "CP-Net": 1.1},
        {"from": 4, "to": 6, "CP-Net": 2.0},
        {"from": 7, "to": 8, "CP-Net": 9.0},
    ]
    (low, high, count, median, worst, measured), stiff = gap_bands(gaps, bands)
    assert (low, high, count, measured) == (3, 4, 1, 1.1) and median == worst
    assert stiff[2] == 5 and stiff[4] >= stiff[3]
