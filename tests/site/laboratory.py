"""A JupyterLab of the tests' own, and a reader that opens notebooks in it and says what is to be seen."""

import contextlib
import json
import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import nbformat
import pytest
from nbformat.sign import NotebookNotary
from nbformat.v4 import new_code_cell, new_notebook
from view import Tab

SETTINGS = {
    "apputils-extension/notification": '{"fetchNews": "false", "checkForUpdates": false}',
    # All cells of a page are built at once, not only those in view; a kernel ends with its notebook.
    "notebook-extension/tracker": '{"windowingMode": "none", "kernelShutdown": true}',
}
NBGRADER = ("assignment_list", "course_list", "formgrader", "validate_assignment")
IDLE = "#jp-main-statusbar :text-matches('[|] Idle')"


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait_until_it_answers(server, address, log, seconds=60):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            with urllib.request.urlopen(address + "api/status", timeout=5):
                return
        except (urllib.error.URLError, ConnectionError):
            assert server.poll() is None, f"JupyterLab ended:\n{log.read_text()}"
            time.sleep(0.3)
    pytest.fail(f"JupyterLab did not answer within {seconds} s:\n{log.read_text()}")


def sign(home, paths):
    """Let the JupyterLab of this home trust notebooks, as `make lab-copies` lets the reader's own."""
    (home / "data").mkdir(exist_ok=True)  # where there is no folder, signatures stay in memory
    notary = NotebookNotary(data_dir=str(home / "data"))
    for path in paths:
        notary.sign(nbformat.read(path, as_version=4))


@contextlib.contextmanager
def jupyterlab(home, root):
    """The address of a JupyterLab on `root`, with nobody's settings but its own."""
    for name, text in SETTINGS.items():
        file = home / "settings" / "@jupyterlab" / f"{name}.jupyterlab-settings"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    # nbgrader's extensions take seconds to load, and no page needs them.
    (home / "config").mkdir(exist_ok=True)
    without = {f"nbgrader.server_extensions.{name}": False for name in NBGRADER}
    config = {"ServerApp": {"jpserver_extensions": without}}
    (home / "config" / "jupyter_server_config.json").write_text(json.dumps(config))
    places = {
        "JUPYTER_CONFIG_DIR": "config", "JUPYTER_DATA_DIR": "data", "JUPYTER_RUNTIME_DIR": "runtime",
        "JUPYTERLAB_SETTINGS_DIR": "settings", "JUPYTERLAB_WORKSPACES_DIR": "workspaces", "IPYTHONDIR": "ipython",
    }  # fmt: skip
    environment = os.environ | {name: str(home / place) for name, place in places.items()}
    port = free_port()
    options = f"--no-browser --allow-root --ServerApp.ip=127.0.0.1 --ServerApp.port={port} --ServerApp.port_retries=0"
    options += " --IdentityProvider.token= --LabApp.expose_app_in_browser=True"
    command = [sys.executable, "-m", "jupyterlab", *options.split(), f"--ServerApp.root_dir={root}"]
    log = home / "lab.log"
    with log.open("w") as output:
        server = subprocess.Popen(command, env=environment, stdout=output, stderr=subprocess.STDOUT)
        try:
            wait_until_it_answers(server, f"http://127.0.0.1:{port}/", log)
            yield f"http://127.0.0.1:{port}/"
        finally:
            server.terminate()
            try:
                server.wait(30)
            except subprocess.TimeoutExpired:  # it waits for a kernel that is busy; the kernel ends with its server
                server.kill()
                server.wait(30)


def wait_until_idle(page, seconds=120):
    # The status bar tells the truth; the notebook's own indicator says 'idle' before there is a kernel.
    page.wait_for_selector(IDLE, timeout=1000 * seconds)


# Opens a notebook; with the kernel of the first one where it needs none of its own, since a kernel
# takes a second to start.
OPEN = """async ([path, own_kernel]) => {
  const kernel = own_kernel || !window.idleKernel ? undefined : window.idleKernel;
  const panel = await window.jupyterapp.commands.execute('docmanager:open', {path, factory: 'Notebook', kernel});
  await Promise.all([panel.context.ready, panel.revealed]);
  window.panel = panel;
}"""
# What a page shows, cell by cell; null while a Markdown cell is not rendered.
LOOK = """() => [...window.panel.content.node.querySelectorAll('.jp-Cell')].map(cell => {
  const markdown = cell.classList.contains('jp-MarkdownCell');
  const area = cell.querySelector(markdown ? '.myst' : '.jp-Cell-outputWrapper');
  if (!area) return null;
  const all = (place, what) => [...area.querySelectorAll(place)].map(what);
  return {
    text: area.innerText,
    // jupyterlab_myst shows the value of {eval} as a span without any attribute;
    // so do formulas and code in their insides.
    numbers: (markdown ? all('span:not(.katex *, pre *, code *)', e => e) : [])
      .filter(e => e.attributes.length + e.childElementCount === 0).map(e => e.textContent.trim()),
    // What it cannot resolve has a warning sign; links to the outside have a sign of their own.
    unknown: all('span, a:not([href^=http])', e => e.querySelector(':scope > svg') && e.innerText.trim())
        .filter(text => text),
    errors: all('[data-mime-type*=stderr], [data-mime-type*=error]', e => e.innerText),
    figures: all('img.page-figure', e => [e.alt, e.naturalWidth]),
    // A scene waits behind its poster, which has its place.
    scenes: all('iframe.scene', e => [e.hidden ? e.previousElementSibling : e, e.parentElement])
        .map(([scene, cell]) => scene.offsetWidth / cell.offsetWidth),
    broken: all('img', e => e.complete && !e.naturalWidth && (e.alt || e.src)).filter(text => text),
  };
})"""


