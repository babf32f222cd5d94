"""Explorables in notebooks: the book's browser modules as widgets whose state Python sees and sets.

On the site an explorable is an element of class `qc-live` that the page's own script brings to life; an executed page
holds that element and a picture, and no widget. In JupyterLab the same modules come through anywidget. JupyterLab
imports a widget from a blob, where relative addresses lead nowhere, so the modules are joined here, and files travel as
bytes.
"""

import base64
import functools
import html
import json
import os
import re
from pathlib import Path
from types import MappingProxyType

import numpy as np

from ..plane.mobius import mobius
from .cells import drawn

MODULES = Path(__file__).resolve().parents[2] / "book" / "_assets" / "live"
IMPORT = re.compile(r'from "\./([\w.]+)"')
JOINED = """const sources = %s;
const address = {};
for (const [name, text] of Object.entries(sources)) {
  const joined = text.replace(/from "\\.\\/([\\w.]+)"/g, (_, other) => `from "${address[other]}"`);
  address[name] = URL.createObjectURL(new Blob([joined], { type: "text/javascript" }));
}
let worker = null;
export default {
  async render(context) {
    const { render } = await import(address["lab.js"]);
    const { default: spec } = await import(address[`explore_${context.model.get("page")}.js`]);
    await render(context, spec, () => (worker ??= new Worker(address["worker.js"], { type: "module" })));
  },
};
"""
NOTE = (
    "This figure computes in your browser once its scripts have loaded. They need JavaScript and a web server: opened "
    "as a file, or without scripts, the page shows the picture alone. In JupyterLab, run the cell."
)


def modules():
    """The texts of the browser modules that a widget needs, name -> text, each after those that it imports."""
    if not MODULES.exists():
        raise FileNotFoundError(f"no explorables in {MODULES}: they come with the book; install from a clone of it")
    found = {}

    def add(name):
        if name not in found:
            text = (MODULES / name).read_text(encoding="utf-8")
            for other in IMPORT.findall(text):
                add(other)
            found[name] = text

    for path in [MODULES / "lab.js", *sorted(MODULES.glob("explore_*.js")), *MODULES.glob("worker.js")]:
        add(path.name)
    return found


@functools.cache
def joined():
    """One module that holds all modules, for a place where relative addresses do not resolve."""
    return JOINED % json.dumps(modules())


class Page:
    """What an executed page of the book holds in place of a widget: an element for the site's script, and a picture."""

    def __init__(self, live):
        self.live, self.state = live, dict(live.initial)

    def __getattr__(self, name):
        if name in self.live.initial:
            return self.state[name]
        raise AttributeError(name)

    def _repr_html_(self):
        figure, alt = self.live.picture(self.state)
        data = base64.b64encode(drawn(figure)[0]).decode()
        return (
            f'<div class="qc-live" data-page="{self.live.page}">'
            f'<img alt="{html.escape(alt)}" src="data:image/png;base64,{data}">'
            f'<p class="qc-live-status" role="status">{html.escape(NOTE)}</p></div>'
        )


@functools.cache
def widget_class():
    """anywidget's class for explorables, made when the first one is: the site's pages need none."""
    import anywidget
    import traitlets

    class Widget(anywidget.AnyWidget):
        """The explorable of a page of the book: `state` is what its controls say, `found` what it last answered."""

        _esm, _css = joined(), (MODULES / "live.css").read_text(encoding="utf-8")
        page = traitlets.Unicode().tag(sync=True)
        state, found, files = (traitlets.Dict().tag(sync=True) for _ in range(3))

        def __init__(self, live):
            super().__init__(page=live.page, state=dict(live.initial), files=live.files())
            self.live = live
            self.on_msg(self.asked)

        def asked(self, _, message, buffers):
            """The kernel's own answer to a state, for 'ask the kernel'."""
            try:
                self.send({"answers": message["ask"], "found": self.live.answer(message["state"])})
            except Exception as error:
                self.send({"answers": message["ask"], "error": str(error)})

        def __getattr__(self, name):
            if name in type(self).__dict__ or name.startswith("_") or "live" not in self.__dict__:
                raise AttributeError(name)
            if name in self.live.initial:
                return self.state[name]
            return self.live.read(name, self.state, self.found)

        def __setattr__(self, name, value):
            if "live" in self.__dict__ and name in self.live.initial:
                self.state = {**self.state, name: value}
            else:
                super().__setattr__(name, value)

    return Widget


class Live:
    """What Python knows of an explorable: where it starts, its files, its picture, and the library's answer to it."""

    def files(self):
        """Bytes that the browser needs, name -> bytes."""
        return {}

    def read(self, name, state, found):
        """What else the widget offers by name, from its state and what it found."""
        raise AttributeError(name)


class Mobius(Live):
    """Möbius maps of the disk, of the chapter on conformal maps."""

    page = "mobius"
    initial = MappingProxyType({"size": 0.4, "direction": 30.0, "turn": 0.0, "figure": "polar"})
    circle = 0.5 + 0.2 * np.exp(2j * np.pi * np.arange(181) / 180)

    @staticmethod
    def parameters(state):
        """(a, theta) of the map."""
        return state["size"] * np.exp(1j * np.radians(state["direction"])), np.radians(state["turn"])

    def read(self, name, state, found):
        if name in ("a", "theta"):
            return self.parameters(state)[name == "theta"]
        return super().read(name, state, found)

    def answer(self, state):
        """Centre and radius of what the red circle becomes, from three of its points."""
        p, q, r = mobius(self.circle[[0, 60, 120]], *self.parameters(state))
        w = (r - p) / (q - p)
        centre = (q - p) * (w - abs(w) ** 2) / (2j * w.imag) + p
        return {"centre": [centre.real, centre.imag], "radius": abs(p - centre)}

    def picture(self, state):
        """A Matplotlib figure of the disk and its image, and a description."""
        from matplotlib.figure import Figure

        from .plot import disk_axes, lines_plot

        figure = Figure(figsize=(6.4, 3.3))
        t, radii = np.exp(2j * np.pi * np.arange(181) / 180), np.linspace(0, 1, 31)
        lines = [*(r * t for r in (0.2, 0.4, 0.6, 0.8, 1)), *(radii * t[k] for k in range(0, 180, 15))]
        a, theta = self.parameters(state)
        views = ("the disk and the pole a", lambda z: z, a), ("its image", lambda z: mobius(z, a, theta), 0)
        for ax, (title, view, pole) in zip(figure.subplots(1, 2), views):
            disk_axes(ax)
            lines_plot(ax, [view(line) for line in lines], "#1F4E79")
            ax.plot(view(self.circle).real, view(self.circle).imag, color="#B22222", linewidth=2)
            ax.plot(np.real(pole), np.imag(pole), "o", color="#E69F00")
            ax.set_title(title, fontsize=10)
        return figure, "A polar grid of the disk with a red circle, and its image by a Möbius map: circles all."


def explorable(live):
    """The widget of an explorable, as `explorable(Mobius())`; while the book is made, what its page holds instead."""
    return Page(live) if os.environ.get("QCLEARN_PAGES") == "static" else widget_class()(live)
