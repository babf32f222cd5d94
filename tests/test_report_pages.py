"""Pages on finished registrations: what they say is the report's and the map's, and what is not
whole is refused."""

import json
import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from meshes import bowl
from qclearn.cli import main
from qclearn.io.mapfile import write_registration
from qclearn.io.meshes import write_surface
from qclearn.plane.disk import Disk
from qclearn.reports import write_pair
from qclearn.reports.finished import FinishedRegistration, ReportError, read_finished
from qclearn.reports.render import write_text
from qclearn.reports.views import InflatedView, curvature_scale, decimated
from qclearn.surfaces.conformal import disk_conformal_map
from qclearn.surfaces.surface import Surface, SurfaceError

SPOKES = {name: np.arange(1 + start, 1 + start + 24 * 6, 24) for name, start in (("east", 0), ("north", 6))}
TURNED = {name: np.append(spoke[:-1], spoke[-1] + 1) for name, spoke in SPOKES.items()}
FOLDS = ["--feature", "curvature", "curvature"]  # depth takes most of the time of so small a surface


def run(*arguments):
    try:
        main([str(argument) for argument in arguments])
    except SystemExit as stop:
        assert stop.code in (None, 0, 3)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Registrations of three bowls onto one, the first with a page; the second holds a curve out."""
    folder, patch = tmp_path_factory.mktemp("runs"), pytest.MonkeyPatch()
    patch.setattr("qclearn.plot.registration_figure", lambda *_: Figure())  # another test's, and it takes time
    write_surface(folder / "control.npz", bowl(0.9, lean=0.4, curves=SPOKES))
    for name, height, lean, options in (
        ("one", 0.6, 0.4, ["--report"]),
        ("two", 0.8, 0.1, ["--hold-out", "north"]),
        ("six", 1.4, 0.9, []),
    ):
        moving = folder / f"<{name}>.npz"
        write_surface(moving, bowl(height, lean=lean, curves=TURNED))
        run("register", moving, folder / "control.npz", *FOLDS, "--out", folder / name, *options)
    patch.undo()
    return folder


def copied(runs, name, tmp_path, **changes):
    """A copy of a finished folder, its arrays changed, or left out where None."""
    arrays = dict(np.load(runs / name / "registration.npz")) | changes
    kept = {key: array for key, array in arrays.items() if array is not None}
    (tmp_path / name).mkdir()
    write_registration(tmp_path / name / "registration.npz", kept)
    (tmp_path / name / "report.json").write_text((runs / name / "report.json").read_text())
    return tmp_path / name


# The maps that are shown


def finished(control, moving, z, f):
    """A `FinishedRegistration` made by hand, of surfaces with common faces."""
    disk = Disk(z, control.faces)
    arrays = {"vertices_control": control.vertices, "vertices_moving": moving.vertices, "disk_map": f}
    arrays |= {"disk_control": z, "disk_moving": z, "faces_control": control.faces, "faces_moving": control.faces}
    arrays |= {"points": disk.interpolate(control.vertices, disk.locate(f)), "mu": disk.coefficient(f)}
    return FinishedRegistration("by hand", arrays, {"r": {}})


def test_a_surface_on_itself_shows_itself():
    surface = bowl(0.9, lean=0.4)
    z = disk_conformal_map(surface)
    maps = finished(surface, surface, z, z).maps()
    np.testing.assert_allclose(maps.after, maps.control, atol=1e-9)
    np.testing.assert_allclose(maps.before, maps.control, atol=1e-9)
    np.testing.assert_allclose([maps.mu, maps.log2_area], 0, atol=1e-9)
    assert finished(surface, surface, z, z).r() == pytest.approx((1, 1))


def test_the_area_map_is_positive_where_the_moving_surface_grows():
    control, moving = bowl(0.9, lean=0.4), bowl(0.4)
    z = disk_conformal_map(control)
    shown = finished(control, moving, z, z).maps().log2_area
    ratio = (control.vertex_areas / control.area) / (moving.vertex_areas / moving.area)
    np.testing.assert_allclose(shown, np.log2(ratio), atol=1e-6)
    assert shown.min() < -0.1 and shown.max() > 0.1


def test_r_is_the_reports_own_and_measured_alike_where_it_has_none(runs):
    one = read_finished(runs / "one")
    known = one.report["r"].pop("curvature")
    np.testing.assert_allclose(one.r(), known, atol=2e-3)
    one.report["r"]["curvature"] = [0.25, 0.5]
    assert one.r() == (0.25, 0.5)


def test_a_large_surface_is_shown_by_some_of_its_vertices(monkeypatch):
    surface = bowl(0.9, rings=20)
    monkeypatch.setattr("qclearn.reports.views.MOST_VERTICES", 300)
    indices, vertices, faces = decimated(surface.vertices, surface.faces)
    assert 200 < len(indices) < 350 and np.array_equal(vertices, surface.vertices[indices])
    Surface(vertices, faces).boundary  # noqa: B018 - still a disk
    assert InflatedView(surface).picture(surface.vertices[:, 2], curvature_scale("height"))


# The page of a pair


def test_a_page_says_what_the_report_says(runs):
    page, report = (runs / "one" / name for name in ("report.html", "report.json"))
    page, report = page.read_text(), json.loads(report.read_text())
    for name, (before, after) in report["r"].items():
        assert f'<th scope="row">{name}</th><td>{before:.3f}</td><td>{after:.3f}</td>' in page
    for row in report["curves"]:
        assert f'<th scope="row">{row["name"]}</th><td>{row["landmark_error_mm"]:.2f}</td>' in page
    assert all(report["inputs"][side]["sha256"] in page for side in ("moving", "control"))
    assert f"{report['mean_abs_mu']:.3f} (SD {report['sd_abs_mu']:.3f})" in page and "none held out" in page
    assert len(page.encode()) < 2e6 and "http" not in page.replace("http-equiv", "")


def test_a_page_is_the_same_from_the_command(runs, tmp_path):
    run("report", runs / "one", "--out", tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text() == (runs / "one" / "report.html").read_text()


def test_what_files_are_called_is_no_markup(runs):
    page = (runs / "one" / "report.html").read_text()
    assert "&lt;one&gt;.npz" in page and "<one>" not in page
    scene = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1]
    assert "<" not in scene and len(json.loads(scene)["maps"]) == 6


def test_the_verdict_gives_all_reasons_in_full(runs, tmp_path):
    folder = copied(runs, "two", tmp_path)
    report = json.loads((folder / "report.json").read_text())
    reasons = ["mirror: <b>the curves</b> fit better; give --mirror", "curve: 'east' ends far off"]
    for suspect, words in ((reasons, "Suspect: look before you use it"), ([], "Nothing suspicious was found")):
        (folder / "report.json").write_text(json.dumps(report | {"suspect": suspect}))
        write_pair(folder, tmp_path / "page.html")
        page = (tmp_path / "page.html").read_text()
        assert f"<h2>{words}</h2>" in page and page.count("<li>") == len(suspect)
    assert "Curves that took no part ended" in page
    (folder / "report.json").write_text(json.dumps(report | {"suspect": reasons}))
    write_pair(folder, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "mirror: &lt;b&gt;the curves&lt;/b&gt; fit better; give --mirror" in page and "ends far off" in page


def test_a_run_that_stopped_before_the_fit_says_so(runs, tmp_path):
    folder = copied(runs, "one", tmp_path)
    report = json.loads((folder / "report.json").read_text())
    report |= {"stopped": "the landmarks are wrong", "suspect": ["swapped: east and north"]}
    (folder / "report.json").write_text(json.dumps(report))
    write_pair(folder, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "Stopped before the fit" in page and "<p>the landmarks are wrong</p>" in page


def test_the_page_forbids_itself_the_network(runs):
    assert "default-src 'none'; img-src data:" in (runs / "one" / "report.html").read_text()


# What is refused


def test_a_folder_without_files_is_refused(tmp_path, runs):
    with pytest.raises(ReportError, match=r"has no registration.npz and no report.json; give a folder that"):
        write_pair(tmp_path, tmp_path / "page.html")
    folder = copied(runs, "one", tmp_path)
    (folder / "report.json").unlink()
    with pytest.raises(ReportError, match="has no report.json"):
        write_pair(folder, tmp_path / "page.html")


def test_a_file_of_an_older_version_is_refused(tmp_path, runs):
    folder = copied(runs, "one", tmp_path, vertices_moving=None, about_moving=None, mirrored=None)
    with pytest.raises(SurfaceError, match=r"version 0.1 \(it lacks about_moving, mirrored\); run"):
        write_pair(folder, tmp_path / "page.html")


def test_a_report_of_another_run_is_refused(tmp_path, runs):
    folder = copied(runs, "one", tmp_path)
    (folder / "report.json").write_text((runs / "two" / "report.json").read_text())
    with pytest.raises(ReportError, match="report.json is of another run than registration.npz"):
        write_pair(folder, tmp_path / "page.html")


@pytest.mark.parametrize("content, message", [("[1]", "not a report of"), ("{", "not JSON"), ("{}", "see 'inputs'")])
def test_another_json_is_refused(tmp_path, runs, content, message):
    folder = copied(runs, "one", tmp_path)
    (folder / "report.json").write_text(content)
    with pytest.raises(ReportError, match=f"report.json: .*{message}"):
        write_pair(folder, tmp_path / "page.html")


def test_a_page_of_names_that_are_no_utf8_is_utf8(tmp_path):
    write_text(tmp_path / "page.html", "M\udcfcller \x1b[31m\ttab")
    assert (tmp_path / "page.html").read_text("utf-8") == "M\\udcfcller \\x1b[31m\ttab"


def test_a_bad_call_is_one_line_and_exit_code_2(tmp_path, runs, capsys):
    for arguments, message in (
        ([runs / "one", runs / "two", "--out", tmp_path / "a.html"], "three lines of pandas"),
        ([runs / "one", "--out", tmp_path / "a.pdf"], "a.pdf: give a name that ends in .html"),
        ([runs / "one", "--out", tmp_path / "none" / "a.html"], "a.html: cannot be written"),
        ([tmp_path, "--out", tmp_path / "a.html"], "has no registration.npz"),
    ):
        with pytest.raises(SystemExit) as stop:
            main(["report", *map(str, arguments)])
        line = capsys.readouterr().err
        assert stop.value.code == 2 and line.count("\n") == 1 and message in line
    assert not list(tmp_path.iterdir())
