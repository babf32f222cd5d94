"""Curves that a detector finds: used, or replaced by the shortest path. (Maps: test_register.)"""

import re
from dataclasses import replace

import numpy as np
import pytest

from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.plane.mobius import mobius
from qclearn.registration.curves import POINTS, Curve, curve_lines, detect_curves, fill
from qclearn.registration.fit import exact_map, moved_map
from qclearn.registration.networks import refined
from qclearn.registration.problem import Problem, Weights
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.surface import Surface

Z, FACES = polar_disk(14, 42)
DISK = Disk(Z, FACES)
BOWL = Surface(np.stack([Z.real, Z.imag, 0.6 * (1 - abs(Z) ** 2)], axis=1), FACES)


def spoke(angle, first=2, last=9):
    """The vertices of one spoke of the bowl, from the inside out."""
    return np.array([1 + ring * 42 + angle for ring in range(first, last)])


def entry(name, path, detect=False):
    return Curve(name, path[[0, -1]] if detect else path, path, {"moving": detect})


def straight(change=lambda line: line):
    """A detector that draws straight lines, changed."""
    return lambda surface, z, endpoints: [change(np.linspace(*z[pair], 20)) for pair in endpoints]


def guarded(detect, entries):
    return curve_lines(ParameterizedSurface(BOWL, DISK), entries, "moving", detect)


def test_given_curves_stay_and_good_ones_are_used():
    angles = {"given": 0, "first": 10, "bent": 20, "last": 30}
    entries = [entry(name, spoke(angle), name in ("first", "last")) for name, angle in angles.items()]
    lines, fallbacks = guarded(straight(), entries)
    assert fallbacks == []
    for line, path in zip(lines[::2], (spoke(0), spoke(20)), strict=True):
        np.testing.assert_array_equal(line, Z[path])
    for line, path in zip(lines[1::2], (spoke(10), spoke(30)), strict=True):
        np.testing.assert_allclose(line[[0, -1]], Z[path[[0, -1]]])
        assert len(line) >= 256 and abs(np.diff(line, 2)).max() < 1e-12
    assert guarded(None, entries[:1])[1] == []  # nothing is detected where all is given


@pytest.mark.parametrize("change, fault", [
    (lambda line: line * np.nan, "leaves the disk"),
    (lambda line: np.concatenate([line[:1], [1.5j], line[-1:]]), "leaves the disk"),
    (lambda line: line[:0], "leaves the disk"),
    (lambda line: line[:1], "leaves the disk"),
    (lambda line: line[:-1], "misses its endpoints"),
    (lambda line: line[::-1], "misses its endpoints"),
    (lambda line: np.concatenate([line[:9], [line[2] + 0.02j, line[2] - 0.02j], line[9:]]), "crosses itself"),
    (lambda line: np.concatenate([line[:9], [line[9] * 1j], line[9:]]), "crosses or touches 'other'"),
])  # fmt: skip
def test_a_curve_that_wanders_is_replaced_by_the_shortest_path(change, fault):
    entries = [entry("other", spoke(5)), entry("wanderer", spoke(0), True)]
    (other, line), fallbacks = guarded(straight(change), entries)
    assert fallbacks == [f"LD-Net's moving curve 'wanderer' {fault}: shortest path"]
    np.testing.assert_array_equal(other, Z[spoke(5)])
    np.testing.assert_array_equal(line, detect_curves(BOWL, Z, [spoke(0)[[0, -1]]])[0])


def test_of_two_detected_curves_that_cross_both_are_replaced_and_of_two_that_meet_in_an_end_none():
    crossed = [np.array([spoke(0)[-1], spoke(20)[-1]]), np.array([spoke(10)[-1], spoke(30)[-1]])]
    entries = [entry("one", crossed[0], True), entry("two", crossed[1], True), entry("apart", spoke(36), True)]
    lines, fallbacks = guarded(straight(lambda line: line[: len(line) - (line[0] == Z[spoke(36)[0]])]), entries)
    for line, path in zip(lines, [*crossed, spoke(36)], strict=True):
        np.testing.assert_array_equal(line, detect_curves(BOWL, Z, [path[[0, -1]]])[0])
    faults = ("apart", "misses its endpoints"), ("one", "crosses or touches 'two'"), ("two", "crosses or touches 'one'")
    assert fallbacks == [f"LD-Net's moving curve '{name}' {fault}: shortest path" for name, fault in faults]
    meeting = [np.array([spoke(0)[-1], 0]), np.array([0, spoke(12)[-1]])]
    assert guarded(straight(), [entry(f"{k}", ends, True) for k, ends in enumerate(meeting)])[1] == []


def test_filling_keeps_the_polyline():
    line = np.array([0, 0.5, 0.5 + 0.2j, -0.1j])
    filled = fill(line, POINTS)
    assert len(filled) >= 256 and abs(np.diff(filled)).sum() == pytest.approx(abs(np.diff(line)).sum())
    np.testing.assert_array_equal(filled[:: (len(filled) - 1) // 3], line)


def test_the_exact_map_of_no_coefficient_is_the_mobius_map_and_of_two_maps_the_most_switched_rows_are_told():
    p = 0.6 * np.exp(2j * np.pi * np.arange(7) / 7)
    problem, nothing = Problem(DISK, p, mobius(p, 0.2 + 0.1j, 0.7)), np.zeros(len(FACES), complex)
    fit = exact_map(problem, nothing)
    assert fit.mobius[0] == pytest.approx(0.2 + 0.1j, abs=2e-3) and fit.mobius[1] == pytest.approx(0.7, abs=5e-3)
    assert fit.bijective and fit.fallbacks == () and fit.landmark_error < 3e-3 and abs(fit.mu).max() < 0.05
    np.testing.assert_allclose(fit.f, moved_map(problem, Z).f, atol=1e-6)
    folded = replace(fit, bijective=False, flipped=np.arange(3), switched=9)
    mended = refined(problem, Weights(), nothing, folded, 5e-3)
    assert mended.bijective and mended.switched == 9
    assert re.fullmatch(r"the exact solver's map folded 3 faces: \d+ Gauss-Newton steps, to \S+", mended.fallbacks[0])
