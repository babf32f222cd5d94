"""3-D scenes: self-contained, described, light, and no crash where nothing can draw."""

import html
import re
import zlib

import numpy as np
import pytest
import pyvista as pv

from qcbook import scenes
from qcbook.scenes import RendererError, Scene, require_renderer


def ball():
    require_renderer()
    surface = pv.Icosphere(nsub=3)
    surface["height"] = surface.points[:, 2].astype(np.float64)
    surface["noise"] = np.random.default_rng(0).normal(size=(surface.n_points, 50))
    plotter = pv.Plotter(off_screen=True)
    plotter.add_mesh(surface, scalars="height")
    return surface, plotter


def test_scene_is_one_page_that_asks_for_nothing():
    scene = Scene(ball()[1], 'a "ball" <round>')
    markup = scene._repr_html_()
    assert 'title="a &quot;ball&quot; &lt;round&gt;"' in markup
    assert markup.startswith('<iframe class="scene" width="100%" ')
    assert "OfflineLocalView.load" in html.unescape(markup)
    assert not re.search(r'(?:src|href)\s*=\s*"https?://', scene.page)
    assert not re.search(r"\.p\+.[0-9a-f]+\.(?:jpg|png)", scene.page)


def test_digits_that_nobody_sees_do_not_travel():
    values = np.random.default_rng(0).normal(size=10_000)
    rounded = scenes._rounded(values, 256)
    assert 256 <= np.ptp(rounded) / np.diff(np.unique(rounded)).min() <= 512
    assert len(zlib.compress(rounded.tobytes())) < 0.5 * len(zlib.compress(values.astype(np.float32).tobytes()))
    np.testing.assert_array_equal(scenes._rounded(np.full(3, 0.3), 256), np.float32([0.3, 0.3, 0.3]))


def test_legend_is_written_over_the_scene():
    page = Scene(ball()[1], "a ball", legend={"target <1>": "#D62728"}).page
    legend = page[page.index("OfflineLocalView.load(container") :]
    assert "color:#D62728" in legend and "target &lt;1&gt;</div>" in legend and legend.rstrip().endswith("</html>")
    assert "D62728" not in Scene(ball()[1], "a ball").page


def test_poster_waits_for_a_click():
    markup = Scene(ball()[1], "a ball", poster=True)._repr_html_()
    button = '<button [^>]*style="[^"]*width:100%[^>]*><img alt="a ball" [^>]*src="data:image/png;base64,'
    assert re.search(button, markup)
    assert "srcdoc=" not in markup.replace("f.srcdoc=f.dataset.page", "") and "data-page=" in markup


def shown_arrays(plotter):
    scenes._keep_what_is_shown(plotter)
    mapper = next(iter(plotter.actors.values())).mapper
    mapper.Update()
    plotter.close()
    return mapper.dataset.points, dict(mapper.dataset.point_data)


def test_only_what_is_shown_travels():
    surface, plotter = ball()
    points, arrays = shown_arrays(plotter)
    assert points.dtype == arrays["height"].dtype == np.float32 and list(arrays) == ["height"]
    pairs = (points, surface.points), (arrays["height"], surface["height"])
    for (shown, exact), steps in zip(pairs, (scenes.POINT_STEPS, scenes.VALUE_STEPS)):
        assert abs(shown - exact).max() <= np.ptp(exact) / steps / 2 + 1e-7
    assert "noise" in surface.point_data, "the caller's surface was changed"


def test_a_surface_that_only_the_plotter_holds_keeps_its_colours():
    require_renderer()
    plotter = pv.Plotter(off_screen=True)
    plotter.add_mesh(pv.Icosphere(nsub=3), scalars=np.arange(642.0), show_scalar_bar=False)
    points, arrays = shown_arrays(plotter)
    assert len(points) == 642 and [len(array) for array in arrays.values()] == [642]


def without_screen(monkeypatch, libraries, egl_device):
    monkeypatch.setattr(scenes.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "")  # so that monkeypatch restores it afterwards
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW")
    monkeypatch.setattr(scenes, "_egl_finds_a_device", lambda: egl_device)
    monkeypatch.setattr(scenes, "_loads", lambda *names: next((name for name in names if name in libraries), None))


def test_what_can_draw_is_chosen_and_nothing_to_draw_with_is_said_before_vtk_crashes(monkeypatch):
    for libraries, egl_device, window in ([], True, "vtkEGL"), (["libOSMesa.so.8"], False, "vtkOSOpenGL"):
        without_screen(monkeypatch, libraries, egl_device)
        require_renderer()
        assert scenes.os.environ["VTK_DEFAULT_OPENGL_WINDOW"] == f"{window}RenderWindow"
    without_screen(monkeypatch, [], egl_device=False)
    with pytest.raises(RendererError, match="apt-get install libegl1"):
        require_renderer()
