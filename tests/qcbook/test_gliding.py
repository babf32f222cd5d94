"""Curves that glide on a surface: where they begin and end, and that the far side is left out."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

import qclearn as qc
from qcbook import Gliding, View, view_figure

Z, FACES = qc.polar_disk(12, 36)
DOME, LINE = qc.Surface(np.stack([Z.real, Z.imag, 1 - abs(Z) ** 2], axis=1), FACES), np.linspace(-0.5, 0.5, 9) + 0j


def numbers(text):
    return np.array([[float(x) for x in pair.split(",")] for pair in text.split()])


def test_a_curve_ends_on_its_target():
    """Of a dome, a line that stays and one that the map turns onto it."""
    turn = np.exp(0.5j)
    registration = SimpleNamespace(disk_moving=Z, disk_control=Z, disk_map=turn * Z, faces_moving=FACES)
    groups = [("red", [LINE], False), ("yellow", [LINE / turn], True)]
    shown = Gliding(registration, DOME, groups, "A dome")._repr_html_()
    assert 'aria-label="A dome"' in shown and shown.count('type="range"') == 1
    still, moving = re.findall(r"<polyline.*?</polyline>", shown)
    assert "<animate" not in still
    target, steps = re.search(r'points="([^"]*)"', still)[1], re.search(r'values="([^"]*)"', moving)[1].split(";")
    apart = [np.abs(numbers(step) - numbers(target)).max() for step in steps]
    assert apart[-1] < 1 and apart[0] > 50 and np.all(np.diff(apart) < 0)


def test_points_of_the_far_side_are_left_out():
    z, faces = qc.polar_disk(24, 72)
    theta = 0.9 * np.pi * abs(z)  # most of a sphere, seen from the side away from its rim
    across = np.sin(theta) * np.exp(1j * np.angle(z))
    vertices = np.stack([across.real, across.imag, np.cos(theta)], axis=1)
    same = SimpleNamespace(disk_moving=z, disk_control=z, disk_map=z, faces_moving=faces)
    line = np.linspace(0, 0.95, 40) + 0j
    shown = Gliding(same, qc.Surface(vertices, faces), [("red", [line], False)], "A sphere")._repr_html_()
    assert 12 < len(numbers(re.search(r'polyline stroke="red" points="([^"]*)"', shown)[1])) < 25


def test_each_panel_has_its_curves_and_its_title():
    panels = {"one": [("red", [LINE])], "two": [("red", [LINE]), ("yellow", [1j * LINE])]}
    fig = view_figure(View(Z, DOME), panels)
    shown = [ax for ax in fig.axes if ax.get_title()]
    colours = [[one.get_color() for one in ax.lines if one.get_color() != "black"] for ax in shown]
    assert dict(zip([ax.get_title() for ax in shown], colours)) == {"one": ["red"], "two": ["red", "yellow"]}
    across, down = (shown[1].lines[i].get_xydata() for i in (1, 3))
    assert np.ptp(across[:, 0]) == pytest.approx(np.ptp(down[:, 1]), rel=0.1)
