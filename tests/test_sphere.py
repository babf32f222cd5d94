"""The registered hemisphere on the control's sphere: sound in files, as Workbench finds, or refused."""

import nibabel
import numpy as np
import pytest

import qclearn as qc
from commands import BALL, everything, made, refused, run  # noqa: F401 (made: a fixture)
from qclearn.io import sphere as spheres
from qclearn.io.frames import Frame
from qclearn.io.fsaverage import whole_fsaverage5
from qclearn.io.hemisphere import read_hemisphere
from qclearn.io.mapfile import side_arrays, write_registration
from qclearn.io.sphere import RINGS, registered_sphere, unit_sphere, untangled
from qclearn.plane.grids import polar_disk
from qclearn.registration.report import distortion_maps
from qclearn.surfaces.conformal import apply_mobius, parameterize
from qclearn.surfaces.surface import Mesh
from workbench import unknown, workbench

FILES = ["ArealDistortion.shape.gii", "ShapeDistortion.shape.gii", "sphere.reg", "sphere.reg.surf.gii"]


@pytest.fixture(scope="module")
def maps():
    """fsaverage5's right hemisphere, mirrored, on its left one: conformal maps and the best Möbius map by landmarks."""
    sides = {side: read_hemisphere(f"fsaverage5:{name}") for side, name in (("moving", "right"), ("control", "left"))}
    disks = {"moving": qc.mirror(sides["moving"].cut_surface), "control": sides["control"].cut_surface}
    laid = {side: parameterize(disk) for side, disk in disks.items()}
    z = {side: one.disk.z for side, one in laid.items()}
    ends = (z[side][[vertex for curve in qc.demo_landmarks()["curves"] for vertex in curve[side]]] for side in laid)
    mapped = apply_mobius(laid["moving"], qc.best_mobius(*ends)).disk.z
    arrays = {"disk_moving": z["moving"], "disk_map": mapped, "disk_control": z["control"], "mirrored": np.array(True)}
    for side, disk in disks.items():
        arrays |= {f"faces_{side}": disk.faces} | side_arrays(side, disk, sides[side].frame)
    return arrays | {"points": qc.transfer(disks["control"].vertices, z["control"], disks["control"].faces, mapped)}


