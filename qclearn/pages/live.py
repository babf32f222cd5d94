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

import numpy as np

from .cells import drawn, picture_html

MODULES = Path(__file__).with_name("browser")  # in a checkout a link to book/_assets/live
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


def modules(names):
    """The texts of browser modules and of all that they import, name -> text, each after those that it imports."""
    if not MODULES.exists():
        raise FileNotFoundError(f"no explorables in {MODULES}, a link to book/_assets/live; install the package again")
    found = {}

    def add(name):
        if name not in found:
            text = (MODULES / name).read_text(encoding="utf-8")
            for other in IMPORT.findall(text):
                add(other)
            found[name] = text

    for name in names:
        add(name)
    return found


@functools.cache
def joined():
    """One module that holds all modules, for a place where relative addresses do not resolve."""
    explorables = sorted(path.name for path in MODULES.glob("explore_*.js"))
    return JOINED % json.dumps(modules(["lab.js", *explorables, "worker.js"]))


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
        return (
            f'<div class="qc-live" data-page="{self.live.page}">{picture_html(drawn(figure)[0], alt)}'
            f'<p class="qc-live-status" role="status">{html.escape(NOTE)}</p>{self.carried()}</div>'
        )

    def carried(self):
        """The files that are this page's own, for the site's script."""
        files = self.live.files() if self.live.own else {}
        return "".join(
            f'<script type="text/plain" data-file="{name}">{base64.b64encode(data).decode()}</script>'
            for name, data in files.items()
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

    own = False  # whether its files are made on its page, and stand in it; others lie beside the site's scripts

    def files(self):
        """Bytes that the browser needs, name -> bytes."""
        return {}

    def read(self, name, state, found):
        """What else the widget offers by name, from its state and what it found; map (V,): the map that is shown."""
        if name == "map" and "map" in found:
            return np.frombuffer(found["map"]).view(complex)
        raise AttributeError(name)


def loops():
    """The browser's inner loops, name -> bytes."""
    return {name: (MODULES / name).read_bytes() for name in ("kernels.wasm", "layers.wasm")}


def as_pairs(z):
    """Complex numbers as pairs."""
    return np.stack([z.real, z.imag], -1).tolist()


def explorable(live):
    """The widget of an explorable, as `explorable(Mobius())`; while the book is made, what its page holds instead."""
    return Page(live) if os.environ.get("QCLEARN_PAGES") == "static" else widget_class()(live)
