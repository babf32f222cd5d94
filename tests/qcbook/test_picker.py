"""Landmarks clicked on pictures: which vertex a pixel shows, what is taken back, and what is saved."""

import io
import json

import numpy as np
import pytest
from PIL import Image

from meshes import bowl
from qcbook.picker import HEIGHT, WIDTH, LandmarkPicker
from qclearn.registration.curves import check_curves, read_landmarks
from qclearn.registration.problem import LandmarkError

BOWLS = bowl(0.6, 12), bowl(0.9, 12)  # for all tests: their depth, which takes longest, is computed once


@pytest.fixture
def picker(tmp_path):
    return LandmarkPicker(*BOWLS, tmp_path / "landmarks.json")


def pixels_of(view):
    """Where the vertices of a view are in its picture (V, 2), from the upper left corner."""
    renderer, found = view.plotter.renderer, []
    for point in view.shown.vertices:
        renderer.SetWorldPoint(*point, 1.0)
        renderer.WorldToDisplay()
        found.append(renderer.GetDisplayPoint())
    x, y, _ = np.transpose(found)
    return np.stack([x, HEIGHT - 1 - y], axis=1)


def test_a_pixel_shows_the_vertex_that_is_there_also_after_a_turn(picker):
    """Every third vertex of a bowl seen from above, where none hides another."""
    view = picker.views["moving"]
    view.plotter.view_vector((0, 0, 1))
    for turn in ((0, 0, 1.0), (40, 25, 1.1)):
        picker.turn("moving", *turn)
        places = pixels_of(view)
        inner = np.flatnonzero(abs(view.surface.vertices[:, :2]).max(1) < 0.6)[::3]
        assert len(inner) > 20 and [view.vertex_at(*places[k]) for k in inner] == inner.tolist()
    assert view.vertex_at(1, 1) is None


def difference(one, other):
    """How many pixels of two pictures are clearly apart."""
    first, second = (np.asarray(Image.open(io.BytesIO(data)), int) for data in (one, other))
    assert first.shape == (HEIGHT, WIDTH, 3)
    return (abs(first - second).max(2) > 60).sum()


def test_turns_marks_and_undoing_are_seen(picker):
    plain = picker.pictures["control"]
    picker.turn("control", 60, 0)
    turned = picker.pictures["control"]
    assert difference(plain, turned) > 500
    picker.click("control", WIDTH // 2, HEIGHT // 2)
    marked = picker.pictures["control"]
    picker.undo()
    assert difference(turned, marked) > 20 and difference(turned, picker.pictures["control"]) == 0
    picker.undo()
    assert picker.picks == []


def test_ends_become_curves_side_by_side_and_are_saved(picker, tmp_path):
    for side, ends in (("moving", (1, 97)), ("control", (2, 98))):
        for end in ends:
            picker.pick(side, end)
        if side == "moving":
            picker.pick("moving", 5)
            assert picker.said == "curve 1 has both ends on the moving side; click them on the control side."
    assert picker.said == "curve 1 is complete; name it, go on, or save."
    picker.names = ["a sulcus"]
    picker.pick("control", 9)
    assert picker.said == "curve 2 lacks ends: 2 on the moving side and 1 on the control side."
    picker.save()
    contents = read_landmarks(tmp_path / "landmarks.json")
    assert contents["curves"] == [{"name": "a sulcus", "moving": [1, 97], "control": [2, 98]}]
    check_curves(contents, *picker.surfaces.values())
    picker.undo()
    picker.undo()
    assert picker.curves == [{"name": "a sulcus", "moving": [1, 97], "control": [2]}]


def test_what_cannot_be_saved_is_said(picker, tmp_path):
    picker.save()
    assert picker.said.startswith("Not saved: landmarks hold no curves")
    for side, vertex in (("moving", 1), ("moving", 1), ("control", 2), ("control", 98)):
        picker.pick(side, vertex)
    picker.save()
    assert picker.said.startswith("Not saved: curve 'curve 1', moving side: a curve repeats vertex 1")
    picker.click("moving", 0, 0)
    assert picker.said == "There is no surface; click on it."
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_there_is_taken_up_and_none_replaced_unread(picker, tmp_path):
    path = tmp_path / "landmarks.json"
    old = {"name": "curve 2", "moving": [1, 97], "control": [2, 98]}
    held = {"name": "a path", "moving": [3, 4, 5], "control": [4, 5], "detect": False, "hold_out": True}
    marks = {side: surface.fingerprint for side, surface in picker.surfaces.items()}
    path.write_text(json.dumps({"surfaces": marks, "curves": [old, held], "off_fundus_mm": {"curve 2": 1.0}}))
    again = LandmarkPicker(*BOWLS, path)
    assert again.said == f"2 curves of {path}. a path is complete; name it, go on, or save."
    assert again.curves == [old, held] and difference(picker.pictures["moving"], again.pictures["moving"]) > 20
    new = {"name": "curve 3", "moving": [7, 90], "control": [8, 91]}
    for side, vertex in (("moving", 7), ("moving", 90), ("control", 8), ("control", 91), ("control", 30)):
        again.pick(side, vertex)
    again.save()
    assert again.said == f"3 curves written to {path}; curve 4 lacks ends and is not in it."
    contents = read_landmarks(path)
    assert contents["curves"] == [old, held, new] and contents["off_fundus_mm"] == {"curve 2": 1.0}
    for _ in range(9):
        again.undo()
    assert again.curves == [old, held, {**new, "moving": [], "control": []}]
    # Another picker, which began before the file was there, leaves it alone; so does one that read an older one.
    for late in (picker, LandmarkPicker(*BOWLS, path)):
        path.write_text(json.dumps({"curves": [new]}))
        for side, vertex in (("moving", 1), ("moving", 97), ("control", 2), ("control", 98)):
            late.pick(side, vertex)
        late.save()
        assert late.said.startswith(f"Not saved: {path} has changed") and read_landmarks(path)["curves"] == [new]


@pytest.mark.parametrize("text, what", [
    ('{"curves": [', "not a JSON file"), ("", "the file is empty"), ("7", "landmarks hold no curves"),
    (json.dumps({"curves": [{"name": "a", "moving": [0, 999_999], "control": [0, 1]}]}), "the picker leaves it alone"),
    (json.dumps({"surfaces": {"moving": {"sha256": "0" * 64}}, "curves": []}), "the picker leaves it alone"),
])  # fmt: skip
def test_a_file_of_other_surfaces_or_none_of_landmarks_is_left_alone(text, what, tmp_path):
    path = tmp_path / "landmarks.json"
    path.write_text(text)
    with pytest.raises(LandmarkError, match=f"{path}: .*{what}"):
        LandmarkPicker(*BOWLS, path)
    assert path.read_text() == text


def test_the_browser_reaches_four_methods_alone(picker):
    picker.asked(None, {"do": "click", "side": "moving", "x": WIDTH // 2, "y": HEIGHT // 2}, [])
    assert len(picker.picks) == 1
    with pytest.raises(KeyError):
        picker.asked(None, {"do": "close"}, [])
    assert "import " not in picker._esm and "export default" in picker._esm  # imports lead nowhere in JupyterLab
