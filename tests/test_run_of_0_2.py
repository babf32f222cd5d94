"""A folder of version 0.2 (`--annot --uncertainty --sphere`, 642 vertices) can still be read."""

import json
import re
from pathlib import Path

import numpy as np

import qclearn as qc
from commands import run
from known_surfaces import sphere
from qclearn.io.mapfile import read_registration

RUN = Path(__file__).parent / "run_of_0_2"


def test_a_page_shows_the_radius_of_a_run_of_0_2(tmp_path):
    report = json.loads((RUN / "report.json").read_text(encoding="utf-8"))
    assert report["version"] == "0.2.0" and report["dice"]["of"] == 2
    run("report", RUN, "--out", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    radius = report["uncertainty"]
    assert f"{radius['mean_mm']:.1f} mm" in page
    assert re.search(f"calibrated on</th><td>{radius['calibrated_on']}", page)


def test_the_radius_of_a_run_of_0_2_is_carried_to_the_control(tmp_path):
    values = RUN / "uncertainty.shape.gii"
    words = "--to", "control", "--wall", "nan", "--out", tmp_path / "there.npy"
    run("transfer", RUN / "registration.npz", values, *words)
    maps = read_registration(RUN / "registration.npz")
    radius = qc.read_values(values)[maps["table_moving"]]
    expected = qc.transfer(radius, maps["disk_map"], maps["faces_moving"], maps["disk_control"])
    there = np.load(tmp_path / "there.npy")
    assert len(there) == len(maps["table_control"]) + np.isnan(there).sum() == 642
    np.testing.assert_allclose(there[maps["table_control"]], expected, rtol=1e-6)


def test_a_run_of_0_2_is_put_on_the_sphere_of_its_control_where_0_2_put_it(tmp_path):
    # The run's surfaces have the ball's vertices in this order.
    ball = sphere()
    turn = np.random.default_rng(0).permutation(642)
    turned = qc.Surface(ball.vertices[turn], np.argsort(turn)[ball.faces])
    qc.write_surface(tmp_path / "lh.sphere.surf.gii", turned)
    run("sphere", RUN / "registration.npz", tmp_path / "lh.sphere.surf.gii", "--out", tmp_path / "on")
    (file,) = (tmp_path / "on").glob("*.surf.gii")
    placed, before = qc.read_surface(file), qc.read_surface(RUN / "sphere.reg.surf.gii")
    np.testing.assert_array_equal(placed.faces, before.faces)
    # Millimetres on a sphere of radius 100; GIFTI has single precision.
    np.testing.assert_allclose(placed.vertices, before.vertices, atol=1e-3)
