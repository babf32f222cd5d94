"""Pages on finished registrations: what they say is the report's and the map's, and what is not whole is refused."""

import json
import re
from contextlib import suppress

import numpy as np
import pytest
from matplotlib.figure import Figure

from commands import SPOKES, refused, run
from meshes import bowl
from qclearn.io.fsaverage import fsaverage5
from qclearn.io.mapfile import write_registration
from qclearn.io.meshes import write_surface
from qclearn.plane.disk import Disk
from qclearn.reports import write_pair
from qclearn.reports.finished import FinishedRegistration, read_finished
from qclearn.reports.views import InflatedView, curvature_scale, decimated
from qclearn.surfaces.conformal import disk_conformal_map
from qclearn.surfaces.surface import Surface, mirror
from reports import drawn
from subjects import grown

LEFT = fsaverage5("left")
TURNED = {name: np.append(spoke[:-1], spoke[-1] + 1) for name, spoke in SPOKES.items()}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Registrations of two bowls onto one, the first with a page; the second holds a curve out."""
    folder, patch = tmp_path_factory.mktemp("runs"), pytest.MonkeyPatch()
    patch.setattr("qclearn.plot.registration_figure", lambda *_: Figure())  # another test's, and it takes time
    write_surface(folder / "control.npz", bowl(0.9, lean=0.4, curves=SPOKES))
    for name, height, lean, option in (("one", 0.6, 0.4, ["--report"]), ("two", 0.8, 0.1, ["--hold-out", "north"])):
        moving = folder / f"<{name}>.npz"
        write_surface(moving, bowl(height, lean=lean, curves=TURNED))
        words = moving, folder / "control.npz", "--feature", "curvature", "curvature", "--out", folder / name
        with suppress(SystemExit):  # 3: features of bowls hardly agree
            run("register", *words, *option)
    patch.undo()
    return folder


def copied(runs, name, tmp_path, without=(), **changes):
    """A copy of a finished folder, without some arrays, its report changed."""
    arrays = dict(np.load(runs / name / "registration.npz"))
    (tmp_path / name).mkdir()
    write_registration(tmp_path / name / "registration.npz", {key: arrays[key] for key in arrays.keys() - without})
    report = json.loads((runs / name / "report.json").read_text()) | changes
    (tmp_path / name / "report.json").write_text(json.dumps(report))
    return tmp_path / name


def page_of(folder):
    write_pair(folder, folder / "page.html")
    return (folder / "page.html").read_text("utf-8")


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


TILT = np.eye(3) + [[0, 0.2, -0.15], [-0.2, 0, 0.2], [0.15, -0.2, 0]]  # as a head may lie in a scanner
PERSON = Surface(fsaverage5("left", "white").vertices @ TILT + 20, LEFT.faces)
BRAINS = {"fsaverage5": LEFT, "person": PERSON, "synthetic": grown(1, 1000).surface}


@pytest.mark.parametrize("lateral", [-1, 1])
@pytest.mark.parametrize("brain", BRAINS)
def test_a_hemisphere_is_shown_whole_upright_and_not_mirrored_first_from_its_lateral_side(brain, lateral):
    """Pictures of its coordinates, to the right, the front and the top, tell where each is light."""
    surface = BRAINS[brain] if lateral < 0 else mirror(BRAINS[brain])
    view, found = InflatedView(surface), []
    places = (surface.vertices - surface.vertices.mean(0)) / surface.vertices.std(0)
    pictures = view.pictures(dict(zip("xyz", places.T)), dict.fromkeys("xyz", "it"))
    for side, words in enumerate(("outside", "the inner side")):
        assert pictures["x"][side][1] == f"it, seen from {words}"
        (x, _), (y, there), (z, _) = (drawn(both[side][0]) for both in pictures.values())
        found.append([x.mean(), np.corrcoef(y, there)[0, 2], np.corrcoef(z, there)[0, 1]])
    (x, to_right, down), inner = found
    assert lateral * (x - inner[0]) > 20 and min(lateral * to_right, -lateral * inner[1], -down, -inner[2]) > 0.5
    np.testing.assert_array_equal(view.scene([])["view"], [[0, lateral, 0], [0, 0, 1], [lateral, 0, 0]])


@pytest.mark.parametrize("order", [[1, 2, 0], [2, 0, 1]])
def test_on_other_axes_a_hemisphere_is_shown_as_on_those_of_a_scanner(order):
    other = InflatedView(Surface(LEFT.vertices[:, order], LEFT.faces))
    np.testing.assert_allclose(other.axes, InflatedView(LEFT).axes[:, order])


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
    assert "default-src 'none'; img-src data:" in page


@pytest.mark.digits
def test_a_page_is_written_again_as_it_was(runs, tmp_path):
    run("report", runs / "one", "--out", tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text() == (runs / "one/report.html").read_text()


def test_what_files_are_called_is_no_markup_and_utf8(runs, tmp_path):
    page = (runs / "one" / "report.html").read_text()
    assert "&lt;one&gt;.npz" in page and "<one>" not in page
    scene = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1]
    assert "<" not in scene and len(json.loads(scene)["maps"]) == 6
    assert "M\\udcfcller" in page_of(copied(runs, "two", tmp_path, command=["M\udcfcller"]))


REASONS = ["mirror: <b>the curves</b> fit better; give --mirror", "curve: 'east' ends far off"]


STOPPED = {"suspect": REASONS, "stopped": "the landmarks are wrong"}


@pytest.mark.parametrize("changes, words", [
    ({"suspect": []}, ["<h2>Nothing suspicious was found</h2>", "Curves that took no part ended"]),
    ({"suspect": REASONS}, ["<h2>Suspect: look before you use it<", "&lt;b&gt;the curves&lt;/b&gt; fit better; give"]),
    (STOPPED, ["<h2>Stopped before the fit</h2>", "<p>the landmarks are wrong</p>", "ends far off"]),
])  # fmt: skip
def test_the_verdict_gives_all_reasons_in_full(runs, tmp_path, changes, words):
    page = page_of(copied(runs, "two", tmp_path, **changes))
    assert all(word in page for word in words) and page.count("<li>") == len(changes["suspect"])


# What is refused


OLDER = {"vertices_moving", "about_moving", "mirrored"}


@pytest.mark.parametrize("report, without, message", [
    ("{", (), "report.json: not JSON"), ("[1]", (), "report.json: not a report of"), ("{}", (), "see 'inputs'"),
    (None, (), "has no registration.npz and no report.json; give a folder that `qclearn register` wrote"),
    ("one", OLDER, r"version 0.1 .it lacks about_moving, mirrored.; run"),
    ("two", (), "report.json is of another run than registration.npz"),
])  # fmt: skip
def test_a_folder_that_is_not_one_whole_run_is_one_line(runs, tmp_path, capsys, report, without, message):
    folder = copied(runs, "one", tmp_path, without) if report else tmp_path
    if report:
        other = runs / report / "report.json"
        (folder / "report.json").write_text(other.read_text() if other.exists() else report)
    assert re.search(message, refused(capsys, tmp_path, "report", folder, "--out", tmp_path / "a.html"))


def test_a_page_that_cannot_be_written_is_one_line(runs, tmp_path, capsys):
    for out, message in (("a.pdf", "give a name that ends in .html"), ("none/a.html", "cannot be written")):
        assert f"{out}: {message}" in refused(capsys, tmp_path, "report", runs / "one", "--out", tmp_path / out)


@pytest.mark.parametrize("changes, named", [({}, True), ({"curves": []}, False)])
def test_a_page_with_curves_names_the_tuner_of_jupyterlab(runs, tmp_path, changes, named):
    assert ("explorable(Tuner(" in page_of(copied(runs, "one", tmp_path, **changes))) == named
