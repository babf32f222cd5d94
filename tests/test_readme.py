"""The files and commands that the README names are there; test_package.py runs its example."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_links_and_pictures_exist():
    targets = re.findall(r"\]\(([^)#]+)\)", README)
    assert "book/_assets/registration.png" in targets
    missing = [target for target in targets if "://" not in target and not (ROOT / target).exists()]
    assert missing == []


def test_named_commands_exist():
    listed = subprocess.run(
        [sys.executable, "-m", "qclearn", "--help"], capture_output=True, text=True, check=True
    ).stdout
    for command in set(re.findall(r"^\| `qclearn (\w+)", README, re.MULTILINE)):
        assert re.search(rf"^  {command}\b", listed, re.MULTILINE), command
