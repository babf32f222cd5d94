"""What the core does without, and the one line that says how to get it."""

import subprocess
import sys

import pytest

from qclearn.io.extras import EXTRAS, require

# Runs a program in which one package cannot be found.
BLOCKED = "import sys; sys.modules[{!r}] = None; {}"


def last_line(package, program):
    """What a program says on stderr at its end where a package is missing."""
    ran = subprocess.run([sys.executable, "-c", BLOCKED.format(package, program)], capture_output=True, text=True)
    assert ran.returncode
    return ran.stderr.strip().splitlines()


@pytest.mark.parametrize("package, program, extra", [
    ("numba", "import data_synth", "synth"), ("skimage", "from data_synth.cortex import make_cortex", "synth"),
    ("numba", "from qclearn.benchmark import benchmark", "synth"), ("torch", "from qclearn.nets import load", "nets"),
    ("safetensors", "from qclearn.nets.weights import load", "nets"), ("torch", "import data_synth.training", "nets"),
    ("distributed", "from qclearn.benchmark import benchmark; benchmark('out.json')", "benchmark"),
    ("brainspace", "from qclearn.io.conte69 import conte69; conte69()", "conte69"),
    ("cat_surf", "from qclearn.benchmark.methods.spheres import inflated; inflated(None)", "peers"),
    ("jsonschema", "from qclearn.benchmark.measured import check_schema as f; f('o', {}, 'networks')", "benchmark"),
])  # fmt: skip
def test_the_library_names_the_extra_that_is_missing(package, program, extra):
    lines = last_line(package, program)
    assert lines[-1].endswith(f"need {package}, which is not installed: pip install 'qclearn[{extra}]'")
    assert lines[-1].startswith("ImportError: ")


@pytest.mark.parametrize("package, command, extra", [
    ("numba", ["synth", "--out", "out.npz"], "synth"),
    ("torch", ["train", "dbsnet", "--quick", "--out", "out"], "nets"),
    ("brainspace", ["benchmark", "--set", "conte69", "--out", "out.json"], "conte69"),
])  # fmt: skip
def test_the_command_line_names_it_in_one_line(package, command, extra, tmp_path):
    lines = last_line(package, f"import os; os.chdir({str(tmp_path)!r}); from qclearn.cli import main; main({command})")
    assert len(lines) == 1 and lines[0].startswith("qclearn: ")
    assert lines[0].endswith(f"need {package}, which is not installed: pip install 'qclearn[{extra}]'")
    assert not list(tmp_path.iterdir())


def test_the_core_does_without_them():
    blocked = dict.fromkeys(name for packages in EXTRAS.values() for name in packages)
    program = f"import sys; sys.modules |= {blocked}; import qclearn.cli, qclearn.benchmark.methods, qclearn.plot"
    subprocess.run([sys.executable, "-c", program], check=True)


def test_what_is_there_is_not_missed():
    for extra in EXTRAS.keys() - {"conte69", "peers"}:  # which no test needs
        with require(extra, "tests"):
            pass
