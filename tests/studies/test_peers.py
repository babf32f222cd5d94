"""The study of peers: programs are measured in processes of their own, and leave nothing running."""

import json
import shlex
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from book.studies import peers
from book.studies.peers import measured
from catsurf import put_in_place_of_cat_surf
from qclearn.benchmark.measured import BenchmarkError, read_measured
from qclearn.benchmark.pairs import Pair, mapped
from qclearn.benchmark.problems import Spec
from qclearn.plane.grids import polar_disk
from qclearn.registration.curves import curves_of_both
from qclearn.surfaces.surface import Surface

WORK = "import time; x = b'x' * {}\nwhile time.process_time() < {}: pass"


def test_cpu_time_and_memory_are_those_of_a_program_with_its_children():
    little, much = ([sys.executable, "-c", WORK.format(10**power, work)] for power, work in ((5, 0.1), (8, 0.5)))
    little, much, by_shell = map(measured, (little, much, ["sh", "-c", shlex.join(much) + "; true"]))
    for key in ("memory_mb", "cpu_seconds"):
        assert 0 < little[key] < min(much[key], by_shell[key])


@pytest.mark.parametrize(
    "end, words", [("sleep 60", r"ended with -9 after \d+ s"), ("echo no licence; exit 3", "ended with 3 .*no licence")]
)
def test_a_program_that_fails_or_is_late_is_named_and_no_child_of_it_stays(tmp_path, end, words):
    number = tmp_path / "pid"
    with pytest.raises(BenchmarkError, match=f"sh {words}"):
        measured(["sh", "-c", f"sleep 600 & echo $! > {number}; {end}"], 2)
    with suppress(psutil.NoSuchProcess):
        child, stop = psutil.Process(int(number.read_text())), time.monotonic() + 30
        while child.status() != psutil.STATUS_ZOMBIE:  # a dead one stays until its parent has asked for it
            assert time.monotonic() < stop, "its child still runs"
            time.sleep(0.05)


def cap(height):
    """A cap with a curve along a spoke."""
    z, faces = polar_disk(8, 24)
    points = 50 * np.stack([z.real, z.imag, height * (1 - abs(z) ** 2)], 1)
    return mapped(Surface(points, faces, {"spoke": 1 + 24 * np.arange(2, 7)}))


def test_every_row_gets_what_its_process_took_and_demons_its_own_time(tmp_path, monkeypatch):
    def rows_of(out, subjects, vertices, sets, runs, methods, **_):
        """Rows of the kept file, and an answer of the program, as a row's process would keep it."""
        problem = SimpleNamespace(pair=pair)
        half_turn = pair.moving.sphere.points * [1, -1, -1]
        np.testing.assert_allclose(methods["spherical_demons"](problem), half_turn, atol=1e-6)
        kept, none = read_measured("peers"), {"cpu_seconds": None, "memory_mb": None}
        rows = [row | none for row in kept["rows"] if (row["set"], row["pair"]) == (spec.set, spec.pair)]
        out.write_text(json.dumps(kept | {"rows": [row for row in rows if row["run"] in chosen]}))

    def noted(command, *limit):
        costs[command[-2] == code] = measured(command, *limit)
        return costs[command[-2] == code]

    put_in_place_of_cat_surf(tmp_path, monkeypatch)
    costs, code = {}, "import sys; from book.studies.peers import run_task; run_task(sys.argv[1])"
    moving, control = cap(1.0), cap(1.2)
    pair = Pair(moving, control, tuple(curves_of_both(moving.surface, control.surface)))
    chosen = "Möbius", "Spherical Demons"
    spec = Spec("heldout", "right to left, first half", lambda: pair)
    replaced = {"require": print, "benchmark": rows_of, "problems": lambda *_: [spec], "version": lambda _: "9.9"}
    replaced["measured"] = noted
    for name, value in replaced.items():
        monkeypatch.setattr(peers, name, value)
    out = tmp_path / "peers.json"
    peers.main(["--out", str(out), "--set", "heldout"], standalone_mode=False)
    figures = read_measured("peers", out)
    ours, demons = (next(row for row in figures["rows"] if row["run"] == name) for name in chosen)
    for row, took in ((ours, costs[True]), (demons, costs[False])):
        assert (row["cpu_seconds"], row["memory_mb"]) == (took["cpu_seconds"], took["memory_mb"])
    assert demons["seconds"]["map"] == costs[False]["seconds"]
    assert figures["provenance"]["versions"]["cat-surf"] == "9.9" and not Path(f"{out}.parts").exists()
