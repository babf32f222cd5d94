"""Make the annotated tag of a release: v<version> of pyproject.toml, with its part of CHANGELOG.md
as the message.

Refused where the tree has changes that are not committed, where CHANGELOG.md does not begin with
this version, or where the tag is there already. Nothing is pushed.
"""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def git(folder, *words, **options):
    """What git says; what it complains of ends the program."""
    ran = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False, **options)
    if ran.returncode:
        sys.exit(f"tag: git {words[0]}: {ran.stderr.strip()}")
    return ran.stdout.strip()


def tag(folder=ROOT):
    """Tag the last commit of a folder's repository: the tag's name."""
    version = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    name = f"v{version}"
    _, *parts = re.split(r"^## ", (folder / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    heading, _, changes = parts[0].partition("\n")
    if heading.split()[0] != version:
        sys.exit(f"tag: CHANGELOG.md begins with {heading!r}, pyproject.toml has {version}: give both the new version")
    if changed := git(folder, "status", "--porcelain"):
        sys.exit(f"tag: not committed: {', '.join(line.split(maxsplit=1)[1] for line in changed.splitlines())}")
    if git(folder, "tag", "--list", name):
        sys.exit(f"tag: {name} is there already, at {git(folder, 'rev-list', '-1', name)[:9]}: raise the version")
    git(
        folder,
        "tag",
        "--annotate",
        "--cleanup=verbatim",
        "--file=-",
        name,
        input=f"qclearn {version}\n\n{changes.strip()}\n",
    )
    return name


if __name__ == "__main__":
    made = tag()
    print(f"{made} is at {git(ROOT, 'rev-parse', '--short', 'HEAD')}; to publish it: git push origin {made}")
