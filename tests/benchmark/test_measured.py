"""The measured figures: what is kept fits its schema, and what does not is refused with its place."""

import json

import pytest

from qclearn.benchmark.measured import RESULTS, WRITERS, BenchmarkError, as_text, read_measured, write_measured


@pytest.fixture(scope="module")
def figures():
    return read_measured("networks")


def test_a_file_and_the_program_that_writes_it_are_named_for_each_other():
    root = RESULTS.parents[2]
    assert {path.stem for path in RESULTS.iterdir()} == set(WRITERS)
    for name, writer in WRITERS.items():
        assert writer.startswith("qclearn benchmark") or (root / writer).is_file()
        assert name in (root / "book/studies/README.md").read_text()


@pytest.mark.parametrize("name", WRITERS)
def test_kept_figures_fit_their_schema_and_can_be_written_again(name):
    figures = read_measured(name, RESULTS / f"{name}.json")
    text = (RESULTS / f"{name}.json").read_text()
    assert json.loads(as_text(name, figures)) == figures
    assert '"commit"' in text and "+changes" not in text, "measure again, on a committed tree"


@pytest.mark.parametrize(
    "part, key, value, place",
    [
        ("dbsnet", "mean_displacement", -0.1, r"\$.dbsnet.mean_displacement"),
        ("ldnet", "all", {"best": 1.0}, r"\$.ldnet.all"),
        ("cpnet", "provenance", {}, r"\$.cpnet.provenance"),
        ("dbsnet", "speed", 1.0, r"\$.dbsnet"),
    ],
)
def test_figures_that_do_not_fit_are_refused_where_they_stand(figures, part, key, value, place, tmp_path):
    path = tmp_path / "networks.json"
    wrong = figures | {part: figures[part] | {key: value}}
    with pytest.raises(BenchmarkError, match=f"{place}: .*; run `book/studies/evaluate_networks.py` again"):
        write_measured("networks", path, wrong)
    assert not path.exists()
    path.write_text(json.dumps(wrong))
    with pytest.raises(BenchmarkError, match=place):
        read_measured("networks", path)


@pytest.mark.parametrize("name, key", [("sizes", "rows"), ("suspect", "cases"), ("weights", "table")])
def test_other_figures_that_lack_something_are_refused(name, key, tmp_path):
    figures = read_measured(name)
    del figures[key]
    with pytest.raises(BenchmarkError, match=f"'{key}' is a required property; run `book/studies/.*{name}.py` again"):
        write_measured(name, tmp_path / f"{name}.json", figures)
