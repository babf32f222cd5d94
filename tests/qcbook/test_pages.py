"""Figures, numbers and tables as pages show them."""

import base64
import io
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from IPython.display import Image
from matplotlib.image import imread

from qcbook import cells as pages


@pytest.fixture
def shown(monkeypatch):
    calls = []
    monkeypatch.setattr(pages, "display", lambda data, **options: calls.append((data, options)))
    return calls


def figure(dpi=100):
    fig, ax = plt.subplots(figsize=(3, 2), dpi=dpi)
    ax.plot([0, 1])
    fig.patch.set_alpha(0)
    return fig


def test_a_figure_has_twice_the_pixels_of_its_width_and_a_white_ground(shown):
    pages.show_figure(figure(), "fig-a", 'A "line" & more.')
    [(data, options)] = shown
    pixels = imread(io.BytesIO(base64.b64decode(data["image/png"])))
    width = options["metadata"]["image/png"]["width"]
    assert abs(pixels.shape[1] - 2 * width) <= 1 and 250 < width < 350
    assert np.array_equal(pixels[0, 0], [1, 1, 1, 1])
    assert f' width="{width}">' in data["text/html"] and 'alt="A &quot;line&quot; &amp; more."' in data["text/html"]
    assert data["image/png"] in data["text/html"]
    assert options["metadata"]["scrapbook"]["name"] == "fig-a"


def test_an_image_is_shown_at_its_own_width(shown):
    png, width = pages.drawn(figure())
    assert abs(pages.drawn(figure(), 1)[1] - pages.drawn(figure(), 3)[1]) <= 2  # whatever the sharpness
    pages.show_figure(Image(png), "fig-a", "A line.")
    assert abs(shown[0][1]["metadata"]["image/png"]["width"] - 2 * width) <= 1
    pages.show_figure(Image(png, width=120), "fig-a", "A line.")
    assert shown[1][1]["metadata"]["image/png"]["width"] == 120


def test_a_figure_without_a_description_is_refused():
    with pytest.raises(ValueError, match="'fig-a' has no description"):
        pages.show_figure(figure(), "fig-a", " ")
    plt.close("all")


def test_numbers_are_kept_as_plain_ones_with_their_cells(monkeypatch):
    monkeypatch.setattr(pages, "num", SimpleNamespace())
    pages.keep(error=np.float64(0.5), word="left", several=np.arange(2))
    assert (pages.num.error, pages.num.word, pages.num.several) == (0.5, "left", [0, 1])
    assert type(pages.num.error) is float
    monkeypatch.setattr(pages, "kept_by", {})
    for count in (3, 3, 5):
        monkeypatch.setattr(pages, "get_ipython", lambda count=count: SimpleNamespace(execution_count=count))
        pages.keep(error=count)
    assert pages.kept_by == {"error": {3, 5}}


def test_a_table_is_markdown():
    assert pages.table(["a", "b"], [["1", "2"]]).data == "| a | b |\n| --- | --- |\n| 1 | 2 |"
    folded = pages.table(["a"], [["1"]], "All of it").data
    assert folded == "<details><summary>All of it</summary>\n\n| a |\n| --- |\n| 1 |\n\n</details>"
