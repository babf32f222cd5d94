"""The command line: options reach `register`, files come out whole, bad input is one line and exit code 2."""

import ast
import inspect
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import click
import nibabel
import numpy as np
import pytest

from book.builder.references import chapters, markdown_of
from commands import BALL, CURVES, bowl, everything, refused, run
from qclearn import read_values
from qclearn.cli import cli, registration
from qclearn.io.frames import Frame
from qclearn.io.fsaverage import fsaverage5, whole_fsaverage5
from qclearn.io.mapfile import frame_of_side, read_registration, side_arrays, write_registration
from qclearn.io.meshes import read_surface, write_surface
from qclearn.io.values import write_values
from qclearn.registration import diagnose
from qclearn.registration.features import FOLDS
from qclearn.registration.problem import LandmarkError, Weights
from qclearn.registration.register import Stages, register
from qclearn.surfaces import units
from qclearn.surfaces.surface import Surface, SurfaceError, mirror, require_outward
from reports import REPORT

ROOT = Path(__file__).resolve().parent.parent
FILES = ["figure.png", "registered.surf.gii", "registration.npz", "report.json"]
ADDED = {"inputs", "landmarks", "versions", "command"}  # by the command line


def to_register(folder, *options, out="out"):
    """The words that register the two bowls of a folder, which have no folds."""
    surfaces = folder / "moving.npz", folder / "control.npz"
    return ["register", "--no-features", *surfaces, "--out", folder / out, *options]


def to_transfer(folder, registration, values, to, out, *options):
    """The words that carry a map over by the files of a folder."""
    return ["transfer", folder / registration, folder / values, "--to", to, "--out", folder / out, *options]


@pytest.fixture
def folder(tmp_path, plain_figure):
    """A folder with two bowls that carry curves, one without, a landmarks file and two maps."""
    write_surface(tmp_path / "moving.npz", bowl(0.6))
    write_surface(tmp_path / "control.npz", bowl(0.9))
    write_surface(tmp_path / "plain.ply", bowl(0.9))
    (tmp_path / "landmarks.json").write_text(json.dumps(CURVES))
    np.savetxt(tmp_path / "map.txt", bowl(0.9).vertices[:, 2])
    np.save(tmp_path / "labels.npy", np.arange(193) % 5)
    return tmp_path


@pytest.fixture(scope="module")
def result():
    return register(bowl(0.6), bowl(0.9), CURVES, gamma=1e3, features=None)


@pytest.fixture
def quick(monkeypatch, result):
    """Commands that write a finished registration: its report's entries may be changed."""
    changes = {}
    finished = Mock(side_effect=lambda *_, **__: replace(result, report=result.report | changes))
    monkeypatch.setattr(registration, "run_registration", finished)
    return changes


# Options reach `register` under their names


class Recorded(ValueError):
    """In place of a registration: its arguments."""


@pytest.fixture
def recorded(monkeypatch, folder):
    """What a command line would call `register` with: (moving, control, curves, options)."""

    def record(moving, control, curves, **options):
        inspect.signature(register).bind(moving, control, curves, **options)
        raise Recorded(moving, control, curves, options)

    monkeypatch.setattr(registration, "run_registration", record)
    monkeypatch.chdir(folder)

    def call(*words):
        with pytest.raises(Recorded) as stop:
            cli.main(["register", *words, "--out", "out"], standalone_mode=False, obj=([], 0.0))
        return stop.value.args

    return call


PAIR, MIRROR = ("moving.npz", "control.npz"), ["--mirror"]


