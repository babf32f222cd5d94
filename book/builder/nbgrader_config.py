"""nbgrader's settings for this course. Run its commands in the folder of this file.

Grading runs the students' code with your rights: what you do not trust, grade in a container.
"""

import os
import re
import sys
from pathlib import Path

import nbformat
from nbgrader.nbgraderformat import MetadataValidator
from nbgrader.plugins import FileNameCollectorPlugin

SECONDS = 30  # per cell: an endless loop ends there, and its test counts as failed
GB = 4  # memory of a hand-in, where the system limits it: on Linux
STUDENT = re.compile(r"\w[\w.@' -]*")  # nbgrader's csv takes no comma in a name, its search no bracket
TOO_SLOW = f"This cell takes longer than {SECONDS} s: does a loop in it, or in what it calls, never end?"
# Runs in each hand-in's kernel before its cells. nbgrader gives no points where a test prints a
# warning.
BEFORE = f"""
import resource, sys
sys.stderr = sys.stdout
try:
    resource.setrlimit(resource.RLIMIT_AS, ({GB * 2**30}, {GB * 2**30}))
except (OSError, ValueError):
    pass  # macOS limits no memory
"""


class HandIns(FileNameCollectorPlugin):
    """Collects `NAME.ipynb` for the student NAME; what cannot be graded is refused in a line and
    left out."""

    def collect(self, submitted_file):
        path = Path(submitted_file)
        assignment = self.parent.coursedir.assignment_id
        try:
            missing = self.missing_cells(path, assignment)
        except Exception as error:  # whatever a file holds, the others are collected
            reason = f"{error}".partition("\n")[0][:200]
            self.log.error("%s: not collected: %s", path.name, reason or type(error).__name__)
            return None
        if missing:
            self.log.error("%s: 0 points where cells are missing: %s", path.name, ", ".join(missing))
        return {"student_id": path.stem, "file_id": assignment}

    def missing_cells(self, path, assignment):
        """The cells of the release that a hand-in lacks; ValueError, or nbformat's error, if it
        cannot be graded."""
        if path.suffix != ".ipynb":
            raise ValueError("the name has to end in .ipynb: rename the file if it is a notebook")
        if not STUDENT.fullmatch(path.stem):
            raise ValueError("rename the file: letters, digits, and . @ ' - _ or spaces between them")
        released = Path(self.parent.coursedir.format_path("release", ".", assignment), f"{assignment}.ipynb")
        cells = graded_cells(released)
        missing = [cell for cell in cells if cell not in graded_cells(path)]
        if missing == cells:
            raise ValueError(f"no cell of {released.name} is in it: copy the answers into that notebook")
        return missing


def graded_cells(path):
    """The names of the cells that nbgrader knows in a notebook, in order; ValueError if it cannot
    read them."""
    try:
        notebook = nbformat.read(path, as_version=4)
        MetadataValidator().validate_nb(notebook)
    except Exception as error:
        reason = f"{error}".partition("\n")[0][:120]
        raise ValueError(f"this is not a notebook that nbgrader reads ({reason or type(error).__name__})") from None
    return [cell.metadata.nbgrader.grade_id for cell in notebook.cells if "nbgrader" in cell.metadata]


# nbgrader makes its gradebook with the program alembic, beside Python. If PATH lacks it, the first
# command fails and leaves a gradebook without its version, which later commands take.
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])

c = get_config()  # noqa: F821
c.CourseDirectory.root = str(Path(__file__).resolve().parent)
c.Application.log_level = "ERROR"  # what went wrong, not each file that is copied

# The release has the blanks of the book's pages.
c.ClearSolutions.code_stub = {"python": "...  # your lines here"}
c.ClearSolutions.text_stub = "*Your answer here.*"

# `nbgrader zip_collect` takes one notebook per student from downloaded/ASSIGNMENT/archive/.
c.ZipCollectApp.collector_plugin = HandIns

c.Execute.timeout = SECONDS
c.Execute.iopub_timeout = SECONDS  # a busy machine prints late,
c.Execute.raise_on_iopub_timeout = False  # and a loop that takes no interrupt never ends: its tests fail, too
c.Execute.error_on_timeout = {"ename": "Timeout", "evalue": TOO_SLOW, "traceback": [TOO_SLOW]}
c.Execute.extra_arguments = [f"--InteractiveShellApp.exec_lines=exec({BEFORE!r}, {{}})", "--log-level=40"]
