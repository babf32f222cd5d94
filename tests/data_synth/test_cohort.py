"""Cohorts: subjects by seed, made once, continued after an interruption."""

import importlib
from dataclasses import replace

import numpy as np
import pytest

from data_synth import CortexError, cohort
from data_synth.generations import GENERATION
from qclearn.cli import main
from subjects import FOLDER, stand_in

module = importlib.import_module("data_synth.cohort")
SIZE = 1000


def make(folder, count=2, **options):
    return cohort(count, SIZE, folder, progress=False, **options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cohort")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "make_cortex", stand_in)
        make(folder)
    return folder


def test_subjects_come_in_the_order_of_the_seeds_as_they_were_grown(folder):
    subjects = make(folder)
    assert [subject.seed for subject in subjects] == list(module.SEEDS[:2])
    for subject in subjects:
        assert np.array_equal(subject.surface.vertices, stand_in(subject.seed, SIZE).surface.vertices)


def test_an_interrupted_run_continues_and_makes_nothing_twice(folder, monkeypatch):
    made = []

    def stop_after_one(seed, n_vertices, generation):
        if made:
            raise KeyboardInterrupt
        made.append(seed)
        return stand_in(seed, n_vertices, generation=generation)

    paths = [module.subject_path(folder, seed, SIZE) for seed in module.SEEDS[:2]]
    before = paths[1].read_bytes()
    for path in paths:
        path.unlink()
    monkeypatch.setattr(module, "make_cortex", stop_after_one)
    with pytest.raises(KeyboardInterrupt):
        make(folder, workers=1)
    assert paths[0].is_file() and not paths[1].is_file()
    monkeypatch.setattr(
        module, "make_cortex", lambda seed, n, **options: made.append(seed) or stand_in(seed, n, **options)
    )
    make(folder)
    assert made == list(module.SEEDS[:2])
    assert paths[1].read_bytes() == before


def test_a_generation_keeps_to_its_own_files(folder, tmp_path, monkeypatch):
    assert module.subject_path(folder, 1, SIZE, 3).parent.name == "generation-3"
    older = replace(stand_in(module.SEEDS[0], SIZE), generation=2)
    monkeypatch.setattr(module, "make_cortex", lambda *arguments, **options: older)
    with pytest.raises(CortexError, match=r"npz holds a subject of generation 2 where those of generation 3 lie"):
        make(tmp_path, count=1)
    with pytest.raises(CortexError, match="generation is 7"):
        make(folder, generation=7)
    path = module.subject_path(tmp_path, module.SEEDS[0], SIZE)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(CortexError, match=f"{path.name} is no readable npz file"):
        make(tmp_path, count=1)


def test_the_command_line_asks_for_a_generation(tmp_path, monkeypatch, capsys):
    made = []
    monkeypatch.setattr(module, "make_cortex", lambda seed, n, **options: made.append(options) or stand_in(seed, n))
    options = ["--cohort", "1", "--vertices", str(SIZE), "--out", str(tmp_path), "--workers", "1"]
    main(["synth", *options])
    main(["synth", *options, "--generation", str(GENERATION)])
    assert made == [{"generation": GENERATION}]
    with pytest.raises(SystemExit) as stop:
        main(["synth", *options, "--generation", "7"])
    assert stop.value.code == 2 and "generation is 7; this version makes 3" in capsys.readouterr().err


@pytest.mark.parametrize("options, words", [
    ({"count": 0}, "1 to 24 subjects"), ({"count": 25}, "1 to 24"), ({"count": 2.0}, "not 2.0"),
    ({"workers": 0}, "workers is 0"), ({"folder": "file"}, "give another folder"),
])  # fmt: skip
def test_impossible_cohorts(tmp_path, options, words):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(CortexError, match=words):
        make(tmp_path / options.pop("folder", ""), **options)
    assert (tmp_path / "file").read_text() == "in the way"


def test_the_cache_is_the_one_named_or_the_users(monkeypatch, tmp_path):
    assert module.default_folder() == FOLDER
    monkeypatch.delenv("QCLEARN_SUBJECTS")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    assert tmp_path in module.default_folder().parents or "qclearn" in str(module.default_folder())
