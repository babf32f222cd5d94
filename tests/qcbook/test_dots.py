"""Measured rows as dots: where they stand, and how they look."""

import pytest
from matplotlib.figure import Figure

from qcbook import dot_lines, run_dots

ROWS = [
    {"run": "ours", "set": "a", "pair": "1", "mm": 1.0},
    {"run": "ours", "set": "a", "pair": "2", "mm": 3.0},
    {"run": "theirs", "set": "b", "pair": "1", "mm": 4.0},
    {"run": "theirs", "set": "a", "pair": "1", "mm": None},
]


def points(ax, marker):
    lines = [line for line in ax.lines if line.get_marker() == marker]
    return [(float(x), float(y)) for line in lines for x, y in zip(*line.get_data(), strict=True)]


def test_dots_are_rows_and_bars_their_means():
    ax = Figure().subplots()
    dot_lines(ax, ROWS, "mm", {"a": "first", "b": "second", "c": "not drawn"}, lambda row: row["mm"] > 2)
    assert points(ax, "o") == [(1, pytest.approx(-0.2))]
    assert points(ax, "x") == [(3, pytest.approx(-0.2)), (4, pytest.approx(1.2))]
    assert points(ax, "|") == [(2, pytest.approx(-0.2)), (4, pytest.approx(1.2))]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["ours", "theirs"]
    assert ax.get_ylim()[0] > ax.get_ylim()[1], "the first run is on top"


def test_a_run_is_a_dot_over_its_rows():
    ax = Figure().subplots()
    whole = {"x": 0.5, "mm": 2.0, "certified": 2, "pairs": 2}
    found = {"ours": whole, "harmonic 5": whole | {"mm": 0.01, "certified": 1}}
    rows = [*ROWS, {"run": "harmonic 5", "set": "a", "pair": "1", "mm": 0.01}]
    run_dots(ax, found, rows, "x", "mm", floor=0.1)
    assert points(ax, "s") == [(0.5, 0.1)] and points(ax, "D") == [(0.5, 2.0)]
    (hollow,) = (line for line in ax.lines if line.get_marker() == "s" and len(line.get_xdata()))
    assert hollow.get_markerfacecolor() == "white", "one of its maps is not certified"
    assert [3.0, 1.0] in [sorted(line.get_ydata(), reverse=True) for line in ax.lines if len(line.get_xdata()) == 2]
