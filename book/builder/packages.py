"""Build the package as others install it: an sdist from a clean copy of this tree, and a wheel from
the sdist."""

import os
import shutil
import subprocess
import sys
import tarfile
import time
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUILD = "import sys; from setuptools.build_meta import build_sdist, build_wheel; build_{}(sys.argv[1])"


def build_packages(out):
    """(sdist, wheel) in the folder `out`."""
    out = Path(out)
    # A copy: setuptools keeps what it once built in the tree, and would pack files that are no
    # longer there.
    ignored = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "_build", "book", "dist", "tests")
    source = shutil.copytree(ROOT, out / "tree", ignore=ignored)
    shutil.copytree(ROOT / "book" / "qcbook", source / "book" / "qcbook", ignore=ignored)
    run_outside(sys.executable, "-c", BUILD.format("sdist"), out, cwd=source)
    (sdist,) = out.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(out, filter="data")
    run_outside(sys.executable, "-c", BUILD.format("wheel"), out, cwd=out / sdist.name.removesuffix(".tar.gz"))
    (wheel,) = out.glob("*.whl")
    return sdist, wheel


def installed_copy(folder):
    """The wheel's contents, unpacked into `folder`: put it on PYTHONPATH, and the package is what
    others install."""
    shutil.rmtree(folder, ignore_errors=True)
    _, wheel = build_packages(folder / "packages")
    with zipfile.ZipFile(wheel) as archive:
        for member in archive.infolist():
            # As old as its source: what numba compiled from the same file before is still good.
            made = time.mktime((*member.date_time, 0, 0, -1))
            os.utime(archive.extract(member, folder / "installed"), (made, made))
    return folder / "installed"


def run_outside(*words, cwd):
    """What a command prints that may not see this checkout."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    ran = subprocess.run(
        [str(word) for word in words], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stdout[-1000:] + ran.stderr[-3000:]
    return ran.stdout
