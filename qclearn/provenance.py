"""Where figures come from: the code's commit and the machine."""

import platform
import subprocess
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
