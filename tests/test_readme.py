"""The files that the README names are there; test_package.py runs its example, test_cli.py knows its commands."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_links_and_pictures_exist():
    targets = re.findall(r"\]\(([^)#]+)\)", README)
    assert "book/_assets/registration.png" in targets
    missing = [target for target in targets if "://" not in target and not (ROOT / target).exists()]
    assert missing == []