@pytest.fixture(scope="module")
def written(maps, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sphere")
    write_registration(folder / "registration.npz", maps)
    run("sphere", folder / "registration.npz", "fsaverage5:left", "--out", folder / "out")
    return folder


def faults(surface):
    """Which faces of a surface on a sphere do not look outward."""
    a, b, c = (surface.vertices[corner] for corner in surface.faces.T)
    return np.flatnonzero(np.einsum("fi,fi->f", a, np.cross(b, c)) <= 0)


# What is made


def test_a_hemisphere_on_itself_has_its_own_sphere(maps):
    """By the identity of the disk: cortex and wall alike, but for what comes too near to the circle beside the rim."""
    own = {f"{name}_moving": maps[f"{name}_control"] for name in ("faces", "table", "whole_faces", "about", "vertices")}
    ball = whole_fsaverage5("left", "sphere")
    laid = registered_sphere(maps | own | {"disk_map": maps["disk_control"]}, ball)
    np.testing.assert_array_equal(laid.surface.faces, ball.faces)
    off = np.linalg.norm(laid.surface.vertices - 100 * unit_sphere(ball, ball.faces), axis=1)
    assert (off > 3e-5).sum() <= 2 and off.max() < 0.01
    assert not len(laid.moved)


def test_the_files_hold_a_sound_sphere(maps, written, monkeypatch):
    """Which without untangling has faces that are flipped."""
    assert everything(written / "out") == FILES
    right, ball = whole_fsaverage5("right", "pial"), whole_fsaverage5("left", "sphere")
    for name in ("sphere.reg", "sphere.reg.surf.gii"):
        found = qc.read_surface(written / "out" / name)
        np.testing.assert_array_equal(found.faces, right.faces[:, ::-1])  # of the mirrored one
        assert not len(faults(found)) and found.face_areas.min() >= spheres.LEAST_AREA
        assert found.edge_lengths.min() >= spheres.LEAST_EDGE
        np.testing.assert_allclose(np.linalg.norm(found.vertices, axis=1), 100, atol=2e-5)
    laid = registered_sphere(maps, ball)
    np.testing.assert_array_equal(found.vertices, laid.surface.vertices)
    rings = laid.rings[laid.moved]
    assert 0 < (rings > 0).sum() <= 0.005 * (laid.rings > 0).sum() and rings.max() <= RINGS
    monkeypatch.setattr(spheres, "untangled", lambda vertices, faces, rings: (spheres.stored(vertices), []))
    assert len(faults(registered_sphere(maps, ball).surface)) > 2


def test_a_vertex_out_of_its_star_comes_back_and_nothing_else_moves(monkeypatch):
    """And a tangle without an end is an error."""
    p, rank = spheres.stored(BALL.vertices), np.full(len(BALL.vertices), 4)
    assert not len(untangled(p, BALL.faces, np.zeros(len(p), int))[1])
    p[7], rank[7] = spheres.stored(-p[[7]] + 200 * p[[30]])[0], 0
    mended, gone = untangled(p, BALL.faces, rank)
    assert 7 in gone and len(gone) < 20 and not spheres.too_small(mended, BALL.faces).any()
    monkeypatch.setattr(spheres, "ROUNDS", 1)
    with pytest.raises(spheres.UntanglingError, match="faces of the sphere stay flipped"):
        untangled(BALL.vertices * [1, 1, -1], BALL.faces, np.zeros(len(p), int))


def test_points_are_drawn_into_the_rims_polygon_in_their_order():
    rim = np.exp(1j * np.array([0.1, 1.0, 2.5, 4.0, 5.2]))
    angle = np.linspace(-np.pi, np.pi, 400)
    drawn = [spheres.drawn_in(size * np.exp(1j * angle), rim) for size in (0.05, 0.6, 0.9, 0.99, 1.0)]
    assert (np.diff(abs(np.array(drawn)), axis=0) > 0).all()
    sides = np.roll(rim, -1) - rim
    height = ((sides.conj() / abs(sides)) * (drawn[-1][:, None] - rim)).imag.min(1)
    np.testing.assert_allclose(height, 0, atol=1e-12)  # the circle goes to the polygon
    near = np.abs(np.angle(np.exp(1j * angle)[:, None] / rim)).min(1) < 0.02
    np.testing.assert_allclose(drawn[2][near], 0.9 * np.exp(1j * angle[near]))


@pytest.mark.parametrize("scale, areal, shape", [((2, 1, 1), 1, 1), ((0.5, 0.5, 1), -2, 0), ((1, -3, 1), 1.585, 1.585)])
def test_distortion_of_a_stretch(scale, areal, shape):
    z, faces = polar_disk(4, 9)
    flat = np.stack([z.real, z.imag, 0 * z.real], 1)
    found = distortion_maps(flat, faces, flat * scale)
    np.testing.assert_allclose(found, np.multiply.outer([areal, shape], np.ones(len(z))), atol=2e-3)


# Workbench


@pytest.fixture(scope="module")
def judged(maps, written):
    """The folder, with the control's sphere, places on both surfaces, and parcels for Workbench."""
    frame = Frame("left", kind="Spherical")
    qc.write_surface(written / "control.surf.gii", whole_fsaverage5("left", "sphere"), frame=frame)
    for side, name in (("moving", "right"), ("control", "left")):
        places = whole_fsaverage5(name, "pial").vertices
        qc.write_values(written / f"{side}.func.gii", places, "left")
        qc.write_values(written / f"{side}.label.gii", (places[:, 1] // 20 + 10).astype(np.int32), "left")
    return written


def resampled(folder, what, source, *more):
    """Values that Workbench carries from the side `source` to the other one, of the whole surface there."""
    at = {"moving": folder / "out/sphere.reg.surf.gii", "control": folder / "control.surf.gii"}
    target = "control" if source == "moving" else "moving"
    out = folder / f"to_{target}.{what}.gii"
    kind = {"func": "-metric-resample", "label": "-label-resample"}[what]
    workbench(kind, folder / f"{source}.{what}.gii", at[source], at[target], "BARYCENTRIC", out, *more)
    return qc.read_values(out)


@pytest.mark.parametrize("source, mean, most", [("control", 0.01, 0.01), ("moving", 0.25, 1.0)])
def test_workbench_carries_places_as_transfer_does(maps, judged, source, mean, most):
    target = "control" if source == "moving" else "moving"
    disk = {"moving": maps["disk_map"], "control": maps["disk_control"]}
    places = qc.read_values(judged / f"{source}.func.gii")[maps[f"table_{source}"]]
    wanted = qc.transfer(places, disk[source], maps[f"faces_{source}"], disk[target])
    found = resampled(judged, "func", source)[maps[f"table_{target}"]]
    whole = spheres.whole_of(maps, target)
    inner = whole.rings[whole.table] > RINGS
    off = np.linalg.norm(found - wanted, axis=1)[inner]
    assert off.mean() < mean and np.percentile(off, 99) < most and inner.sum() > 8500


def test_workbench_carries_parcels_as_transfer_does(maps, judged):
    labels = qc.read_values(judged / "control.label.gii")[maps["table_control"]]
    wanted = qc.transfer(labels, maps["disk_control"], maps["faces_control"], maps["disk_map"], nearest=True)
    found = resampled(judged, "label", "control", "-largest")[maps["table_moving"]]
    assert (found != wanted).mean() <= 1e-3 and len(np.unique(wanted)) > 5


def test_workbench_takes_the_sphere_there_and_back_and_knows_the_files(judged):
    own, control, out = (judged / "out/sphere.reg.surf.gii", judged / "control.surf.gii", judged / "back.surf.gii")
    workbench("-surface-sphere-project-unproject", own, control, control, out)
    np.testing.assert_allclose(qc.read_surface(out).vertices, qc.read_surface(own).vertices, atol=1e-3)
    for name in FILES[:2] + FILES[3:]:
        told = workbench("-file-information", judged / "out" / name)
        assert unknown(told) == (["Surface Type (Secondary)"] if "surf" in name else [])
        structure = "CortexLeft" if "surf" in name else "CortexRight"
        assert structure in told and (name.split(".")[0] in told)


def test_workbench_finds_the_same_distortion(maps, judged):
    frame = Frame("right", kind="Pial")
    for name, vertices in (("here", maps["vertices_moving"]), ("there", maps["points"])):
        qc.write_surface(judged / f"{name}.surf.gii", Mesh(vertices, maps["faces_moving"]), frame=frame)
    ends = judged / "here.surf.gii", judged / "there.surf.gii"
    workbench("-surface-distortion", *ends, judged / "area.func.gii")
    workbench("-surface-distortion", *ends, judged / "affine.func.gii", "-local-affine-method", "-log2")
    areal, shape = (qc.read_values(judged / "out" / name) for name in FILES[:2])
    table = maps["table_moving"]
    np.testing.assert_allclose(areal[table], qc.read_values(judged / "area.func.gii"), atol=1e-3)
    np.testing.assert_allclose(shape[table], qc.read_values(judged / "affine.func.gii")[:, 1], atol=1e-3)
    wall = np.setdiff1d(np.arange(len(areal)), table)
    assert not areal[wall].any() and not shape[wall].any() and areal[table].std() > 0.1


# What is refused, and what is taken


def bulged(vertices):
    return vertices * (1 + 0.1 * vertices[:, :1])


@pytest.mark.parametrize("vertices, faces, fault", [
    (bulged(BALL.vertices), BALL.faces, "not a sphere: its vertices lie 0.9 to 1.1 from 0; .*lh.inflated is none"),
    (BALL.vertices + [0.5, 0, 0], BALL.faces, r"a sphere around \(0.5, 0.0, 0.0\), .* one around 0"),
    (BALL.vertices, BALL.faces[:, ::-1], "looks inward"),
    (BALL.vertices * [-1, 1, 1], BALL.faces, "looks inward: .*mirrored"),
    (BALL.vertices * [-1, 1, 1], BALL.faces[:, ::-1], "the other way round .* other hemisphere"),
    (BALL.vertices[::-1], 641 - BALL.faces, "its faces are not the control's: .* another subject"),
])  # fmt: skip
def test_what_is_not_the_controls_sphere(vertices, faces, fault):
    with pytest.raises(qc.SurfaceError, match=fault):
        unit_sphere(qc.Surface(vertices, faces), BALL.faces)


def test_a_sphere_of_any_radius_is_taken_but_none_of_other_counts(maps):
    for radius in (1, 100):
        scaled = qc.Surface(radius * BALL.vertices, BALL.faces)
        np.testing.assert_allclose(unit_sphere(scaled, BALL.faces), BALL.vertices, atol=1e-6)
    ball = whole_fsaverage5("left", "sphere")
    with pytest.raises(qc.SurfaceError, match="642 vertices and 1280 faces, where the control has 10242 and 20480"):
        unit_sphere(BALL, ball.faces)
    with pytest.raises(qc.SurfaceError, match="10242 vertices, 20479 faces.*boundary or handles"):
        registered_sphere(maps | {"whole_faces_moving": maps["whole_faces_moving"][:-1]}, ball)


def test_the_command_refuses_in_one_line(written, tmp_path, capsys, maps):
    words = ("sphere", written / "registration.npz")
    assert "right hemisphere" in refused(capsys, tmp_path, *words, "fsaverage5:right", "--out", tmp_path / "x")
    inflated = tmp_path / "lh.inflated"
    qc.write_surface(inflated, whole_fsaverage5("left", "inflated"))
    assert "lh.inflated: not a sphere" in refused(capsys, tmp_path, *words, inflated, "--out", tmp_path / "x")
    cut = {name: array for name, array in maps.items() if name not in ("table_control", "whole_faces_control")}
    write_registration(tmp_path / "cut.npz", cut)
    words = ("sphere", tmp_path / "cut.npz", "fsaverage5:left", "--out", tmp_path / "x")
    assert "cut.npz: the whole control surface is not known" in refused(capsys, tmp_path, *words)


def test_register_writes_the_sphere_and_refuses_a_wrong_one_first(made, tmp_path, capsys):
    """And a later `sphere` into its folder leaves what is there."""
    control = qc.read_surface(made / "lh.pial")
    ball = qc.Surface(control.vertices / np.linalg.norm(control.vertices, axis=1, keepdims=True), control.faces)
    nibabel.freesurfer.write_geometry(tmp_path / "lh.sphere", ball.vertices, ball.faces)
    nibabel.freesurfer.write_geometry(tmp_path / "lh.inflated", bulged(ball.vertices), ball.faces)
    words = ["register", made / "lh.pial", made / "lh.pial", "--cortex", made / "lh.cortex.label"]
    words += ["--control-cortex", made / "lh.cortex.label", "--no-landmarks", "--accept-suspect"]
    out = tmp_path / "out"
    line = refused(capsys, tmp_path, *words, "--sphere", tmp_path / "lh.inflated", "--out", out)
    assert "lh.inflated: not a sphere" in line
    words = [*map(str, words), "--sphere", tmp_path / "lh.sphere", "--out", out]
    run(*words)
    assert "sphere          642 vertices on the control's sphere" in capsys.readouterr().out
    assert set(FILES) < set(everything(out))
    found = qc.read_surface(out / "sphere.reg")
    assert np.linalg.norm(found.vertices - 100 * ball.vertices, axis=1).mean() < 1
    before = everything(out)
    run("sphere", out / "registration.npz", tmp_path / "lh.sphere", "--out", out)
    assert everything(out) == before
