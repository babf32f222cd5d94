"""Whole surfaces at the command line go in and come out as if cut by hand; what does not belong is one line."""

import json
import re

import nibabel
import numpy as np
import pytest

import qclearn as qc
from commands import BALL, NAMES, everything, label, made, refused, run  # noqa: F401 (made: a fixture)
from freesurfer import GEOMETRY
from known_surfaces import torus_mesh, with_seam
from qclearn.io.hemisphere import read_hemisphere
from qclearn.io.mapfile import read_registration
from qclearn.io.meshes import frame_of
from qclearn.io.values import read_map
from qclearn.registration.curves import on_cut_surfaces

SIDES = {"moving": "rh", "control": "lh"}


def to_register(folder, *options):
    words = ("--cortex", folder / "rh.cortex.label", "--control-cortex", folder / "lh.cortex.label", "--mirror")
    return ["register", folder / "rh.pial", folder / "lh.pial", *words, "--accept-suspect", *options]


@pytest.fixture(scope="module")
def registered(made, tmp_path_factory):
    """The whole pair registered along whole landmarks by a whole map that is NaN on the wall."""
    out = tmp_path_factory.mktemp("whole") / "out"
    more = "--landmarks", made / "landmarks.json", "--feature", made / "rh.sulc", made / "lh.sulc"
    run(*to_register(made, *more, "--out", out))
    return out


@pytest.fixture(scope="module")
def cut(made, tmp_path_factory):
    """The same cut by hand."""
    folder = tmp_path_factory.mktemp("cut")
    landmarks = json.loads((made / "landmarks.json").read_text())
    for side, key in (("rh", "moving"), ("lh", "control")):
        mask = "--mask", made / f"{side}.cortex.label", "--keep"
        run("open", made / f"{side}.pial", *mask, "--out", folder / f"{side}.open.npz")
        table = qc.read_surface(folder / f"{side}.open.npz").original_vertices
        np.save(folder / f"{side}.sulc.npy", qc.read_values(made / f"{side}.sulc")[table])
        for curve in landmarks["curves"]:
            curve[key] = [int(np.flatnonzero(table == vertex)[0]) for vertex in curve[key]]
    (folder / "landmarks.json").write_text(json.dumps(landmarks))
    more = ("--landmarks", folder / "landmarks.json", "--feature", folder / "rh.sulc.npy", folder / "lh.sulc.npy")
    pair = folder / "rh.open.npz", folder / "lh.open.npz"
    run("register", *pair, "--mirror", *more, "--out", folder / "out")
    return folder


@pytest.mark.digits
def test_a_whole_pair_is_registered_bit_for_bit_as_one_cut_by_hand(registered, cut):
    ours, theirs = (np.load(place / "registration.npz") for place in (registered, cut / "out"))
    assert set(ours.files) == set(theirs.files)
    assert [name for name in ours.files if not np.array_equal(ours[name], theirs[name])] == []
    assert (registered / "registered.surf.gii").read_bytes() == (cut / "out" / "registered.surf.gii").read_bytes()


def test_the_report_holds_whole_landmarks_for_the_whole_surfaces(made, registered):
    report = json.loads((registered / "report.json").read_text())
    assert report["inputs"]["moving"]["sha256"] == qc.read_surface(made / "rh.pial").fingerprint["sha256"]
    given = {"moving": read_hemisphere(made / "rh.pial", made / "rh.cortex.label")}
    given["control"] = read_hemisphere(made / "lh.pial", made / "lh.cortex.label")
    (one, _), (cut_one, _) = (
        landmarks["curves"] for landmarks in (report["landmarks"], on_cut_surfaces(report["landmarks"], given))
    )
    assert cut_one["detect"] is False and cut_one["moving"] != one["moving"]
    assert given["moving"].cut_surface.original_vertices[cut_one["moving"]].tolist() == one["moving"]
    other = report["landmarks"]["surfaces"] | {"moving": {"vertices": 641}}
    with pytest.raises(qc.LandmarkError, match="made for another moving surface"):
        on_cut_surfaces(report["landmarks"] | {"surfaces": other}, given)


