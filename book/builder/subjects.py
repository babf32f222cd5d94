"""Where the synthetic subjects of tests and pages lie: a folder that they share, of one state of the code that grows
them, so that each subject is grown once."""

import hashlib
import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ALL = ROOT / "build" / "subjects"
GROWERS = "data_synth", "qclearn/plane", "qclearn/surfaces"


def folder():
    """The folder of this state of the code; those of other states are removed."""
    found = hashlib.sha256()
    for file in sorted(file for package in GROWERS for file in (ROOT / package).glob("*.py")):
        found.update(file.read_bytes())
    own = ALL / found.hexdigest()[:16]
    own.mkdir(parents=True, exist_ok=True)
    for other in set(ALL.iterdir()) - {own}:
        shutil.rmtree(other, ignore_errors=True)
    return own
