"""The core path, ten steps for readers with two evenings: its place in the contents and on its
pages, and what the tiles of the first page show of them."""

import base64
import io
import json
import re

from docutils import nodes
from PIL import Image
from sphinx.addnodes import pending_xref
from sphinx.util.docutils import SphinxRole

from .reading import minutes
from .references import markdown_of

CORE = ("firstregistration", "quasiconformal", "lbs", "freeboundary", "conformal", "registration")
CORE += ("fit", "live", "worth", "whennetwork")
STAR = " ★"
# A figure, or a part of it: fig-name@0-10-50-90 is from 0 to 50 % of its width and from 10 to 90 % of its height.
THUMB, WIDTH = re.compile(r"_assets/thumbs/((fig-[\w-]+)(?:@(\d+)-(\d+)-(\d+)-(\d+))?)\.png"), 480


def write_thumbs(executed):
    """Small pictures of the figures that the first page names, from the executed pages in a folder."""
    folder, shown = executed / "_assets" / "thumbs", {}
    for path in executed.glob("*.ipynb"):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        for output in (output for cell in cells for output in cell.get("outputs", [])):
            if name := output.get("metadata", {}).get("scrapbook", {}).get("name"):
                shown[name] = output["data"]["image/png"]
    folder.mkdir(parents=True, exist_ok=True)
    for file, figure, *edges in THUMB.findall(markdown_of("index")):
        if figure in shown:
            picture = Image.open(io.BytesIO(base64.b64decode(shown[figure]))).convert("RGB")
            if all(edges):
                picture = picture.crop([int(edge) * side / 100 for edge, side in zip(edges, 2 * picture.size)])
            picture.thumbnail((WIDTH, WIDTH))
            picture.save(folder / f"{file}.png", optimize=True)


class Minutes(SphinxRole):
    """{minutes}`page`: how long it is to read."""

    def run(self):
        return [nodes.Text(f"{round(minutes(self.text))} min")], []


def strip(page, **links):
    """A page's place on the core path, and links by the words before them."""
    place = nodes.strong("", f"Core {CORE.index(page) + 1} of {len(CORE)}")
    found = nodes.paragraph("", "", place, classes=["core-strip"])
    for words, other in links.items():
        to = {"refdomain": "std", "reftype": "doc", "reftarget": other, "refdoc": page, "refexplicit": False}
        found += [nodes.Text(f" · {words}: "), pending_xref("", nodes.inline("", other), **to)]
    return found


def mark(app, doctree):
    """Put a page's place on the core path below its title and at its end, with links along the path."""
    page = app.env.docname
    if page not in CORE:
        return
    k, section = CORE.index(page), next(doctree.findall(nodes.section))
    before, after = ({"before": CORE[k - 1]} if k else {}), {"next": (*CORE, "ownbrain")[k + 1]}
    section.insert(1, strip(page, **before, **after))
    section += strip(page, **before, **after)


def star(app, env):
    """Mark the core pages in the contents."""
    for page in set(CORE) & set(env.tocs):
        words = next(env.tocs[page].findall(nodes.reference))
        if not words.astext().endswith(STAR):
            words += nodes.Text(STAR)


def setup(app):
    app.add_role("minutes", Minutes())
    app.connect("doctree-read", mark)
    app.connect("env-updated", star)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
