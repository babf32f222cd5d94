"""Where figures come from: the code's commit, the machine, the versions, the surfaces."""

import contextlib
import platform
import subprocess
import sys
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def commit():
    """The commit of the checkout this runs from, or "": with "+changes" where files differ."""

    def git(*arguments):
        command = ["git", "-C", Path(__file__).parent, *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()

    try:
        changes = "+changes" if git("status", "--porcelain", "-uno") else ""
        return git("rev-parse", "HEAD") + changes
    except OSError:  # no git, or none that may be run
        return ""


def processor():
    """The processor's name where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8", errors="replace").splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def provenance():
    """Commit, day and processor of a measurement, dict."""
    return {"commit": commit(), "date": date.today().isoformat(), "processor": processor()}


def versions(*packages):
    """Versions of Python and of packages, dict; without those that are not installed."""
    numbers = {"python": platform.python_version()}
    for package in packages:
        with contextlib.suppress(PackageNotFoundError):
            numbers[package] = version(package)
    return numbers


def origin(inputs, curves, command):
    """The origin in a report.json: dict of `inputs`, `landmarks`, `versions`, `command`.

    inputs: side -> (path, surface as read); curves: landmarks as given, held-out ones
    marked; command: the arguments of the command line.
    """
    marks = {side: surface.fingerprint for side, (_, surface) in inputs.items()}
    torch = ["torch"] if "torch" in sys.modules else []
    return {
        "inputs": {side: {"path": path} | marks[side] for side, (path, _) in inputs.items()},
        "landmarks": {"curves": curves, "surfaces": marks},
        "versions": versions("qclearn", "numpy", "scipy", *torch),
        "command": command,
    }
