"""Damaged files against the readers, by seed: the longer run is tests/fuzz/fuzz_readers.py."""

import importlib
import importlib.util
import random
from pathlib import Path

import pytest

TOOL = Path(__file__).with_name("fuzz_readers.py")


@pytest.fixture(scope="module")
def fuzz():
    specification = importlib.util.spec_from_file_location("fuzz_readers", TOOL)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def sound(fuzz, tmp_path_factory):
    return fuzz.bases(tmp_path_factory.mktemp("sound"))


def test_sound_files_are_read(fuzz, sound, tmp_path):
    assert len(sound) == 25
    for name, data in sound.items():
        assert fuzz.verdict(fuzz.write(tmp_path / name, data)) == ("accepted", ""), name


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_damaged_files_are_refused_by_name_or_read_as_sound(fuzz, sound, tmp_path, seed):
    names = [name for name in sound if ".vt" not in name]  # those take a process each
    found = {}
    for number in range(200):
        dice = random.Random(f"test {seed} {number}")
        name = dice.choice(names)
        path = fuzz.write(tmp_path / name, fuzz.damaged(name, sound[name], dice))
        found[f"{number} {name}"] = fuzz.verdict(path)
    assert {case: result for case, result in found.items() if result[0] in fuzz.FAULTS} == {}
    assert sum(result[0] == "refused" for result in found.values()) > 100


def test_attacks_are_refused_within_bounds(fuzz, sound, tmp_path):
    """Bombs, announced sizes, entities, pickles: in a process with limits, as in the tool."""
    attacks = list(fuzz.crafted(sound, blocks=6))
    assert len(attacks) > 25
    found = {
        number: fuzz.guarded(fuzz.write(tmp_path / name, data), 1 << 40) for number, (name, data) in enumerate(attacks)
    }
    assert {attacks[case][0]: result for case, result in found.items() if result[0] in fuzz.FAULTS} == {}


def test_a_planted_bug_is_seen_as_one(fuzz, sound, tmp_path, monkeypatch):
    """The tool would find a reader's own KeyError, and the reader does not call it bad input."""

    def buggy(data):
        return {}["vertices"]

    monkeypatch.setitem(
        importlib.import_module("qclearn.io.meshes")._READERS, ".ply", ("PLY file", lambda path, data: buggy(data))
    )
    path = fuzz.write(tmp_path / "s.ply", sound["s.ply"])
    with pytest.raises(KeyError):
        fuzz.qc.read_surface(path)
    assert fuzz.verdict(path)[0] == "raw"
