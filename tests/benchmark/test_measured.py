"""The measured figures: what is kept fits its schema, and what does not is refused with its place."""

import json
import re
import subprocess

import pytest

from qclearn.benchmark.measured import RESULTS, WRITERS, BenchmarkError, as_text, read_measured, write_measured

ROOT = RESULTS.parents[2]


def test_a_file_and_the_program_that_writes_it_are_named_for_each_other():
    assert {path.stem for path in RESULTS.iterdir()} == set(WRITERS)
    for name, writer in WRITERS.items():
        assert writer.startswith("qclearn benchmark") or (ROOT / writer).is_file()
        assert name in (ROOT / "book/studies/README.md").read_text()


@pytest.mark.parametrize("name", WRITERS)
def test_kept_figures_fit_their_schema_and_can_be_written_again(name):
    figures = read_measured(name, RESULTS / f"{name}.json")
    text = (RESULTS / f"{name}.json").read_text()
    assert json.loads(as_text(name, figures)) == figures
    assert '"commit"' in text and "+changes" not in text, "measure again, on a committed tree"


KEPT = {path.stem: path for path in (*RESULTS.iterdir(), ROOT / "qclearn/registration/uncertainty.json")}
FROZEN = "benchmark", "peers", "people", "networks", "sizes"  # measured at one commit
BEFORE = "weights", "suspect", "uncertainty", "valleys", "foldgrid"  # and at one before it, by the same fit
FIT = "qclearn/plane", "qclearn/surfaces", "qclearn/registration", "data_synth"
NOT_IT = {"qclearn/registration/uncertainty.json", "qclearn/registration/report.py"}  # what is said of a fitted map


def commits_of(name):
    return set(re.findall(r'"commit": "(\w+)', KEPT[name].read_text()))


def test_figures_are_those_of_one_commit():
    assert len(set.union(*map(commits_of, FROZEN))) == 1


@pytest.mark.parametrize("name", BEFORE)
def test_what_was_chosen_before_it_was_chosen_by_the_same_fit(name):
    (one,), (frozen,) = commits_of(name), commits_of(FROZEN[0])
    command = ["git", "diff", "--name-only", one, frozen, "--", *FIT]
    changes = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if changes.returncode:
        pytest.skip("the history is not here: nothing says what changed")
    assert set(changes.stdout.split()) <= NOT_IT


WRONG = [  # name, part of the file, what stands there, the fault
    ("networks", "dbsnet", {"mean_displacement": -0.1}, r"\$.dbsnet.mean_displacement: .*; .*evaluate_networks.py`"),
    ("networks", "cpnet", {"provenance": {}}, r"\$.cpnet.provenance: "),
    ("networks", "ldnet", {"all": {"best": 1.0}}, r"\$.ldnet.all: "),
    ("networks", "dbsnet", {"speed": 1.0}, r"\$.dbsnet: "),
    ("sizes", "rows", None, "'rows' is a required property; run `book/studies/sizes.py` again"),
    ("suspect", "cases", None, "'cases' is a required property; run `book/studies/suspect.py` again"),
    ("weights", "table", None, "'table' is a required property; run `book/studies/choose_weights.py` again"),
]


@pytest.mark.parametrize("name, part, change, fault", WRONG)
def test_figures_that_do_not_fit_are_refused_where_they_stand(name, part, change, fault, tmp_path):
    path, figures = tmp_path / f"{name}.json", read_measured(name)
    old = figures.pop(part)
    wrong = figures | ({part: old | change} if change else {})
    with pytest.raises(BenchmarkError, match=fault):
        write_measured(name, path, wrong)
    assert not path.exists()
    path.write_text(json.dumps(wrong))
    with pytest.raises(BenchmarkError, match=fault):
        read_measured(name, path)