@pytest.mark.parametrize("words, changed", [
    ("", {}),
    ("--alpha 2 --beta 0.1 --gamma 1e2", {"alpha": 2.0, "beta": 0.1, "gamma": 1e2}),
    ("--delta 0.7 --eta 0", {"delta": 0.7, "eta": 0.0}),
    ("--method network --tolerance 5e-3", {"method": "network", "tolerance": 5e-3}),
    ("--no-features --sliding", {"features": None, "sliding": True}),
    ("--hold-out north --hold-out east", {"hold_out": ("north", "east")}),
    ("--uncertainty --accept-suspect", {"uncertainty": True, "accept_suspect": True}),
    ("--feature curvature curvature:0.5", {"features": [("curvature", 0.5)]}),
])  # fmt: skip
def test_options_reach_register_under_their_names(recorded, words, changed):
    usual = {name: getattr(Weights, name) for name in ("alpha", "beta", "gamma")}
    usual |= {"delta": None, "eta": None, "features": FOLDS, "hold_out": (), "method": "exact", "tolerance": None}
    usual |= {"accept_suspect": False, "progress": True, "sliding": False, "uncertainty": False}
    moving, control, curves, options = recorded(*PAIR, *words.split())
    assert options == usual | changed
    np.testing.assert_array_equal(moving.vertices, bowl(0.6).vertices)
    np.testing.assert_array_equal(control.faces, bowl(0.9).faces)
    assert [curve["name"] for curve in curves["curves"]] == ["east", "north"]  # those of both files


def test_curves_of_one_side_alone_are_told(recorded, folder, capsys):
    assert recorded("moving.npz", "plain.ply")[2]["curves"] == []
    assert "curves on one side alone are left out: east, north" in capsys.readouterr().err
    recorded(*PAIR)
    assert capsys.readouterr().err == ""


def test_maps_landmarks_mirror_and_units_reach_it(recorded, folder):
    np.save(folder / "moving.sulc.npy", np.arange(193.0))
    ((feature, weight),) = recorded(*PAIR, "--feature", "moving.sulc.npy", "map.txt:0.25")[3]["features"]
    assert (feature.name, weight) == ("moving.sulc.npy", 0.25)
    np.testing.assert_array_equal(feature.moving, np.arange(193.0))
    np.testing.assert_array_equal(feature.control, np.loadtxt("map.txt"))
    assert recorded(*PAIR, "--no-landmarks")[2]["curves"] == []
    (held,) = recorded(*PAIR, "--no-landmarks", "--hold-out", "north")[2]["curves"]
    assert held["name"] == "north"
    assert len(recorded(*PAIR, "--no-landmarks", "--hold-out", "nroth")[2]["curves"]) == 2  # to be named in the error
    assert recorded("moving.npz", "plain.ply")[2]["curves"] == []
    moving, _, curves, _ = recorded(*PAIR, "--landmarks", "landmarks.json", "--mirror", "--units", "m")
    assert curves == CURVES
    np.testing.assert_allclose(moving.vertices, 1e3 * mirror(bowl(0.6)).vertices)


# Files come out whole


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
    held = {curve["name"] for curve in report["landmarks"]["curves"] if curve.get("hold_out")}
    assert held == set(report["held_out_mm"])  # given back, they are held out again
    first, *_, figure, write, total = seconds = report["seconds"]
    assert (first, figure, write, total) == ("read", "figure", "write", "total") and min(seconds.values()) >= 0
    assert 0.95 * seconds["total"] < sum(seconds.values()) - seconds["total"] <= 1.001 * seconds["total"]