RUN_ALL = "() => void window.jupyterapp.commands.execute('notebook:run-all-cells')"
ADD = """async source => {
  const {content, context: {model: {sharedModel}}} = window.panel;
  sharedModel.insertCell(sharedModel.cells.length, {cell_type: 'code', source});
  content.activeCellIndex = sharedModel.cells.length - 1;
  await window.jupyterapp.commands.execute('notebook:run-cell');
}"""
RUN = """async code => {
  const kernel = window.panel.sessionContext.session.kernel, future = kernel.requestExecute({code});
  let text = '';
  future.onIOPub = ({header, content}) => {
    if (header.msg_type === 'stream') text += content.text;
    if (header.msg_type === 'error') text += `${content.ename}: ${content.evalue}`;
  };
  await future.done;
  return text.trim();
}"""


class Notebook(Tab):
    """A notebook of the tests' own in JupyterLab, with a kernel that has run its first cell."""

    def __init__(self, window, lab, name, code, script=None):
        """code: the first cell; script: what the page runs before its own scripts."""
        notebook = new_notebook(
            metadata={"kernelspec": {"name": "python3", "display_name": "Python 3"}}, cells=[new_code_cell(code)]
        )
        nbformat.write(notebook, lab.root / "planted" / f"{name}.ipynb")
        super().__init__(window, lab.address, "lab?reset", script=script)
        self.page.wait_for_function("() => window.jupyterapp", timeout=60_000)
        self.page.evaluate("() => window.jupyterapp.restored")
        self.page.evaluate(OPEN, [f"planted/{name}.ipynb", True])
        wait_until_idle(self.page)
        self.page.evaluate("() => window.jupyterapp.commands.execute('notebook:run-all-cells')")
        wait_until_idle(self.page)

    def add(self, code):
        """A cell with code at the end, run."""
        self.page.evaluate(ADD, code)

    def run(self, code):
        """What the kernel prints for a line of code that stands in no cell."""
        return self.page.evaluate(RUN, code)

    def until(self, condition, seconds=20):
        """Wait for what is on its way to the kernel."""
        deadline = time.monotonic() + seconds
        while (seen := self.run(f"print({condition})")) != "True":
            assert time.monotonic() < deadline, f"{condition}: {seen}"
            self.page.wait_for_timeout(100)


class Reader:
    """One browser window with JupyterLab; opens notebooks one after the other."""

    def __init__(self, browser, address):
        self.page = browser.new_page(viewport={"width": 1300, "height": 2400})
        self.page.goto(f"{address}lab?reset")
        self.page.wait_for_function("() => window.jupyterapp", timeout=60_000)
        self.page.evaluate("() => window.jupyterapp.restored")

    def read(self, path):
        """What a notebook shows when it is opened, without running anything."""
        self.page.evaluate(OPEN, [path, False])
        seen = self.settled()
        self.close(keep_kernel=True)
        return seen

    def open(self, path):
        """A notebook with a kernel of its own."""
        self.page.evaluate(OPEN, [path, True])
        wait_until_idle(self.page)

    def run(self, path, seconds=300):
        """What a notebook shows after 'Run All Cells'."""
        self.open(path)
        self.page.evaluate("() => window.jupyterapp.commands.execute('notebook:run-all-cells')")
        wait_until_idle(self.page, seconds)
        seen = self.settled()
        self.close()
        return seen

    def settled(self, seconds=60):
        """What is to be seen once it does not change any more."""
        deadline, before = time.monotonic() + seconds, None
        while time.monotonic() < deadline:
            now = self.page.evaluate(LOOK)
            if now and now == before and None not in now:
                return now
            before = now
            self.page.wait_for_timeout(200)
        pytest.fail(f"not rendered within {seconds} s: {before}")

    def close(self, keep_kernel=False):
        self.page.evaluate(
            """keep => {
          if (keep && !window.idleKernel && window.panel.sessionContext.session) {
            window.idleKernel = window.panel.sessionContext.session.kernel.model;
            window.firstPanel = window.panel;
          } else if (window.panel !== window.firstPanel) window.panel.dispose();
        }""",
            keep_kernel,
        )
