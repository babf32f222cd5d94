"""The rules of the verdicts: a planted value turns each of them."""

import pytest

from qcbook import compared, judge_all, judge_bound, judge_order, judge_ratio, judge_size, side

RATIOS = {
    "agrees": [(0.91, 0.95), (1.24, 1.69), (0.91, 0.95, 0.93, 0.98)],
    "turned round": [(0.91, 1.29), (1.29, 0.91), (0.91, 1.29, 1.2, 1.4)],  # of one size, and yet the other way
    "agrees in direction only": [(1.24, 2.0), (0.124, 0.5)],
    "not settled": [(0.91, 1.0), (0.91, 0.95, 0.90, 1.01)],  # an interval that holds 1
}


@pytest.mark.parametrize("verdict, ratios", RATIOS.items())
def test_a_ratio_is_judged_by_its_direction_and_its_size(verdict, ratios):
    assert {judge_ratio(*given) for given in ratios} == {verdict}


def test_a_size_is_judged_by_its_factor():
    assert judge_size(46.14, 40) == "agrees"
    assert judge_size(46.14, 0.5) == "92 times smaller"
    assert judge_size(1, 20) == "20 times larger"


def test_an_order_breaks_with_one_pair_and_a_bound_is_a_bound():
    assert judge_order([4, 3, 1], rising=False) == "agrees" == judge_bound(0.9, 0.95)
    broken = ([4, 3, 3.5], False), ([4, 3, 1], True), ([1, 1], True)
    assert {judge_order(values, rising=rising) for values, rising in broken} == {"does not hold"}
    assert judge_bound(0.9, 0.66) == "does not hold"
    assert [judge_all(12, 12), judge_all(11, 12), judge_all(0, 0)] == ["agrees", "does not hold", "does not hold"]


def test_an_interval_and_a_pair_have_a_side():
    assert [side(-2, -1), side(-1, 1), side(1, 2)] == ["below", "level", "above"]
    assert side(0.8, 0.9, of=1) == "below"
    assert [compared(0.91, 1), compared(1.03, 1), compared(1.29, 1)] == ["below", "level", "above"]
