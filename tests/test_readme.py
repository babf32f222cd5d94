"""The README's example runs as printed, and the files that it points to are there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"\d+\.\d+")


def test_the_example_runs_as_printed(tmp_path):
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    ran = subprocess.run([sys.executable, "-c", example], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    (printed,) = re.findall(r"It prints\n\n```text\n(.*?)```", README, re.DOTALL)
    assert NUMBER.split(ran.stdout) == NUMBER.split(printed)
    assert [*map(float, NUMBER.findall(ran.stdout))] == pytest.approx([*map(float, NUMBER.findall(printed))], abs=0.11)
    before, after = map(float, re.search(r"landmark error ([\d.]+) -> ([\d.]+)", ran.stdout).groups())
    assert 0 < after < before / 4
    assert "bijective: True" in ran.stdout
    assert (tmp_path / "registered.ply").stat().st_size > 0


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
