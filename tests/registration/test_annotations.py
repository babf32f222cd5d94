"""Annotations of both sides: matched by name, of the cut or of the whole surface, and their Dice
before and after."""

import numpy as np
import pytest
from test_register import bowl, entries, spoke

from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.registration.pair import SurfacePair
from qclearn.registration.register import register
from qclearn.registration.report import check_annotations, dice
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.surface import Surface, SurfaceError

Z, FACES = polar_disk(14, 42)  # as of the bowls
LEFT_AND_RIGHT = np.where(Z.real < 0, "left half", "right half")
NUMBERS = np.arange(3, 3 + len(Z))[::-1]  # of its vertices in a whole surface


def on_a_disk():
    """A flat disk beside itself: (`SurfacePair`, one of its two surfaces)."""
    surface = Surface(np.stack([Z.real, Z.imag, 0 * Z.real], axis=1), FACES)
    side = ParameterizedSurface(surface, Disk(Z, FACES))
    return SurfacePair(side, side, [], []), surface


def test_dice_is_the_share_of_the_area_that_has_one_name():
    sides, surface = on_a_disk()
    regions = check_annotations((LEFT_AND_RIGHT, LEFT_AND_RIGHT), surface, surface)
    found = dice(sides, regions, 1j * Z, Z)
    assert found["before"] == pytest.approx(0.5, abs=0.03) and found["after"] == 1 and found["of"] == 2
    assert found["regions"]["left half"] == pytest.approx([0.5, 1], abs=0.03)
    assert dice(sides, regions, -Z, Z)["before"] < 0.08  # the vertices on the line between them
    assert dice(sides, None, Z, Z) == {}


def test_dice_of_unequal_regions_is_weighed_by_their_areas():
    sides, surface = on_a_disk()
    inner = np.where(abs(Z) < 0.5, "core", LEFT_AND_RIGHT)
    other = np.where(abs(Z) < 0.5, "core", "left half")
    names = check_annotations((inner, other), surface, surface)
    areas, own = surface.vertex_areas, {name: inner == name for name in ("core", "left half")}
    found = dice(sides, names, Z, Z)
    left, both = areas[own["left half"]].sum(), areas[other == "left half"].sum()
    assert found["regions"] == {"core": [1, 1], "left half": pytest.approx([2 * left / (left + both)] * 2)}
    core = areas[own["core"]].sum()
    assert found["after"] == pytest.approx(2 * (core + left) / (2 * core + left + both))


def test_names_count_and_not_their_order_and_those_of_nothing_do_not():
    _, surface = on_a_disk()
    moving = np.where(Z.imag < 0, LEFT_AND_RIGHT, "unknown")
    control = np.where(Z.imag < 0, LEFT_AND_RIGHT, np.where(Z.real < 0, "Unknown", "a new one"))
    one, other, names, count = check_annotations((moving, control), surface, surface)
    assert names == ["left half", "right half"] and count == 3
    np.testing.assert_array_equal(one, other)
    assert set(one[Z.imag >= 0]) == {-1}


def test_regions_of_the_whole_surface_are_those_of_the_cut_one():
    _, surface = on_a_disk()
    cut = Surface(surface.vertices, FACES, None, NUMBERS)
    whole = np.full(len(Z) + 5, "unknown   ")
    whole[NUMBERS] = LEFT_AND_RIGHT
    one, other, *_ = check_annotations((whole, LEFT_AND_RIGHT), cut, surface)
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "annotations, text",
    [
        ((LEFT_AND_RIGHT, LEFT_AND_RIGHT[:-1]), "annotation, control side: 588 regions for 589 vertices; give one a v"),
        ((np.tile(LEFT_AND_RIGHT, 3), LEFT_AND_RIGHT), "annotation, moving side: 1767 regions for 589 vertices"),
        ((LEFT_AND_RIGHT, np.full(len(Z), "insula")), r"share no region's name \(moving: left half, right half; contr"),
        ((np.arange(len(Z)), LEFT_AND_RIGHT), r"annotation, moving side: int64 \(589,\); give the name of each vert"),
        (LEFT_AND_RIGHT, "no pair"),
    ],
)
def test_annotations_that_do_not_fit_are_refused(annotations, text):
    _, surface = on_a_disk()
    cut = Surface(surface.vertices, FACES, None, NUMBERS)
    with pytest.raises(SurfaceError, match=text):
        check_annotations(annotations, cut, cut)


def test_a_map_that_leads_away_from_what_was_not_fitted_is_worse():
    """A bowl of 10 cm onto itself, along four spokes of which one ends five vertices off; a right
    one beside it."""
    surface = Surface(100 * bowl(0.6).vertices, FACES)
    curves = [{"name": str(k), "moving": spoke(k), "control": spoke(k)} for k in (0, 14, 18, 28, 35)]
    curves[1]["control"] = spoke(19)
    options = {"features": None, "hold_out": ["18"], "annotations": (LEFT_AND_RIGHT, LEFT_AND_RIGHT)}
    report = register(surface, surface, curves, **options).report
    (reason,), (before, after) = report["suspect"], report["held_out_mm"]["18"]
    found = f"end {after:.1f} mm from their targets on average ({before:.1f} after the best Möbius map)"
    assert reason.startswith(f"worse: the held-out curves {found}") and after - before > 2


def test_a_good_map_is_not_worse():
    surface = Surface(100 * bowl(0.6).vertices, FACES)
    report = register(surface, surface, entries(0), features=None, annotations=(LEFT_AND_RIGHT,) * 2).report
    assert report["suspect"] == [] and report["dice"]["after"] == 1
