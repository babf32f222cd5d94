"""Workbench's wb_command, for tests that let it judge what is written."""

import os
import re
import shutil
import subprocess

import pytest

_UNKNOWN = re.compile("Invalid|Unknown")  # as it writes of a structure and of a surface's type


def workbench(*words):
    """What wb_command prints, after it has ended without an error and without a warning."""
    command = shutil.which("wb_command")
    if command is None:
        message = "NO WORKBENCH: files are NOT checked by it. On Debian: apt-get install connectome-workbench"
        (pytest.fail if os.environ.get("REQUIRE_WORKBENCH") else pytest.skip)(message)
    found = subprocess.run([command, *map(str, words)], capture_output=True, text=True, check=False)
    assert found.returncode == 0 and "WARNING" not in found.stdout + found.stderr, found.stdout + found.stderr
    return found.stdout


def unknown(told):
    """What Workbench does not know of a file, by its -file-information."""
    return [line.split(":")[0] for line in told.splitlines() if _UNKNOWN.search(line)]