def test_the_demo_writes_four_files_that_know_both_surfaces(demo):
    """With a mirrored moving surface: numbers, sides and faces of the whole one are those of its file."""
    assert everything(demo) == FILES and len(everything(demo.parent)) == 1 + len(FILES)
    assert (demo / "figure.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    arrays, moving = read_registration(demo / "registration.npz"), mirror(fsaverage5("right"))
    points, triangles = (array.data for array in nibabel.load(demo / "registered.surf.gii").darrays)
    np.testing.assert_array_equal(triangles, moving.faces)
    np.testing.assert_allclose(points, arrays["points"], atol=1e-4)
    require_outward(read_surface(demo / "registered.surf.gii"))
    assert arrays["disk_map"].shape == arrays["disk_moving"].shape and len(arrays["mu"]) == len(moving.faces)
    for side, name in (("moving", "right"), ("control", "left")):
        surface, whole = fsaverage5(name), whole_fsaverage5(name)
        expected = mirror(surface) if side == "moving" else surface
        np.testing.assert_array_equal(arrays[f"vertices_{side}"], expected.vertices.astype(np.float32))
        np.testing.assert_array_equal(arrays[f"faces_{side}"], expected.faces)
        np.testing.assert_array_equal(arrays[f"table_{side}"], surface.original_vertices)
        np.testing.assert_array_equal(arrays[f"whole_faces_{side}"], whole.faces)
        frame = frame_of_side(arrays, side)
        assert (frame.side, frame.kind, frame.count) == (name, "Pial", 10242)
    assert arrays["mirrored"]


def test_register_is_the_library_and_mirror_mirrors(folder, capsys):
    arguments = to_register(folder, "--landmarks", folder / "landmarks.json", "--mirror", "--gamma", 1e2)
    run(*arguments)
    expected = register(mirror(bowl(0.6)), bowl(0.9), CURVES, gamma=1e2, features=None)
    np.testing.assert_allclose(np.load(folder / "out" / "registration.npz")["points"], expected.points, atol=1e-9)
    printed = capsys.readouterr().out
    assert "bijective       yes" in printed and f"written to      {folder / 'out'}" in printed
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["landmark_error"] == pytest.approx(expected.report["landmark_error"])
    # It says where it comes from, ...
    read = {side: read_surface(folder / f"{side}.npz") for side in ("moving", "control")}
    assert report["inputs"] == {side: {"path": str(folder / f"{side}.npz")} | read[side].fingerprint for side in read}
    assert report["command"] == ["qclearn", *map(str, arguments)] and report["suspect"] == []
    assert report["versions"]["numpy"] == np.__version__ and {"python", "scipy", "qclearn"} <= set(report["versions"])
    # ... and holds a landmarks file, for these surfaces, mirrored or not, and for no others.
    assert report["landmarks"]["curves"] == CURVES["curves"]
    (folder / "again.json").write_text(json.dumps(report["landmarks"]))
    exchanged = [arguments[0], folder / "control.npz", folder / "moving.npz", "--landmarks", folder / "again.json"]
    line = refused(capsys, folder, *exchanged, "--out", folder / "other")
    assert re.search("landmarks were made for another moving surface .*exchanged: they fit the control surface", line)


def test_output_that_cannot_show_a_letter_escapes_it(folder):
    """And the exit code stays that of what was written."""
    words = [sys.executable, "-m", "qclearn", *map(str, to_register(folder))]
    ascii = os.environ | {"PYTHONIOENCODING": "ascii"}
    output = subprocess.run(words, cwd=ROOT, env=ascii, capture_output=True, check=True).stdout
    assert rb"after the best M\xf6bius map" in output


@pytest.mark.parametrize("options, code", [([], 3), (["--accept-suspect"], 0)])
def test_a_suspect_registration_is_written_and_says_so(folder, capsys, quick, options, code):
    quick |= {"suspect": ["reversed: 'east' fits", "curve: 'north' ends"], "stopped": "the landmarks are wrong"}
    with pytest.raises(SystemExit) as stop:
        run(*to_register(folder, *options))
    output = capsys.readouterr()
    assert stop.value.code == code and everything(folder / "out") == FILES
    assert json.loads((folder / "out" / "report.json").read_text())["suspect"] == quick["suspect"]
    assert output.err.splitlines() == [f"qclearn: suspect: {'; '.join(quick['suspect'])}"]
    assert re.search(r"^stopped +the landmarks are wrong$.*^suspect +reversed; curve$", output.out, re.M | re.DOTALL)


@pytest.mark.parametrize("moving, options, reason", [
    *((name, option, "by the folds$") for name, option in (("rh.a.npz", MIRROR), ("lh.a.npz", []), ("a.npz", MIRROR))),
    ("rh.a.npz", [], "{} is a .*give --mirror, or name the files"),
    ("lh.a.npz", MIRROR, "{} is a .*leave --mirror out, or name the files"),
])  # fmt: skip
def test_hemispheres_that_the_files_name_outrank_the_folds(folder, quick, moving, options, reason):
    moving, control = ((folder / old).rename(folder / new) for old, new in zip(PAIR, (moving, "lh.b.npz")))
    quick["suspect"] = ["mirror: by the folds", "features: differ"]
    with pytest.raises(SystemExit):
        run("register", moving, control, "--out", folder / "out", *options)
    mirror, *others = json.loads((folder / "out" / "report.json").read_text())["suspect"]
    assert others == ["features: differ"] and re.match(f"mirror: {reason.format(moving)}", mirror)


def test_figures_that_are_asked_first_are_printed(folder, capsys, quick):
    quick |= {"curves": [], "features": {"sulc": 1.0}, "held_out_mm": {"a": [4.0, 1.0], "b": [2.0, 2.0]}}
    quick |= {"r": {"sulc": [0.25, 0.5]}, "fallbacks": ["the networks' map", "the exact one"]}
    run(*to_register(folder))
    output = capsys.readouterr().out
    for words in (
        "landmarks +none; registered by sulc alone",
        "held out +1.50 mm, mean of the curves .3.00 after the Möbius map that aligns the folds best.",
        " +a 1.00, b 2.00",
        r"r\(sulc\) +0.500 .0.250 after the best Möbius map.",
        "fallbacks +the networks' map; the exact one",
        "suspect +no",
    ):
        assert re.search(f"^{words}$", output, re.MULTILINE), words
    assert "landmark error" not in output


def test_a_failure_at_the_end_leaves_nothing(folder, capsys, quick, monkeypatch):
    """Three of the four files are written when the last one fails."""
    monkeypatch.setattr("qclearn.cli.registration.qc.write_surface", Mock(side_effect=SurfaceError("no surface")))
    assert "no surface" in refused(capsys, folder, *to_register(folder, out="deep/out"))


# One line on stderr


@pytest.mark.parametrize("error, code, line", [
    (MemoryError("Unable to allocate 9 GiB"), 2, "Unable to allocate 9 GiB"), (KeyboardInterrupt(), 130, "interrupted"),
    (OSError(28, "No space left on device", "out"), 2, "[Errno 28] No space left on device: 'out'"),
])  # fmt: skip
def test_what_breaks_off_a_run_is_one_line(folder, capsys, monkeypatch, error, code, line):
    monkeypatch.setattr(registration, "run_registration", Mock(side_effect=error))
    with pytest.raises(SystemExit) as stop:
        run(*to_register(folder))
    assert stop.value.code == code and capsys.readouterr().err.strip() == f"qclearn: {line}"
    assert not (folder / "out").exists()


def test_the_progress_bar_is_gone_before_the_message(folder, capsys, monkeypatch):
    """Even where the bar would be shown at once, the message has a line of its own."""
    module = sys.modules["qclearn.registration.register"]
    bar = module.tqdm
    monkeypatch.setattr(
        module, "tqdm", lambda **options: bar(**options | {"delay": 0, "file": sys.stderr, "disable": False})
    )
    monkeypatch.setattr(module, "fit_with_fallbacks", Mock(side_effect=LandmarkError("no")))
    with pytest.raises(SystemExit):
        run(*to_register(folder))
    assert re.search(r"\rqclearn: no\n$", capsys.readouterr().err)


def test_bars_of_progress_are_silent_where_stderr_is_no_terminal():
    assert Stages(3, True).bar.disable and sys.stderr.isatty() is False
    files = [path for folder in ("qclearn", "data_synth", "book") for path in (ROOT / folder).rglob("*.py")]
    texts = [text for path in files if "tqdm(" in (text := path.read_text(encoding="utf-8"))]
    nodes = [node for text in texts for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    calls = [call for node in nodes if (call := ast.unparse(node)).startswith("tqdm(")]
    assert len(calls) == 9 and [call for call in calls if not re.search(r"disable=([^,]* or )?None\b", call)] == []


@pytest.mark.parametrize("word", ["", " ", "--help"])
def test_no_option_and_no_argument_takes_an_empty_word_or_an_option(tmp_path, capsys, monkeypatch, word):
    """As a variable leaves it that is not set."""
    monkeypatch.chdir(tmp_path)
    taken = [(name, one) for name, command in cli.commands.items() for one in command.params]
    taken = [(name, one) for name, one in taken if not (one.is_flag if isinstance(one, click.Option) else "-" in word)]
    for name, one in taken:
        before = one.opts[:1] if isinstance(one, click.Option) else []
        for place in range(max(one.nargs, 1)):
            words = [word if place == k else "x" for k in range(max(one.nargs, 1))]
            line = refused(capsys, tmp_path, name, *before, *words)
            assert f"Invalid value for '{before[0] if before else ''}" in line and repr(word) in line
    assert len(taken) > 40


REGISTER = "register moving.npz control.npz --out x "
TRANSFER = "transfer registration.npz map.txt --to moving --out there.npy "


@pytest.mark.parametrize("words, message", [
    ("", "Missing command"),
    ("demonstrate", "No such command 'demonstrate'"),
    ("register a.npz b.npz", "Missing option '--out'"),
    (REGISTER + "--gamma many", "'many' is not a valid float"),
    (REGISTER + "--gamma 1 --gamma=2", "--gamma is given twice; leave one out"),
    (REGISTER + "--mirror --mirror", "--mirror is given twice"),
    (REGISTER + "--landmarks landmarks.json --no-landmarks", "exclude each other"),
    (REGISTER + "--feature depth depth --no-features", "--feature and --no-features exclude each other"),
    (REGISTER + "--delta 0.3 --no-features", "--delta and --no-features exclude each other"),
    (REGISTER + "--feature thick.npy thick.npy", "thick.npy: 5 values for 193 vertices"),
    (REGISTER + "--feature a.label.gii a.label.gii", "a.label.gii: holds labels, no measure; give"),
    (REGISTER + "--landmarks broken.json", "broken.json: not a JSON file"),
    (REGISTER + "--landmarks long.json", "long.json: the name of curve 0 is longer than 200 .{1,100}rename"),
    ("register moving.npz plain.ply --no-features --out x", "share no curve names .*--landmarks"),
    ("register a.npz control.npz --out x", "a.npz: cannot be read"),
    ("register landmarks.json control.npz --out x", "suffix"),
    ("register moving.npz control.npz --out plain.ply", "plain.ply: not a folder that can be written to .*another"),
    ("register \x1b[31mred.npz control.npz --out x", r"\\x1b\[31mred.npz"),
    ("open a.gii --out x.npz", "Missing option '--mask'"),
    ("open inside-out.ply --mask mask.npy --out x.npz", "reverse"),
    ("open rh.ball.ply --mask labels.npy --out x.npz", "labels.npy"),
    ("open rh.ball.ply --mask mask.npy --hemisphere left --out x.npz", "is of the right hemisphere; leave"),
    ("transfer r.npz v.npy --out x.npy", "Missing option '--to'"),
    ("transfer registration.npz thick.npy --to moving --out x.npy", "5 values for 193 vertices"),
    ("transfer registration.npz labels.npy --to moving --out x.npy", "holds whole numbers.*--nearest.*floats"),
    ("transfer moving.npz map.txt --to moving --out x.npy", "moving.npz: not a registration.npz of this program"),
    (TRANSFER.replace("there", "no/there"), "there.npy: cannot be written"),
    ("transfer registration.npz map.txt --to moving --out ./map.txt", r"\./map.txt: .* the command reads it; "),
    (REGISTER + "--landmarks x/figure.png", "x/figure.png: the command reads it; give another --out"),
    *((TRANSFER.replace("there.npy", name), name) for name in ("o.csv", "lh.o.annot", "o.dscalar.nii", "o.npz")),
])  # fmt: skip
def test_bad_input_is_one_line_and_writes_nothing(folder, capsys, monkeypatch, result, words, message):
    np.save(folder / "thick.npy", np.arange(5.0))
    write_values(folder / "a.label.gii", np.arange(193) % 3)
    (folder / "broken.json").write_text("{")
    (folder / "long.json").write_text(json.dumps({"curves": [CURVES["curves"][0] | {"name": "A" * 10**6}]}))
    write_surface(folder / "rh.ball.ply", BALL)
    write_surface(folder / "inside-out.ply", Surface(BALL.vertices, BALL.faces[:, ::-1]))
    np.save(folder / "mask.npy", BALL.vertices[:, 2] < -0.5)
    (folder / "x").mkdir()
    (folder / "x" / "figure.png").write_text(json.dumps(CURVES))
    write_disks(folder, result)
    monkeypatch.chdir(folder)
    line = refused(capsys, folder, *words.strip(" ").split(" ") if words else ())
    assert re.search(message, line) and "\x1b" not in line


def write_disks(folder, result):
    """The least that a registration.npz of surfaces from nowhere holds."""
    names = "disk_map", "disk_control", "faces_moving", "faces_control"
    arrays = {name: getattr(result, name) for name in names} | {"mirrored": np.array(False)}
    for side, surface in (("moving", bowl(0.6)), ("control", bowl(0.9))):
        arrays |= side_arrays(side, surface, Frame())
    write_registration(folder / "registration.npz", arrays)


# The other commands


@pytest.mark.parametrize("name", ["there.npy", "there.txt", "there.shape.gii", "lh.there"])
def test_transfer_writes_every_format(folder, result, name):
    write_disks(folder, result)
    run(*to_transfer(folder, "registration.npz", "map.txt", "moving", name))
    np.testing.assert_allclose(read_values(folder / name), result.points[:, 2], atol=1e-6)
    run(*to_transfer(folder, "registration.npz", name, "control", "back.npy"))
    assert abs(np.load(folder / "back.npy") - bowl(0.9).vertices[:, 2]).max() < 0.05


def test_open_reverses_fills_holes_and_keeps_the_hemisphere(folder, capsys):
    write_surface(folder / "inside-out.ply", Surface(BALL.vertices, BALL.faces[:, ::-1]))
    for name in ("rh.ball", "ball"):
        write_surface(folder / f"{name}.surf.gii", BALL)
    mask = BALL.vertices[:, 2] < -0.5
    mask[BALL.vertices[:, 2].argmax()] = True
    np.save(folder / "mask.npy", mask)
    words = "--mask", folder / "mask.npy", "--out"
    run("open", folder / "inside-out.ply", "--reverse", *words, folder / "open.npz")
    filled = f"1 of the mask's {mask.sum()} vertices stay: holes away from the opening are filled"
    said, opened = capsys.readouterr().out, read_surface(folder / "open.npz")
    counts = f"open.npz: {len(opened.vertices)} of 642 vertices, boundary of {len(opened.boundary)}\n"
    assert filled in said and counts in said
    require_outward(opened)
    for name, option, structure in (("rh.ball", [], "CortexRight"), ("ball", ["--hemisphere", "left"], "CortexLeft")):
        run("open", folder / f"{name}.surf.gii", *words, folder / "open.surf.gii", *option)
        assert nibabel.load(folder / "open.surf.gii").meta["AnatomicalStructurePrimary"] == structure


# What help and pages say


def test_every_reason_and_exit_code_is_explained_in_the_help(capsys):
    """Reasons: the words that messages of diagnose.py and units.py begin with."""
    texts = [
        node.value
        for module in (diagnose, units)
        for node in ast.walk(ast.parse(Path(module.__file__).read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    reasons = {found[1] for text in texts if (found := re.match(r"([a-z]+): ", text))}
    run("register", "--help")
    explained = capsys.readouterr().out
    assert re.search(r"0 +registered\n +2 +refused: .*\n +3 +written, but suspect", explained)
    table = explained.split("A registration is suspect where", 1)[1]
    words = re.findall(r"^ +([a-z]+): {2,}\S", table, re.MULTILINE)
    assert sorted(words) == sorted(reasons)


def named_options(text):
    """(command, option) of each option in a command line that a page, a message or a docstring has."""
    text = re.sub(r'"\s*\n\s*f?"', "", text.replace("\\\n", " "))
    for command, rest in re.findall(rf"\bqclearn ({'|'.join(cli.commands)})\b([^`\n|;&]*)", text):
        yield from ((command, option) for option in re.findall(r"(?<=\s)--[a-z][a-z-]*", rest))


def test_every_option_has_a_help_text_and_those_that_a_text_names_are_there():
    pages = [markdown_of(page) for page in chapters()]
    files = ROOT / "README.md", *ROOT.glob("qclearn/**/*.py")
    texts = [*pages, *(path.read_text(encoding="utf-8") for path in files)]
    named = {one for text in texts for one in named_options(text)}
    options = [(name, one) for name, command in cli.commands.items() for one in command.params]
    assert [one.name for _, one in options if isinstance(one, click.Option) and not one.help] == []
    known = {(name, option) for name, one in options for option in one.opts}
    assert len(named) > 15 and named <= known, named - known
    assert set(re.findall(r"^\| `qclearn (\w+)", texts[len(pages)], re.MULTILINE)) <= set(cli.commands)
    assert set(named_options("`qclearn open A \\\n  --label B`")) - known == {("open", "--label")}
