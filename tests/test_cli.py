"""The command line: what it writes, and that bad input is one line on stderr, exit code 2 and
nothing written."""

import ast
import json
import re
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import click
import nibabel
import numpy as np
import pytest

import meshes
from book.builder.references import chapters, markdown_of
from known_surfaces import sphere
from qclearn import read_values
from qclearn.cli import cli, main
from qclearn.io.fsaverage import fsaverage5, whole_fsaverage5
from qclearn.io.mapfile import frame_of_side, read_registration
from qclearn.io.meshes import read_surface, write_surface
from qclearn.io.values import write_values
from qclearn.plane.beltrami import solve_beltrami_disk
from qclearn.plane.grids import polar_disk
from qclearn.registration import diagnose
from qclearn.registration.curves import detect_curves, read_landmarks
from qclearn.registration.problem import LandmarkError
from qclearn.registration.register import register
from qclearn.surfaces import units
from qclearn.surfaces.surface import Surface, SurfaceError, mirror, require_disk, require_outward
from reports import REPORT

ROOT = Path(__file__).resolve().parent.parent

FILES = ["figure.png", "registered.surf.gii", "registration.npz", "report.json"]
ADDED = {"inputs", "landmarks", "versions", "command"}  # by the command line


def run(*arguments):
    main([str(argument) for argument in arguments])


def to_register(folder, *options, out="out"):
    """The words that register the two bowls of a folder, which have no folds."""
    surfaces = folder / "moving.npz", folder / "control.npz"
    return ["register", "--no-features", *surfaces, "--out", folder / out, *options]


def to_transfer(folder, registration, values, to, out, *options):
    """The words that carry a map over by the files of a folder."""
    return ["transfer", folder / registration, folder / values, "--to", to, "--out", folder / out, *options]


