"""The measured figures of networks: what is kept fits its schema, and what does not is refused with its place."""

import json

import numpy as np
import pytest

from qclearn.benchmark.results import BenchmarkError, read_networks, write_networks
from qclearn.pages import kept


@pytest.fixture(scope="module")
def figures():
    return read_networks(kept("networks.json"))


def test_the_kept_figures_fit_their_schema_and_come_back(figures, tmp_path):
    assert set(figures) == {"polar", "ldnet", "cpnet", "controls", "dbsnet"}
    write_networks(tmp_path / "networks.json", figures)
    assert read_networks(tmp_path / "networks.json") == figures
    assert (tmp_path / "networks.json").read_text() == kept("networks.json").read_text()


MEASURED = (
    "benchmark.json",
    "networks.json",
    "scaling.json",
    "suspect.json",
    "template.json",
    "weights.json",
)


@pytest.mark.parametrize("name", MEASURED)
def test_kept_figures_were_measured_on_a_committed_tree(name):
    text = kept(name).read_text()
    assert '"commit"' in text and "+changes" not in text, "measure again, on a committed tree"


def test_figures_are_written_as_python_has_them(figures, tmp_path):
    """Tuples of a configuration and NumPy's numbers become what JSON knows."""
    cpnet = figures["cpnet"] | {"ranges": {name: tuple(pair) for name, pair in figures["cpnet"]["ranges"].items()}}
    displacement = np.float64(figures["dbsnet"]["mean_displacement"])
    measured = figures | {"cpnet": cpnet, "dbsnet": figures["dbsnet"] | {"mean_displacement": displacement}}
    write_networks(tmp_path / "networks.json", measured)
    assert read_networks(tmp_path / "networks.json") == figures


@pytest.mark.parametrize(
    "part, key, value, place",
    [
        ("dbsnet", "mean_displacement", -0.1, r"\$.dbsnet.mean_displacement"),
        ("ldnet", "all", {"best": 1.0}, r"\$.ldnet.all"),
        ("cpnet", "provenance", {}, r"\$.cpnet.provenance"),
        ("polar", "speed", 1.0, r"\$.polar"),
    ],
)
def test_figures_that_do_not_fit_are_refused_where_they_stand(figures, part, key, value, place, tmp_path):
    path = tmp_path / "networks.json"
    wrong = figures | {part: figures[part] | {key: value}}
    with pytest.raises(BenchmarkError, match=f"{place}: .*; run `tools/evaluate_networks.py` again"):
        write_networks(path, wrong)
    assert not path.exists()
    path.write_text(json.dumps(wrong))
    with pytest.raises(BenchmarkError, match=place):
        read_networks(path)


def test_what_is_no_json_is_refused(tmp_path):
    (tmp_path / "networks.json").write_text('{"polar": ')
    with pytest.raises(
        BenchmarkError, match=r"not a JSON file .*; give a file that `tools/evaluate_networks.py` wrote"
    ):
        read_networks(tmp_path / "networks.json")
