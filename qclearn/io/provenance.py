"""Where figures come from: the code's commit, the machine, the versions, the surfaces."""

import contextlib
import platform
import subprocess
import sys
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def commit():
    """The commit of the checkout this runs from, with "+changes" where files differ from it; "" outside of one."""

    def git(*words):
        return subprocess.run(["git", "-C", Path(__file__).parent, *words], capture_output=True, text=True, check=False)

    try:
        head = git("rev-parse", "HEAD")
        return head.stdout.strip() + "+changes" * bool(git("status", "--porcelain", "-uno").stdout.strip())
    except FileNotFoundError:  # no git
        return ""


def processor():
    """The processor's name where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def provenance():
    """Commit, day and processor of a measurement, dict."""
    return {"commit": commit(), "date": date.today().isoformat(), "processor": processor()}


def versions(*packages):
    """Versions of Python and of packages, dict; without those that are not installed."""
    found = {"python": platform.python_version()}
    for package in packages:
        with contextlib.suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def origin(inputs, curves, command):
    """Where a report.json comes from: dict of `inputs`, `landmarks` (a whole landmarks file), `versions`, `command`.

    inputs: side -> (path, surface as read); curves: landmarks as given; command: the words of the command line.
    """
    marks = {side: surface.fingerprint for side, (_, surface) in inputs.items()}
    return {
        "inputs": {side: {"path": path} | marks[side] for side, (path, _) in inputs.items()},
        "landmarks": {"curves": curves["curves"] if isinstance(curves, dict) else curves, "surfaces": marks},
        "versions": versions("qclearn", "numpy", "scipy", *(("torch",) if "torch" in sys.modules else ())),
        "command": command,
    }
