"""Explorables in notebooks: the book's browser modules as widgets whose state Python sees and sets.

An executed page holds a picture and an element of class `qc-live`, which the site's script brings
to life. JupyterLab runs the same modules through anywidget: it imports a widget from a blob, where
relative addresses lead nowhere, so the modules are joined here, and files travel as bytes.
"""

import base64
import functools
import html
import json
import os
import re
from pathlib import Path

import anywidget
import numpy as np
import traitlets
from IPython.display import HTML, display
from matplotlib.figure import Figure

import qcbook as pages
from qcbook.figures import picture_html
from qclearn.plane.disk import pairs
from qclearn.plane.grids import COARSE, FINE, POWER
from qclearn.plot import disk_axes

from .cells import drawn

MODULES = Path(__file__).with_name("browser")  # in a checkout a link to book/_assets/live
GIVEN = "given.js"  # the library writes it: `given`
IMPORT = re.compile(r'from "\./([\w.]+)"')
JOINED = """const sources = %s;
const address = {};
for (const [name, text] of Object.entries(sources)) {
  const joined = text.replace(/from "\\.\\/([\\w.]+)"/g, (_, other) => `from "${address[other]}"`);
  address[name] = URL.createObjectURL(new Blob([joined], { type: "text/javascript" }));
}
const workers = {};
export default {
  async render(context) {
    const { render } = await import(address["lab.js"]);
    const { default: spec } = await import(address[`explore_${context.model.get("page")}.js`]);
    const make = () => new Worker(address["worker.js"], { type: "module" });
    await render(context, spec, (name) => (workers[name] ??= make()));
  },
};
"""
NOTE = (
    "This figure computes in your browser once its scripts have loaded. They need JavaScript and "
    "a web server: opened "
    "as a file, or without scripts, the page shows the picture alone. In JupyterLab, run the cell."
)


@functools.cache
def given():
    """The text of `given.js`: the library's constants, and each explorable's initial state."""
    classes = [getattr(pages, name) for name in pages.EXPLORABLES]
    initial = {live.page: dict(live.initial) for live in classes}
    constants = {"POWER": POWER, "FINE": FINE, "COARSE": COARSE, "INITIAL": initial, "GRID": dict(pages.Tuner.grid)}
    return "".join(f"export const {name} = {json.dumps(value)};\n" for name, value in constants.items())


def modules(names):
    """Browser modules and all their imports, name -> text, imported ones first."""
    if not MODULES.exists():
        raise FileNotFoundError(f"no explorables in {MODULES}, a link to book/_assets/live; install the package again")
    found = {}

    def add(name):
        if name not in found:
            text = given() if name == GIVEN else (MODULES / name).read_text(encoding="utf-8")
            for other in IMPORT.findall(text):
                add(other)
            found[name] = text

    for name in names:
        add(name)
    return found


@functools.cache
def joined():
    """All modules in one, for places without relative addresses."""
    explorables = sorted(path.name for path in MODULES.glob("explore_*.js"))
    return JOINED % json.dumps(modules(["lab.js", *explorables, "worker.js"]))


class Page:
    """An explorable on an executed page: an element for the site's script, and a picture."""

    def __init__(self, live):
        self.live, self.state = live, dict(live.initial)

    def _repr_html_(self):
        figure, alt = self.live.picture(self.state)
        return (
            f'<div class="qc-live" data-page="{self.live.page}">{picture_html(drawn(figure)[0], alt)}'
            f'<p class="qc-live-status" role="status">{html.escape(NOTE)}</p>{self.carried()}</div>'
        )

    def carried(self):
        """This page's own files, for the site's script."""
        files = self.live.files() if self.live.own else {}
        return "".join(
            f'<script type="text/plain" data-file="{name}">{base64.b64encode(data).decode()}</script>'
            for name, data in files.items()
        )


class Explorer(anywidget.AnyWidget):
    """The widget of an explorable: `state` of its controls, and its last answer `found`."""

    _esm, _css, page = (traitlets.Unicode().tag(sync=True) for _ in range(3))
    initial, state, found, files = (traitlets.Dict().tag(sync=True) for _ in range(4))

    def __init__(self, live):
        css = (MODULES / "live.css").read_text(encoding="utf-8")
        initial = dict(live.initial)
        super().__init__(_esm=joined(), _css=css, page=live.page, initial=initial, state=initial, files=live.files())
        self.live = live
        self.on_msg(self.asked)

    def asked(self, _, message, buffers):
        """The kernel's own answer to a state, for 'ask the kernel'."""
        try:
            self.send({"answers": message["ask"], "found": self.live.answer(message["state"])})
        except Exception as error:
            self.send({"answers": message["ask"], "error": str(error)})

    def set(self, **state):
        """Move controls: explorer.set(gamma=1e4)."""
        self.state = {**self.state, **state}

    @property
    def map(self):
        """The map that is shown, complex values (V,) at the vertices."""
        return np.frombuffer(self.found["map"]).view(complex)


class Live:
    """Python's part of an explorable: its initial state, files, picture, and the library's answer."""

    own = False  # whether its page makes and holds its files; others lie beside the site's scripts

    def files(self):
        """Bytes that the browser needs, name -> bytes: the inner loops in WebAssembly."""
        return {name: (MODULES / name).read_bytes() for name in ("kernels.wasm", "layers.wasm")}


def as_pairs(z):
    """Complex numbers as pairs, lists."""
    return pairs(z).tolist()


def two_disks(*titles):
    """A Matplotlib figure of two disks with titles, and its two Axes."""
    figure = Figure(figsize=(6.4, 3.3))
    axes = [disk_axes(ax) for ax in figure.subplots(1, 2)]
    for ax, title in zip(axes, titles):
        ax.set_title(title, fontsize=10)
    return figure, axes


def explorable(live):
    """The widget of an explorable, as `explorable(Mobius())`; a `Page` while the book is made."""
    if os.environ.get("QCLEARN_PAGES") == "static":
        return Page(live)
    sign = display(HTML("<p>The figure's files are being made: some seconds ...</p>"), display_id=True)
    try:
        return Explorer(live)
    finally:
        if sign:  # None outside notebooks
            sign.update(HTML(""))
