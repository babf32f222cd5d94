"""A folder that version 0.1 wrote, with `--sure` and whole surfaces of 642 vertices, can still be
read."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import qclearn as qc
from known_surfaces import sphere
from qclearn.registration.transfer import read_registration
from test_cli import run

RUN = Path(__file__).parent / "run_of_0_1"


def test_a_page_shows_the_radius_of_a_run_of_0_1(tmp_path):
    report = json.loads((RUN / "report.json").read_text(encoding="utf-8"))
    assert "sure" in report and "uncertainty" not in report and "stopped" not in report
    run("report", RUN, "--out", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert f"{report['sure']['mean_mm']:.1f} mm" in page
    assert re.search(f"calibrated on</th><td>{report['sure']['calibrated_on']}", page)


def test_the_radius_of_a_run_of_0_1_is_carried_to_the_control(tmp_path):
    values = RUN / "sure.shape.gii"
    words = "--to", "control", "--wall", "nan", "--out", tmp_path / "there.npy"
    run("transfer", RUN / "registration.npz", values, *words)
    maps = read_registration(RUN / "registration.npz")
    radius = qc.read_values(values)[maps["table_moving"]]
    expected = qc.transfer(radius, maps["disk_map"], maps["faces_moving"], maps["disk_control"])
    there = np.load(tmp_path / "there.npy")
    assert len(there) == len(maps["table_control"]) + np.isnan(there).sum() == 642
    np.testing.assert_allclose(there[maps["table_control"]], expected, rtol=1e-6)


def test_a_run_of_0_1_is_put_on_the_sphere_of_its_control(tmp_path):
    # The run's surfaces have the ball's vertices in this order.
    ball = sphere()
    turn = np.random.default_rng(0).permutation(642)
    turned = qc.Surface(ball.vertices[turn], np.argsort(turn)[ball.faces])
    qc.write_surface(tmp_path / "lh.sphere.surf.gii", turned)
    run("sphere", RUN / "registration.npz", tmp_path / "lh.sphere.surf.gii", "--out", tmp_path / "on")
    (file,) = (tmp_path / "on").glob("*.surf.gii")
    placed = qc.read_surface(file)
    np.testing.assert_allclose(np.linalg.norm(placed.vertices, axis=1), 100, rtol=1e-5)
    assert placed.volume == pytest.approx(4 / 3 * np.pi * 100**3, rel=0.05)
