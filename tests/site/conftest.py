"""What the checks of the built site and of JupyterLab share: a browser, a web server, one JupyterLab."""

import functools
import shutil
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from types import SimpleNamespace

import pytest
from explorables import LISTEN
from laboratory import Notebook, Reader, jupyterlab
from places import COPIES, FLAGS, ROOT, SITE, chromium_path
from playwright.sync_api import sync_playwright


@pytest.fixture(scope="session")
def browser():
    path = chromium_path()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def window(browser):
    """One window for all pages of the site: what they share is fetched and compiled once."""
    window = browser.new_context()
    yield window
    window.close()


@pytest.fixture(scope="session")
def silent_window(browser):
    """One where scripts are off."""
    window = browser.new_context(java_script_enabled=False)
    yield window
    window.close()


class QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, *arguments):
        pass


@pytest.fixture(scope="session")
def site_address():
    handler = functools.partial(QuietHandler, directory=SITE)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture(scope="session")
def lab(browser, tmp_path_factory):
    """JupyterLab on copies/ (the executed pages), sources/ (book/) and planted/: its address, and the folder."""
    home = tmp_path_factory.mktemp("lab")
    root = home / "pages"
    shutil.copytree(COPIES, root / "copies") if COPIES.exists() else (root / "copies").mkdir(parents=True)
    shutil.copytree(ROOT / "book", root / "sources", ignore=shutil.ignore_patterns("_assets", ".ipynb_checkpoints"))
    (root / "planted").mkdir()
    with jupyterlab(home, root) as address:
        yield SimpleNamespace(address=address, home=home, root=root)


@pytest.fixture(scope="session")
def reader(browser, lab):
    return Reader(browser, lab.address)


@pytest.fixture(scope="session")
def notebook(browser, lab):
    """A notebook for all widgets in JupyterLab: one page and one kernel."""
    notebook = Notebook(browser, lab, "widgets", "import json\nfrom qcbook import *", LISTEN)
    yield notebook
    notebook.page.close()
