"""The core path's pictures: parts of the figures that executed pages show."""

import base64
import io

import nbformat
from nbformat.v4 import new_code_cell, new_notebook, new_output
from PIL import Image

from book.builder import core


def test_a_part_of_a_figure_becomes_a_small_picture(tmp_path, monkeypatch):
    buffer = io.BytesIO()
    sheet = Image.new("RGB", (1200, 500), "white")
    sheet.paste("black", (360, 100, 840, 450))
    sheet.save(buffer, "PNG")
    shown = new_output("display_data", {"image/png": base64.b64encode(buffer.getvalue()).decode()})
    shown.metadata["scrapbook"] = {"name": "fig-x"}
    nbformat.write(new_notebook(cells=[new_code_cell("1", outputs=[shown])]), tmp_path / "page.ipynb")
    text = "![x](_assets/thumbs/fig-x@30-20-70-90.png) ![y](_assets/thumbs/fig-y.png)"
    monkeypatch.setattr(core, "markdown_of", lambda page: text)
    core.write_thumbs(tmp_path)
    (made,) = (tmp_path / "_assets" / "thumbs").iterdir()
    with Image.open(made) as picture:
        assert made.name == "fig-x@30-20-70-90.png" and picture.getextrema() == ((0, 0),) * 3
        assert picture.size == (480, 350)
