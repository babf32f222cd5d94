"""Where the built site and the copies for JupyterLab lie, and how Chromium is started: without a network."""

import os
import shutil
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "_build" / "html"
EXECUTED = ROOT / "build" / "book"
COPIES = ROOT / "build" / "lab"
# Of pages that went into another one: what is built there only leads on.
REDIRECTS = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))["sphinx"]["config"]["redirects"]
FLAGS = [
    *("--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"),
    # No name resolves: a page that asks for anything outside this machine gets an error, and the test hears of it.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
]


def chromium_path():
    candidates = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"]
    found = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, candidates)), None)
    if found is None:
        message = (
            "NO CHROMIUM: the site and the live page are NOT checked. "
            "On Debian: apt-get install chromium; elsewhere set CHROMIUM=/path/to/it"
        )
        (pytest.fail if os.environ.get("REQUIRE_CHROMIUM") else pytest.skip)(message)
    return found