def everything(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def refused(capsys, folder, *arguments):
    """The one line that a refused command prints; nothing else may be printed or written.

    Before it, a slow machine shows a bar of progress, which ends by a return to the beginning of
    its line.
    """
    before = everything(folder)
    capsys.readouterr()
    with pytest.raises(SystemExit) as stop:
        run(*arguments)
    output = capsys.readouterr()
    assert stop.value.code == 2
    line = output.err.rpartition("\r")[2]
    assert output.out == "" and output.err.count("\n") == 1 and line.startswith("qclearn: ")
    assert everything(folder) == before
    return line


SPOKES = {name: np.arange(1 + start, 1 + start + 24 * 6, 24) for name, start in (("east", 0), ("north", 6))}
bowl = partial(meshes.bowl, lean=0.4, curves=SPOKES)


CURVES = {
    "curves": [
        {"name": "east", "moving": list(range(1, 145, 24)), "control": list(range(2, 146, 24))},
        {"name": "north", "moving": list(range(7, 151, 24)), "control": list(range(6, 150, 24))},
    ]
}


def backwards():
    """The bowls' landmarks and a third spoke, which runs from its other end on one side."""
    third = {"name": "south", "moving": list(range(13, 157, 24)), "control": list(range(13, 157, 24))[::-1]}
    return {"curves": [*CURVES["curves"], third]}


@pytest.fixture
def folder(tmp_path, plain_figure):
    """A folder with two bowls that carry curves, one without, and a landmarks file."""
    write_surface(tmp_path / "moving.npz", bowl(0.6))
    write_surface(tmp_path / "control.npz", bowl(0.9))
    write_surface(tmp_path / "plain.ply", bowl(0.9))
    (tmp_path / "landmarks.json").write_text(json.dumps(CURVES))
    return tmp_path


# On real cortex


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo") / "new" / "qclearn-demo"
    run("demo", "--out", out)
    return out


def test_the_demo_registers_real_cortex(demo):
    report = json.loads((demo / "report.json").read_text())
    assert report["bijective"] is True and report["flipped"] == 0
    assert report["landmark_error"] < report["landmark_error_before"] / 4
    assert report["landmark_error_before"] > 0.01 and report["max_abs_mu"] < 0.8
    assert len(report["curves"]) == 6 and set(report) >= REPORT | ADDED and report["suspect"] == []
    assert len(report["held_out_mm"]) == 5 and min(min(row) for row in report["held_out_mm"].values()) > 0
    first, *_, figure, write, total = seconds = report["seconds"]
    assert (first, figure, write, total) == ("read", "figure", "write", "total") and min(seconds.values()) >= 0
    assert 0.95 * seconds["total"] < sum(seconds.values()) - seconds["total"] <= 1.001 * seconds["total"]


def test_the_demo_writes_four_files_that_belong_together(demo):
    assert everything(demo) == FILES and everything(demo.parent) == ["qclearn-demo"] + [
        f"qclearn-demo/{f}" for f in FILES
    ]
    assert (demo / "figure.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    maps, moving = np.load(demo / "registration.npz"), mirror(fsaverage5("right"))
    points, triangles = (array.data for array in nibabel.load(demo / "registered.surf.gii").darrays)
    np.testing.assert_array_equal(triangles, moving.faces)
    np.testing.assert_allclose(points, maps["points"], atol=1e-4)
    require_outward(read_surface(demo / "registered.surf.gii"))
    assert {"points", "disk_moving", "disk_control", "disk_map", "mu"} <= set(maps.files)
    assert maps["disk_map"].shape == maps["disk_moving"].shape == (len(moving.vertices),)
    assert maps["disk_control"].shape == (len(fsaverage5("left").vertices),) and maps["mu"].shape == (
        len(moving.faces),
    )


def test_the_registration_alone_knows_both_surfaces_and_their_files(demo):
    """With a mirrored moving surface: numbers, sides and faces of the whole one are those of its
    file."""
    arrays = read_registration(demo / "registration.npz")
    for side, name in (("moving", "right"), ("control", "left")):
        surface, whole = fsaverage5(name), whole_fsaverage5(name)
        expected = mirror(surface) if side == "moving" else surface
        np.testing.assert_array_equal(arrays[f"vertices_{side}"], expected.vertices.astype(np.float32))
        np.testing.assert_array_equal(arrays[f"table_{side}"], surface.original_vertices)
        np.testing.assert_array_equal(arrays[f"whole_faces_{side}"], whole.faces)
        frame = frame_of_side(arrays, side)
        assert (frame.side, frame.kind, frame.count) == (name, "Pial", 10242)
        numbers = np.where(side == "moving", arrays[f"faces_{side}"][:, ::-1], arrays[f"faces_{side}"])
        kept = set(map(tuple, arrays[f"table_{side}"][numbers].tolist()))
        assert kept < set(map(tuple, whole.faces.tolist()))
    assert arrays["mirrored"]


def test_maps_are_carried_over_on_real_cortex(demo, tmp_path):
    """The control's coordinates arrive at the moving vertices as `points`; and a map goes there and
    back."""
    control, maps = fsaverage5("left"), np.load(demo / "registration.npz")
    np.save(tmp_path / "height.npy", control.vertices[:, 2])
    run(*to_transfer(tmp_path, demo / "registration.npz", "height.npy", "moving", "there.npy", "--wall", "cut"))
    there = np.load(tmp_path / "there.npy")
    np.testing.assert_allclose(there, maps["points"][:, 2], atol=1e-9)
    run(*to_transfer(tmp_path, demo / "registration.npz", "there.npy", "control", "back.npy"))
    whole = np.load(tmp_path / "back.npy")
    off = abs(whole[control.original_vertices] - control.vertices[:, 2])
    assert len(whole) == 10242 and np.median(off) < 0.3 and off.max() < 15  # mm; edges are 4 mm long


def test_a_closed_hemisphere_gets_in(tmp_path, capsys):
    """The closed fsaverage5 and its thickness, from files, are the surface that the library opens
    itself."""
    import nilearn.datasets

    paths = nilearn.datasets.fetch_surf_fsaverage("fsaverage5")
    out = tmp_path / "open.npz"
    run("open", paths["pial_left"], "--mask", paths["thick_left"], "--keep", "--out", out)
    assert re.search(r"open.npz: 99\d\d of 10242 vertices", capsys.readouterr().out)
    opened, expected = read_surface(out), fsaverage5("left", wall="thickness")
    np.testing.assert_array_equal(opened.vertices, expected.vertices)
    np.testing.assert_array_equal(opened.faces, expected.faces)
    require_disk(opened)
    closed = read_surface(paths["pial_left"])
    np.testing.assert_array_equal(closed.vertices[np.load(out)["original_vertices"]], opened.vertices)


# On small surfaces


def test_register_is_the_library_and_mirror_mirrors(folder, capsys):
    out = folder / "out"
    run(
        *to_register(folder, "--landmarks", folder / "landmarks.json", "--mirror"),
        "--alpha",
        2,
        "--beta",
        0.1,
        "--gamma",
        1e2,
        "--sliding",
    )
    expected = register(
        mirror(bowl(0.6)), bowl(0.9), CURVES, alpha=2.0, beta=0.1, gamma=1e2, sliding=True, features=None
    )
    np.testing.assert_allclose(np.load(out / "registration.npz")["points"], expected.points, atol=1e-9)
    report = json.loads((out / "report.json").read_text())
    assert [report[key] for key in ("method", "alpha", "beta", "gamma")] == ["exact", 2.0, 0.1, 1e2]
    assert report["landmark_error"] == pytest.approx(expected.report["landmark_error"])
    printed = capsys.readouterr().out
    assert "bijective       yes" in printed and f"written to      {out}" in printed


@pytest.mark.parametrize("options, code", [([], 3), (["--accept-suspect"], 0)])
def test_a_suspect_registration_is_written_and_says_so(folder, capsys, options, code):
    (folder / "backwards.json").write_text(json.dumps(backwards()))
    with pytest.raises(SystemExit) as stop:
        run(*to_register(folder, "--landmarks", folder / "backwards.json"), *options)
    output = capsys.readouterr()
    assert stop.value.code == code and everything(folder / "out") == FILES
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["suspect"][0].startswith("reversed: 'south' fits") and report["bijective"] is True
    # A slow machine shows a bar of progress first.
    assert output.err.splitlines()[-1] == f"qclearn: suspect: {'; '.join(report['suspect'])}"
    assert re.search(r"suspect +reversed", output.out)


@pytest.mark.parametrize("names, options", [(("rh.a.npz", "lh.b.npz"), []), (("lh.a.npz", "lh.b.npz"), ["--mirror"])])
def test_hemispheres_that_the_files_name_go_with_mirror(folder, capsys, names, options):
    for side, name in zip(("moving", "control"), names):
        (folder / f"{side}.npz").rename(folder / name)
    surfaces = [folder / name for name in names]
    arguments = ["register", "--no-features", *surfaces, "--landmarks", folder / "landmarks.json", "--gamma", 1e2]
    run(*arguments, "--out", folder / "good", *([] if options else ["--mirror"]))
    with pytest.raises(SystemExit) as stop:
        run(*arguments, "--out", folder / "out", *options)
    line = capsys.readouterr().err.splitlines()[-1]
    assert stop.value.code == 3 and line.count("mirror: ") == 1 and str(surfaces[0]) in line
    assert json.loads((folder / "good" / "report.json").read_text())["suspect"] == []
    (reason,) = json.loads((folder / "out" / "report.json").read_text())["suspect"]
    assert reason.startswith("mirror: ") and "by their names or metadata" in reason


def test_the_report_says_where_it_comes_from_and_holds_the_landmarks(folder, capsys):
    arguments = to_register(folder, "--landmarks", folder / "landmarks.json", "--mirror", "--gamma", 1e2)
    run(*arguments)
    report = json.loads((folder / "out" / "report.json").read_text())
    read = {side: read_surface(folder / f"{side}.npz") for side in ("moving", "control")}
    assert report["inputs"] == {side: {"path": str(folder / f"{side}.npz")} | read[side].fingerprint for side in read}
    assert report["landmarks"]["curves"] == CURVES["curves"] and report["suspect"] == []
    assert report["command"] == ["qclearn", *map(str, arguments)]
    assert report["versions"]["numpy"] == np.__version__ and {"python", "scipy", "qclearn"} <= set(report["versions"])
    # which are a landmarks file, for these surfaces, mirrored or not, and for no others
    (folder / "again.json").write_text(json.dumps(report["landmarks"]))
    run(*[folder / "again.json" if word == folder / "landmarks.json" else word for word in arguments])
    exchanged = [arguments[0], folder / "control.npz", folder / "moving.npz", "--landmarks", folder / "again.json"]
    line = refused(capsys, folder, *exchanged, "--out", folder / "other")
    assert re.search("landmarks were made for another moving surface .*exchanged: they fit the control surface", line)


def words_of_reasons():
    """The words that messages of diagnose.py and units.py begin with; `walls:` is a fallback, no
    reason to be suspect."""
    texts = [
        node.value
        for module in (diagnose, units)
        for node in ast.walk(ast.parse(Path(module.__file__).read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    words = {found[1] for text in texts if (found := re.match(r"([a-z]+): ", text))}
    assert "walls" in words
    return words - {"walls"}


def test_every_reason_and_exit_code_is_explained_in_the_help(capsys):
    run("register", "--help")
    explained = capsys.readouterr().out
    assert re.search(r"0 +registered\n +2 +refused: .*\n +3 +written, but suspect", explained)
    table = explained.split("A registration is suspect where", 1)[1]
    words = re.findall(r"^ +([a-z]+): {2,}\S", table, re.MULTILINE)
    assert sorted(words) == sorted(words_of_reasons())


@pytest.mark.parametrize("command", sorted(cli.commands))
def test_every_option_has_a_help_text(command):
    options = [one for one in cli.commands[command].params if isinstance(one, click.Option) and not one.hidden]
    assert [one.opts[-1] for one in options if not one.help] == []


def test_features_from_files_and_held_out_curves_reach_the_pipeline(folder, capsys):
    z, _ = polar_disk(8, 24)
    np.save(folder / "moving.sulc.npy", np.cos(6 * z.real) + z.imag)
    (folder / "control.sulc.txt").write_text("\n".join(map(str, np.cos(6 * z.real) + z.imag)))
    files = folder / "moving.sulc.npy", f"{folder / 'control.sulc.txt'}:0.5"
    surfaces = folder / "moving.npz", folder / "control.npz", "--out", folder / "out"
    options = ("--feature", *files, "--feature", "curvature", "curvature", "--delta", 0.7, "--hold-out", "north")
    run("register", *surfaces, *options, "--accept-suspect")
    report, output = (json.loads((folder / "out" / "report.json").read_text()), capsys.readouterr().out)
    assert report["features"] == {"moving.sulc.npy": pytest.approx(1 / 3), "curvature": pytest.approx(2 / 3)}
    assert report["delta"] == 0.7 and list(report["held_out_mm"]) == ["north"]
    assert re.search(r"^held out +\d\.\d\d mm", output, re.MULTILINE)
    assert re.search(r"^r\(moving.sulc.npy\) +0?\.?\d", output, re.MULTILINE)


def test_registration_without_landmarks(folder, capsys):
    z, _ = polar_disk(8, 24)
    np.save(folder / "sulc.npy", np.cos(6 * z.real + 1) + z.imag)
    surfaces = folder / "moving.npz", folder / "control.npz", "--out", folder / "out"
    plain = folder / "moving.npz", folder / "plain.ply", "--out", folder / "out"
    for pair in ((*surfaces, "--no-landmarks"), plain):  # named, or for want of curves
        run("register", *pair, "--feature", folder / "sulc.npy", folder / "sulc.npy")
        report, output = (json.loads((folder / "out" / "report.json").read_text()), capsys.readouterr().out)
        assert report["landmark_error"] is None and report["curves"] == [] and "landmark error" not in output
        assert re.search("^landmarks +none; registered by sulc.npy alone$", output, re.MULTILINE)
    assert {"figure.png", "report.json"} <= set(everything(folder / "out"))
    error = refused(capsys, folder, "register", *surfaces, "--no-landmarks", "--landmarks", folder / "landmarks.json")
    assert "exclude each other" in error
    error = refused(capsys, folder, "register", *surfaces, "--no-landmarks", "--no-features")
    assert "landmarks hold no curves" in error


@pytest.mark.parametrize(
    "options, message",
    [
        (["--feature", "depth", "depth", "--no-features"], "--feature and --no-features exclude each other"),
        (["--delta", "0.3", "--no-features"], "--delta and --no-features exclude each other"),
        (["--feature", "thick.npy", "thick.npy"], "thick.npy: 5 values for 193 vertices"),
        (["--feature", "a.label.gii", "a.label.gii"], "a.label.gii: holds labels, no measure; give a map of numbers"),
        (["--feature", "absent.npy", "thick.npy"], "absent.npy"),
        (["--feature", "depth", "depth", "--delta", "-1"], "delta = -1.0: must be finite"),
        (["--hold-out", "west"], "no curve is called 'west'"),
    ],
)
def test_bad_features_are_one_line(folder, capsys, monkeypatch, options, message):
    np.save(folder / "thick.npy", np.arange(5.0))
    write_values(folder / "a.label.gii", np.arange(193) % 3)
    monkeypatch.chdir(folder)
    assert message in refused(capsys, folder, "register", "moving.npz", "control.npz", "--out", "out", *options)


def test_the_network_method_and_its_tolerance_reach_the_pipeline(folder, monkeypatch, capsys):
    blocks = SimpleNamespace(
        detect=detect_curves,
        predict=lambda z, faces, *_, **__: np.zeros(len(faces), complex),
        solve=solve_beltrami_disk,
        gamma_used=lambda weights: weights.gamma,
    )
    monkeypatch.setattr("qclearn.nets.load", lambda name: blocks)
    for tolerance, words in (
        ("inf", "the networks' map ended above the best Möbius map"),
        ("5e-3", "landmark error .* above 5.0e-03: .* Gauss-Newton steps"),
    ):
        with suppress(SystemExit):  # 3: an error that stays is suspect
            run(*to_register(folder), "--method", "network", "--tolerance", tolerance)
        assert json.loads((folder / "out" / "report.json").read_text())["method"] == "network"
        assert re.search(f"fallbacks +{words}", capsys.readouterr().out)


def test_a_second_run_replaces_the_files_of_the_first(folder):
    """Both by the curves that the surfaces carry, as no landmarks are given."""
    for gamma in (10, 1000):
        run(*to_register(folder), "--gamma", gamma)
    report = json.loads((folder / "out" / "report.json").read_text())
    assert everything(folder / "out") == FILES and report["gamma"] == 1000
    assert [row["name"] for row in report["curves"]] == ["east", "north"]


@pytest.mark.parametrize(
    "arguments, message",
    [
        ([], "Missing command"),
        (["demonstrate"], "No such command 'demonstrate'"),
        (["register", "a.npz", "b.npz"], "Missing option '--out'"),
        (["register", "a.npz", "b.npz", "--out", "x", "--gamma", "many"], "'many' is not a valid float"),
        (
            ["register", "moving.npz", "control.npz", "--out", "x", "--tolerance", "1e-3"],
            "tolerance belongs to method 'network'",
        ),
        (
            ["register", "moving.npz", "control.npz", "--out", "x", "--method", "network", "--sliding"],
            "sliding belongs to",
        ),
        (["register", "a.npz", "b.npz", "--out", "x"], "a.npz: cannot be read"),
        (["open", "a.gii", "--out", "x.npz"], "Missing option '--mask'"),
        (["transfer", "r.npz", "v.npy", "--out", "x.npy"], "Missing option '--to'"),
        (["transfer", "r.npz", "v.npy", "--to", "moving", "--out", "x.npy"], "r.npz: cannot be read .*check the name"),
    ],
)
def test_wrong_usage_is_one_line(arguments, message, folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    assert re.search(message, refused(capsys, folder, *arguments))


def bad_landmarks(**changes):
    return json.dumps({"curves": [CURVES["curves"][0] | changes]})


@pytest.mark.parametrize(
    "content, message",
    [
        ("{", "landmarks.json: not a JSON file"),
        (b"\xff\xfe\x00", "landmarks.json: not a JSON file"),
        (None, "landmarks.json: cannot be read .*check the name"),
        (
            '{"curves": [{"name": "a", "moving": [1, ' + "9" * 5000 + '], "control": [1, 2]}]}',
            "landmarks.json: not a JSON file",
        ),
        (
            bad_landmarks(name="A" * 10**6),
            "landmarks.json: the name of curve 0 is longer than 200 characters.{1,100}rename",
        ),
        (
            bad_landmarks(name="\x1b]0;x\x07"),
            r"landmarks.json: the name of curve 0 .*control characters: '\\x1b]0;x\\x07'",
        ),
        (bad_landmarks(control=[0, 10_000]), r"'east', control side: .*out of range 0..192: \[10000\]"),
    ],
)
def test_bad_landmarks_files_are_one_line(content, message, folder, capsys):
    file = folder / "landmarks.json"
    file.unlink() if content is None else file.write_bytes(content if isinstance(content, bytes) else content.encode())
    line = refused(capsys, folder, *to_register(folder, "--landmarks", file, out="deep/out"))
    assert re.search(message, line)


def test_bad_surfaces_are_one_line(folder, capsys):
    good = bowl(0.6)
    (folder / "cut.npz").write_bytes((folder / "moving.npz").read_bytes()[:200])
    np.savez(
        folder / "nan.npz", vertices=np.where(np.arange(193)[:, None] == 7, np.nan, good.vertices), faces=good.faces
    )
    np.savez(folder / "inward.npz", vertices=good.vertices, faces=good.faces[:, ::-1])
    landmarks = ["--landmarks", folder / "landmarks.json", "--out", folder / "out"]
    for name, message in (
        ("cut.npz", "cut.npz: not a readable npz"),
        ("nan.npz", "nan.npz: .*7"),
        ("no.ply", "no.ply"),
        ("inward.npz", r"reverse|mirror|::-1"),
        ("landmarks.json", "suffix"),
    ):
        assert re.search(
            message, refused(capsys, folder, "register", folder / name, folder / "control.npz", *landmarks)
        )


def test_surfaces_without_shared_curves_need_landmarks_or_features(folder, capsys):
    pair = folder / "moving.npz", folder / "plain.ply", "--out", folder / "out"
    line = refused(capsys, folder, "register", *pair, "--no-features")
    assert "share no curve names" in line and "--landmarks" in line


@pytest.mark.parametrize("out", ["plain.ply", "plain.ply/below", "plain.ply/far/below"])
def test_a_file_where_the_folder_should_be_is_one_line(out, folder, capsys):
    line = refused(capsys, folder, *to_register(folder, out=out))
    assert re.search(f"{out}: not a folder that can be written to .*another --out", line)


def test_a_folder_that_cannot_be_written_is_one_line(folder, capsys, monkeypatch):
    """The system's refusal is imitated: whoever runs the tests may be allowed to write everywhere."""

    def refuse(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("qclearn.cli.output.tempfile.TemporaryDirectory", refuse)
    line = refused(capsys, folder, *to_register(folder))
    assert re.search(r"out: not a folder that can be written to \(Permission denied\)", line)


def test_a_failure_at_the_end_leaves_nothing(folder, capsys, monkeypatch):
    """Three of the four files are written when the last one fails."""

    def fail(*_, **__):
        raise SurfaceError("the disk is full")

    monkeypatch.setattr("qclearn.cli.registration.qc.write_surface", fail)
    line = refused(capsys, folder, *to_register(folder, out="deep/out"), "--gamma", 100)
    assert "the disk is full" in line


@pytest.mark.parametrize(
    "error, message",
    [
        (MemoryError("Unable to allocate 9 GiB"), "^qclearn: Unable to allocate 9 GiB$"),
        (OSError(28, "No space left on device", "out"), "No space left on device: 'out'"),
    ],
)
def test_what_breaks_off_a_run_is_one_line(folder, capsys, monkeypatch, error, message):
    def broken(*_, **__):
        raise error

    monkeypatch.setattr("qclearn.cli.registration.run_registration", broken)
    assert re.search(message, refused(capsys, folder, *to_register(folder)))


def test_an_interrupt_says_so(folder, capsys, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("qclearn.cli.registration.run_registration", interrupt)
    with pytest.raises(SystemExit) as stop:
        run(*to_register(folder))
    assert stop.value.code == 130 and capsys.readouterr().err.strip() == "qclearn: interrupted"
    assert not (folder / "out").exists()


def test_the_progress_bar_is_gone_before_the_message(folder, capsys, monkeypatch):
    """Even where the bar would be shown at once, the message has a line of its own."""
    module = sys.modules["qclearn.registration.register"]
    bar = module.tqdm
    monkeypatch.setattr(module, "tqdm", lambda **options: bar(**options | {"delay": 0, "file": sys.stderr}))

    def fail(*_):
        raise LandmarkError("no")

    monkeypatch.setattr(module, "fit_with_fallbacks", fail)
    with pytest.raises(SystemExit):
        run(*to_register(folder))
    assert re.search(r"\rqclearn: no\n$", capsys.readouterr().err)


@pytest.fixture(scope="module")
def result():
    return register(bowl(0.6), bowl(0.9), CURVES, gamma=1e3, features=None)


@pytest.fixture
def registered(folder, result):
    """The folder of a finished registration of the two bowls, and a map on each of them."""
    np.savez(
        folder / "registration.npz",
        disk_map=result.disk_map,
        disk_control=result.disk_control,
        faces_moving=result.faces_moving,
        faces_control=result.faces_control,
    )
    np.savetxt(folder / "map.txt", bowl(0.9).vertices[:, 2])
    np.save(folder / "labels.npy", np.arange(193) % 5)
    return folder, result


@pytest.mark.parametrize("name", ["there.npy", "there.txt", "there.shape.gii", "lh.there"])
def test_transfer_writes_every_format(registered, name):
    folder, result = registered
    run(*to_transfer(folder, "registration.npz", "map.txt", "moving", name))
    np.testing.assert_allclose(read_values(folder / name), result.points[:, 2], atol=1e-6)
    run(*to_transfer(folder, "registration.npz", name, "control", "back.npy"))
    assert abs(np.load(folder / "back.npy") - bowl(0.9).vertices[:, 2]).max() < 0.05


def test_transfer_refuses_what_does_not_belong_together(registered, capsys):
    folder, _ = registered
    np.save(folder / "short.npy", np.zeros(5))
    (folder / "cut.npz").write_bytes((folder / "registration.npz").read_bytes()[:300])
    for registration, values, message in (
        ("registration.npz", "short.npy", "5 values for 193 vertices"),
        ("registration.npz", "no.npy", "no.npy"),
        ("registration.npz", "landmarks.json", "landmarks.json"),
        ("moving.npz", "map.txt", "moving.npz: not a registration.npz of this program .*qclearn register"),
        ("labels.npy", "map.txt", "labels.npy: not a registration.npz"),
        ("cut.npz", "map.txt", "cut.npz: not a registration.npz"),
        ("map.txt", "map.txt", "map.txt: not a registration.npz"),
    ):
        line = refused(capsys, folder, *to_transfer(folder, registration, values, "moving", "there.npy"))
        assert re.search(message, line)
    line = refused(capsys, folder, *to_transfer(folder, "registration.npz", "map.txt", "moving", "no/there.npy"))
    assert "there.npy: cannot be written" in line


def test_open_refuses_inward_surfaces_and_foreign_masks(folder, capsys):
    ball = sphere()
    write_surface(folder / "ball.ply", ball)
    write_surface(folder / "inside-out.ply", Surface(ball.vertices, ball.faces[:, ::-1]))
    np.save(folder / "mask.npy", ball.vertices[:, 2] < -0.5)
    np.save(folder / "foreign.npy", np.ones(7))
    for surface, mask, message in (
        ("inside-out.ply", "mask.npy", "--reverse|reverse"),
        ("ball.ply", "foreign.npy", "foreign.npy"),
    ):
        line = refused(capsys, folder, "open", folder / surface, "--mask", folder / mask, "--out", folder / "open.npz")
        assert re.search(message, line)
    run("open", folder / "inside-out.ply", "--reverse", "--mask", folder / "mask.npy", "--out", folder / "open.npz")
    require_outward(read_surface(folder / "open.npz"))


def test_open_says_what_of_the_mask_stays_and_keeps_the_hemisphere(folder, capsys):
    ball = sphere()
    write_surface(folder / "rh.ball.surf.gii", ball)
    mask = ball.vertices[:, 2] < -0.5
    mask[ball.vertices[:, 2].argmax()] = True
    np.save(folder / "mask.npy", mask)
    run("open", folder / "rh.ball.surf.gii", "--mask", folder / "mask.npy", "--out", folder / "open.surf.gii")
    assert (
        f"1 of the mask's {mask.sum()} vertices stay: holes away from the opening are filled" in capsys.readouterr().out
    )
    write_surface(folder / "ball.surf.gii", ball)
    words = "--mask", folder / "mask.npy", "--out", folder / "open.surf.gii"
    for name, option, structure in (("rh.ball", [], "CortexRight"), ("ball", ["--hemisphere", "left"], "CortexLeft")):
        run("open", folder / f"{name}.surf.gii", *words, *option)
        assert nibabel.load(folder / "open.surf.gii").meta["AnatomicalStructurePrimary"] == structure
    line = refused(capsys, folder, "open", folder / "rh.ball.surf.gii", *words, "--hemisphere", "left")
    assert re.search("rh.ball.surf.gii: is of the right hemisphere; leave --hemisphere left out, or correct", line)


def test_landmarks_with_a_byte_order_mark_are_read(folder):
    (folder / "landmarks.json").write_bytes(b"\xef\xbb\xbf" + json.dumps(CURVES).encode())
    assert read_landmarks(folder / "landmarks.json") == CURVES


def test_transfer_of_whole_numbers_wants_nearest_and_names_stay(registered, capsys):
    folder, _ = registered
    line = refused(capsys, folder, *to_transfer(folder, "registration.npz", "labels.npy", "moving", "there.npy"))
    assert re.search("labels.npy: holds whole numbers.*--nearest.*floats", line)
    table = np.array([[k * 40, 20, 30, 0, 0] for k in range(5)])
    nibabel.freesurfer.write_annot(folder / "lh.a.annot", np.arange(193) % 5, table, list("abcde"), fill_ctab=True)
    run(*to_transfer(folder, "registration.npz", "lh.a.annot", "moving", "R.there.label.gii", "--nearest"))
    image = nibabel.load(folder / "R.there.label.gii")
    assert list(image.labeltable.get_labels_as_dict().values())[-5:] == list("abcde")
    assert image.meta["AnatomicalStructurePrimary"] == "CortexRight"


@pytest.mark.parametrize("name", ["o.csv", "lh.o.annot", "o.dscalar.nii", "o.npz"])
def test_transfer_refuses_what_it_cannot_write(registered, capsys, name):
    folder, _ = registered
    line = refused(capsys, folder, *to_transfer(folder, "registration.npz", "map.txt", "moving", name))
    assert name in line


def test_no_control_character_reaches_the_terminal(folder, capsys):
    line = refused(
        capsys, folder, "register", folder / "\x1b[31mred.npz", folder / "control.npz", "--out", folder / "out"
    )
    assert "\x1b" not in line and r"\x1b[31mred.npz" in line


def test_a_bug_is_not_called_bad_input(folder, monkeypatch):
    """A KeyError of our own, in a reader, is a traceback for us and no advice to the user."""

    def buggy(data):
        return {}["vertices"]

    monkeypatch.setattr("qclearn.io.safe.npz_arrays", lambda data, wanted: buggy(data))
    with pytest.raises(KeyError):
        run(*to_register(folder))


def named_options(text):
    """(command, option) of each option in a command line that a page, a message or a docstring has."""
    text = re.sub(r'"\s*\n\s*f?"', "", text.replace("\\\n", " "))
    for command, rest in re.findall(rf"\bqclearn ({'|'.join(cli.commands)})\b([^`\n|;&]*)", text):
        yield from ((command, option) for option in re.findall(r"(?<=\s)--[a-z][a-z-]*", rest))


def test_every_option_that_a_text_names_is_there():
    pages = [markdown_of(page) for page in chapters()]
    texts = [
        *pages,
        *(path.read_text(encoding="utf-8") for path in (ROOT / "README.md", *ROOT.glob("qclearn/**/*.py"))),
    ]
    named = {one for text in texts for one in named_options(text)}
    known = {(name, option) for name, one in cli.commands.items() for given in one.params for option in given.opts}
    assert len(named) > 20 and named <= known, named - known
    assert set(named_options("`qclearn open A \\\n  --label B`")) - known == {("open", "--label")}
