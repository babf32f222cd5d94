"""The rules of the verdicts: a planted value turns each of them."""

import pytest

from qcbook import compared, judge_ratio, side

RATIOS = {
    "agrees": [(0.91, 0.95), (1.24, 1.69), (0.91, 0.95, 0.93, 0.98)],
    "turned round": [(0.91, 1.29), (1.29, 0.91), (0.91, 1.29, 1.2, 1.4)],  # of one size, and yet the other way
    "agrees in direction only": [(1.24, 2.0), (0.124, 0.5)],
    "not settled": [(0.91, 1.0), (0.91, 0.95, 0.90, 1.01)],  # an interval that holds 1
}


@pytest.mark.parametrize("verdict, ratios", RATIOS.items())
def test_a_ratio_is_judged_by_its_direction_and_its_size(verdict, ratios):
    assert {judge_ratio(*given) for given in ratios} == {verdict}


def test_an_interval_and_a_pair_have_a_side():
    assert [side(-2, -1), side(-1, 1), side(1, 2)] == ["below", "level", "above"]
    assert side(0.8, 0.9, of=1) == "below"
    assert [compared(0.91, 1), compared(1.03, 1), compared(1.29, 1)] == ["below", "level", "above"]