@pytest.mark.parametrize("wall", ["0", "nan", "cut"])
def test_whole_values_go_in_and_come_out(made, registered, cut, tmp_path, wall):
    """On the cortex bit for bit what cut values give."""
    words = "transfer", registered / "registration.npz", made / "rh.sulc", "--to", "control"
    run(*words, "--wall", wall, "--out", tmp_path / "there.npy")
    there, maps = (np.load(tmp_path / "there.npy"), read_registration(registered / "registration.npz"))
    sulc = np.load(cut / "rh.sulc.npy")
    expected = qc.transfer(sulc, maps["disk_map"], maps["faces_moving"], maps["disk_control"])
    table, cortex = maps["table_control"], tmp_path / "cortex.shape.gii"
    np.testing.assert_array_equal(there if wall == "cut" else there[table], expected)
    assert cortex.exists() == (wall != "cut")
    if wall != "cut":
        outside = np.delete(there, table)
        assert len(there) == 642 and len(outside) and np.isnan(outside).all() == (wall == "nan")
        assert wall == "nan" or not outside.any()
        found = read_map(cortex)
        assert found.side == "left" and found.names == ["cortex"]
        np.testing.assert_array_equal(np.flatnonzero(found.values), table)
    run(*words[:2], cut / "rh.sulc.npy", *words[3:], "--wall", wall, "--out", tmp_path / "again.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "again.npy"), there)


@pytest.mark.parametrize("name, options, kept", [
    *((name, (), True) for name in ("rh.area", "rh.area.pial", "rh.volume", "rh.area.fwhm5.mgh", "x.rh.area.gii")),
    *((name, (), False) for name in ("rh.thickness", "rh.jacobian_white.mgh", "rh.area44.npy", "area.npy")),
    ("rh.area", ("--mean",), False), ("rh.area", ("--nearest",), True), ("streamlines.npy", ("--sum",), True),
])  # fmt: skip
def test_amounts_keep_their_sum_on_the_cortex_and_a_line_says_so(
    made, registered, tmp_path, capsys, name, options, kept
):
    table = read_registration(registered / "registration.npz")["table_moving"]
    areas = qc.read_surface(made / "rh.pial").vertex_areas.astype(np.float32)
    qc.write_values(tmp_path / name, areas)
    words = "transfer", registered / "registration.npz", tmp_path / name, "--to", "control", *options
    run(*words, "--out", tmp_path / "there.npy")
    there, here, said = np.load(tmp_path / "there.npy").sum(), areas[table].sum(), capsys.readouterr().err
    assert (abs(there / here - 1) < 1e-6) == kept == (said != "")
    assert not kept or re.search(rf"{name}: amounts .* their sum on the cortex, {here:.6g}, is kept; --mean", said)


@pytest.mark.parametrize("name", ["lh.rh_on_lh.label.gii", "lh.there.annot"])
def test_whole_labels_go_in_and_come_out(made, registered, tmp_path, name):
    words = made / "rh.aparc.annot", "--to", "control", "--nearest", "--out", tmp_path / name
    run("transfer", registered / "registration.npz", *words)
    found, table = (read_map(tmp_path / name), read_registration(registered / "registration.npz")["table_control"])
    none = -1 if name.endswith("annot") else 0
    assert set(np.delete(found.values, table)) == {none} and {1, 2} <= set(found.values[table].tolist()) <= {none, 1, 2}
    assert found.side == "left" and [found.labels[key][0] for key in (1, 2)] == NAMES[1:]
    np.testing.assert_allclose(found.labels[2][1], np.array([20, 220, 60, 255]) / 255, atol=1e-6)
    if name.endswith("annot"):
        assert [word.decode() for word in nibabel.freesurfer.read_annot(tmp_path / name)[2]] == NAMES


def test_the_registered_surface_lies_in_the_scanner(made, registered):
    """And it does not matter whether the other surface was given in the scanner's coordinates."""
    frame, points = (frame_of(registered / "registered.surf.gii"), np.load(registered / "registration.npz")["points"])
    assert (frame.side, frame.kind, frame.in_scanner) == ("left", "Pial", True)
    shifted = qc.read_surface(registered / "registered.surf.gii").vertices
    np.testing.assert_allclose(shifted, points + GEOMETRY["cras"], atol=1e-5)


def test_a_cut_gifti_knows_its_whole_surface_too(made, cut, tmp_path):
    """But for its faces: `open` writes the numbers into the metadata."""
    words = ("--mask", made / "rh.cortex.label", "--keep", "--out", tmp_path / "rh.pial.open.surf.gii")
    run("open", made / "rh.pial", *words)
    ours, theirs = (read_hemisphere(path) for path in (words[-1], cut / "rh.open.npz"))
    np.testing.assert_array_equal(ours.cut_surface.original_vertices, theirs.cut_surface.original_vertices)
    assert ours.numbering.known and ours.frame.count == 642 and ours.frame.whole is None
    assert ours.frame.kind == theirs.frame.kind == "Pial" and len(theirs.frame.whole) == len(BALL.faces)


@pytest.fixture(scope="module")
def spoilt(made, cut, tmp_path_factory):
    """The cut pair in metres; rh with three vertices in no face before it, lh with a doubled seam behind it."""
    folder = tmp_path_factory.mktemp("spoilt")
    moving, control = (qc.read_surface(cut / f"{side}.open.npz") for side in ("rh", "lh"))
    np.savez(
        folder / "rh.npz", vertices=np.vstack([np.full((3, 3), 70), moving.vertices]) / 1e3, faces=moving.faces + 3
    )
    side = control.vertices[control.faces].mean(axis=1)[:, 0] > 0
    vertices, faces, _ = with_seam(control.vertices, control.faces, side)
    np.savez(folder / "lh.npz", vertices=vertices / 1e3, faces=faces)
    landmarks = json.loads((cut / "landmarks.json").read_text())
    for curve in landmarks["curves"]:
        curve["moving"] = [vertex + 3 for vertex in curve["moving"]]
    (folder / "landmarks.json").write_text(json.dumps(landmarks))
    return folder


def test_metres_unused_vertices_and_seams_are_read_as_the_pair_that_they_are(cut, spoilt, tmp_path, capsys):
    """Landmarks and maps have the numbers of the files."""
    register = "register", spoilt / "rh.npz", spoilt / "lh.npz", "--out", tmp_path / "out"
    assert re.search(r"lh.npz: points doubled along a seam.*--merge", refused(capsys, tmp_path, *register))
    words = "--merge", "--units", "m", "--mirror", "--hold-out", "none", "--landmarks", spoilt / "landmarks.json"
    assert "no curve is called 'none'" in refused(capsys, tmp_path, *register, *words)
    given = {name: read_hemisphere(spoilt / f"{side}.npz", None, "m", True) for name, side in SIDES.items()}
    own = {name: read_hemisphere(cut / f"{side}.open.npz") for name, side in SIDES.items()}
    for name, first in (("moving", 3), ("control", 0)):
        one, count = given[name], len(own[name].cut_surface.vertices)
        np.testing.assert_allclose(one.cut_surface.vertices, own[name].cut_surface.vertices, rtol=1e-12)
        np.testing.assert_array_equal(one.cut_surface.faces, own[name].cut_surface.faces)
        np.testing.assert_array_equal(one.cut_surface.original_vertices, first + np.arange(count))
        values = np.arange(len(one.given.vertices))
        np.testing.assert_array_equal(one.numbering.on_cut_surface(values, "values"), first + np.arange(count))
    ours, theirs = (json.loads((folder / "landmarks.json").read_text())["curves"] for folder in (spoilt, cut))
    for one, other in zip(on_cut_surfaces({"curves": ours}, given)["curves"], theirs, strict=True):
        assert {name: one[name] for name in SIDES} == {name: other[name] for name in SIDES}


def test_units_that_are_none_are_refused_and_those_of_another_surface_do_not_matter(made):
    with pytest.raises(qc.SurfaceError, match="units = 'cm': give one of mm, m, um"):
        qc.read_surface(made / "rh.pial", units="cm")
    usual, told = (qc.read_surface(made / "rh.pial", units=units) for units in ("mm", "m"))
    np.testing.assert_array_equal(usual.vertices, told.vertices)


def test_open_merges_and_scales(made, cut, tmp_path):
    whole = qc.read_surface(made / "rh.pial")
    soup = 1e3 * whole.vertices[whole.faces].reshape(-1, 3)
    np.savez(tmp_path / "rh.soup.npz", vertices=soup, faces=np.arange(len(soup)).reshape(-1, 3))
    cortex = ~qc.read_mask(made / "rh.cortex.label", whole, keep=True)
    np.savetxt(tmp_path / "rh.cortex.txt", cortex[whole.faces].ravel(), fmt="%d")
    words = "--mask", tmp_path / "rh.cortex.txt", "--keep", "--merge", "--units", "um", "--out", tmp_path / "x.npz"
    run("open", tmp_path / "rh.soup.npz", *words)
    found, expected = qc.read_surface(tmp_path / "x.npz"), qc.read_surface(cut / "rh.open.npz")
    np.testing.assert_allclose(found.vertices, soup[found.original_vertices] / 1e3)
    assert len(found.faces) == len(expected.faces) and found.area == pytest.approx(expected.area)


@pytest.fixture(scope="module")
def in_mm(cut):
    """The cut pair, its landmarks and the report of their registration."""
    pair = qc.mirror(qc.read_surface(cut / "rh.open.npz")), qc.read_surface(cut / "lh.open.npz")
    landmarks = json.loads((cut / "landmarks.json").read_text())
    return *pair, landmarks, qc.register(*pair, landmarks, features=None).report


@pytest.mark.parametrize("scale, unit", [(1e-3, "m"), (0.02, None)])
def test_sizes_of_no_hemisphere_are_suspect_or_relative(in_mm, scale, unit):
    """Lengths in mm, and so what is suspect besides, do not depend on the unit."""
    moving, control, landmarks, usual = in_mm
    other = qc.Surface(scale * control.vertices, control.faces)
    found = qc.register(moving, other, landmarks, features=None).report
    units = [reason for reason in found["suspect"] if reason.startswith("units: the control surface")]
    assert [f"--units {unit}" in reason for reason in units] == ([True] if unit else [])
    mm = scale if unit else scale * np.ptp(control.vertices, axis=0).max() / 165
    assert found["landmark_error_mm"] == pytest.approx(usual["landmark_error_mm"] * scale / mm, rel=1e-3)
    assert (found["units"] is None) == bool(unit) and usual["units"] is None


def test_only_the_cortex_is_checked_where_a_label_names_it(made, tmp_path):
    vertices, faces = nibabel.freesurfer.read_geometry(made / "lh.pial")
    cortex = ~qc.read_mask(made / "lh.cortex.label", qc.read_surface(made / "lh.pial"), keep=True)
    vertices[~cortex] = np.nan
    nibabel.freesurfer.write_geometry(tmp_path / "lh.pial", vertices, faces)
    ours, theirs = (read_hemisphere(folder / "lh.pial", made / "lh.cortex.label") for folder in (tmp_path, made))
    np.testing.assert_array_equal(ours.cut_surface.faces, theirs.cut_surface.faces)
    np.testing.assert_array_equal(ours.cut_surface.original_vertices, theirs.cut_surface.original_vertices)
    assert ours.numbering.count == 642 and ours.is_whole


def test_vertices_on_the_rim_of_a_label_may_go(made, tmp_path, capsys):
    """As in FreeSurfer's labels: those that hang on by an edge are no piece, and take no part."""
    whole = qc.read_surface(made / "lh.pial")
    cortex = ~qc.read_mask(made / "lh.cortex.label", whole, keep=True)
    disk = read_hemisphere(made / "lh.pial", made / "lh.cortex.label").cut_surface
    ends = whole.edges[cortex[whole.edges].sum(axis=1) == 1]
    hanging = ends[~cortex[ends]][:1]  # a vertex of the wall beside the cortex
    around = whole.edges[(whole.edges == hanging).any(axis=1)]
    drop = np.setdiff1d(around[cortex[around].any(axis=1)].ravel(), hanging)[1:]
    cortex[hanging], cortex[drop] = True, False
    label(tmp_path / "lh.x.label", np.flatnonzero(cortex))
    found = read_hemisphere(made / "lh.pial", tmp_path / "lh.x.label").cut_surface
    run("open", made / "lh.pial", "--mask", tmp_path / "lh.x.label", "--keep", "--out", tmp_path / "x.npz")
    assert re.search(r"\d+ vertices outside the mask go: they lie apart", capsys.readouterr().out)
    assert hanging[0] not in found.original_vertices and len(found.vertices) < len(disk.vertices)


@pytest.fixture(scope="module")
def bad(made, tmp_path_factory):
    """A folder of what does not fit the whole surfaces; where its map is not finite, which landmark is on the wall."""
    folder = tmp_path_factory.mktemp("bad")
    left, right = (qc.read_surface(made / f"{side}.pial") for side in ("lh", "rh"))
    cortex = ~qc.read_mask(made / "lh.cortex.label", left, keep=True)
    label(folder / "lh.pieces.label", np.flatnonzero(abs(left.vertices[:, 0]) > 10))  # two caps
    label(folder / "lh.hole.label", np.flatnonzero(cortex & (left.vertices[:, 2] < 45)))
    np.save(folder / "other.npy", np.zeros(700))
    sulc = qc.read_values(made / "rh.sulc")
    vertex, wall = int(np.flatnonzero(np.isfinite(sulc))[-1]), int(right.vertices[:, 2].argmin())
    sulc[vertex] = np.nan
    np.save(folder / "rh.bad.npy", sulc)
    landmarks = json.loads((made / "landmarks.json").read_text())
    landmarks["curves"][0]["moving"][0] = wall
    (folder / "landmarks.json").write_text(json.dumps(landmarks))
    torus = qc.Surface(*torus_mesh())
    qc.write_surface(folder / "lh.torus", torus)
    label(folder / "lh.torus.label", np.flatnonzero(torus.vertices[:, 0] < 3.5))
    return folder, vertex, wall


PAIR = "register {made}/rh.pial {made}/lh.pial --cortex {made}/rh.cortex.label --mirror --control-cortex "
WHOLE = PAIR + "{made}/lh.cortex.label "
CARRY = "transfer {out}/registration.npz {made}/rh.aparc.annot --to control "


@pytest.mark.parametrize("words, message", [
    (PAIR + "{bad}/lh.pieces.label", "lh.pieces.label: is in pieces: .*repair the label"),
    (PAIR + "{bad}/lh.hole.label", "lh.hole.label: has holes of .*repair the label"),
    (PAIR + "{made}/rh.cortex.label", "rh.cortex.label: is of the right hemisphere, .*lh.pial of the left one"),
    (WHOLE + "--feature {bad}/rh.bad.npy {made}/lh.sulc", r"rh.bad.npy: not finite on the cortex .*\[{vertex}\]"),
    (WHOLE + "--landmarks {bad}/landmarks.json", r"'one', moving side: .*\[{wall}\] lie on the medial wall"),
    ("register {made}/rh.pial {made}/lh.pial", "closed .*--cortex"),
    ("register {cut}/rh.open.npz {made}/lh.pial --cortex {made}/rh.cortex.label", "rh.open.npz is open already"),
    ("register {cut}/rh.open.npz fsaverage5:left --control-cortex {made}/lh.cortex.label", "its own medial wall"),
    ("register {bad}/lh.torus fsaverage5:left --cortex {bad}/lh.torus.label", "1 handle .*mris_fix_topology"),
    ("open {made}/lh.pial --mask {made}/rh.cortex.label --keep", "is of the right hemisphere, .* of the left one"),
    (CARRY.replace("rh.aparc.annot", "lh.sulc"), "is of the left hemisphere, the moving surface of the right"),
    (CARRY.replace("{made}/rh.aparc.annot", "{bad}/other.npy"), r"700 values for \d+ vertices .*, 642 before"),
    (CARRY + "--nearest --wall nan", "--wall nan: labels"),
])  # fmt: skip
def test_what_does_not_fit_is_one_line(made, registered, cut, bad, tmp_path, capsys, words, message):
    folder, vertex, wall = bad
    words = words.format(made=made, cut=cut, bad=folder, out=registered).split()
    out = {"register": "out", "open": "x.npz", "transfer": "x.npy"}[words[0]]
    line = refused(capsys, tmp_path, *words, "--out", tmp_path / out)
    assert re.search(message.replace("{vertex}", str(vertex)).replace("{wall}", str(wall)), line)


def test_another_cortex_beside_a_map_stays(made, registered, tmp_path, capsys):
    (tmp_path / "cortex.shape.gii").write_bytes((registered / "registered.surf.gii").read_bytes()[:50])
    words = "transfer", registered / "registration.npz", made / "rh.sulc", "--to", "control"
    assert "cortex.shape.gii" in refused(capsys, tmp_path, *words, "--out", tmp_path / "there.npy")
