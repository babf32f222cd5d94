"""The benchmark's engine: tasks on processes, kept as they finish, and resumed; what it refuses."""

import inspect
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from subprocess import Popen

import psutil
import pytest
from distributed import LocalCluster

from data_synth.cohort import hemispheres
from qclearn.benchmark import cluster as engine
from qclearn.benchmark import run as module
from qclearn.benchmark import runs as table
from qclearn.benchmark.isolated import isolated_trial
from qclearn.benchmark.measured import BenchmarkError, read_measured
from qclearn.benchmark.methods import METHODS, networks
from qclearn.benchmark.problems import Spec, problems
from qclearn.benchmark.run import benchmark
from qclearn.benchmark.runs import FRONT, RUNS, Run, check_runs, lacking, run_of
from qclearn.cli import main
from qclearn.plane.mobius import mobius
from subjects import stand_in

SIZE, MOBIUS = 1000, [Run("Möbius", "mobius_only")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the subjects lie."""
    folder = str(tmp_path_factory.mktemp("cohort"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("data_synth.cohort"), "make_cortex", stand_in)
        hemispheres((1001, 2001), SIZE, folder, progress=False)
    return folder


@pytest.fixture(autouse=True)
def one_commit(once, monkeypatch):
    """Somebody may work on the checkout while these tests run."""
    monkeypatch.setattr(module, "commit", lambda: "c0ffee")


@contextmanager
def cluster_inside(workers=1, threads=1):
    """A scheduler with workers inside this process, which start at once."""
    options = {"n_workers": workers, "threads_per_worker": threads}
    with LocalCluster(**options, processes=False, dashboard_address="127.0.0.1:0") as cluster:
        yield cluster


@pytest.fixture(scope="module")
def scheduler():
    with cluster_inside() as cluster:
        yield cluster.scheduler_address


def small(out, folder, runs=MOBIUS, **options):
    return benchmark(out, 1, SIZE, runs=runs, folder=folder, workers=1, progress=False, **options)


def recursion(problem):
    return recursion(problem)


def harmless(problem):
    """A good map, with all that may stand around it: words, another folder, a fork, threads that go on."""
    print("x" * 10**7)
    os.chdir("/")
    threading.Thread(target=time.sleep, args=[600]).start()
    sys.stdin.read()
    os.fork()
    return mobius(mobius(problem.disk.z, *problem.mobius), 0.1)


def changing(problem):
    problem.pair.moving.surface.vertices[:] *= 2
    return mobius(problem.disk.z, *problem.mobius)


LOCK = threading.Lock()
METHODS_OF_OTHERS = {  # method -> its row's status, or the words of its message
    (lambda problem: os.kill(os.getpid(), signal.SIGSEGV)): "its process ended with SIGSEGV",
    (lambda problem: sys.exit("no licence")): "SystemExit: no licence",
    changing: "read-only",
    (lambda problem: time.sleep(3600)): "not done after 2 s and was stopped: give it more time by the limit",
    harmless: "done",
    (lambda problem, lock=LOCK: lock): "cannot be sent to a process of its own",
    recursion: "RecursionError: maximum recursion depth exceeded",
}


def test_whatever_a_method_of_others_does_touches_no_other_row(tmp_path, folder, scheduler, monkeypatch):
    def soon(pair, run, method, limit):
        """The loop alone is stopped soon: on a busy machine the other processes need longer."""
        return isolated_trial(pair, run, method, limit if run.name == "method 3" else 600)

    monkeypatch.setattr(engine, "isolated_trial", soon)
    methods = {f"method {k}": method for k, method in enumerate(METHODS_OF_OTHERS)}
    runs = [*MOBIUS, *(Run(name, name) for name in methods)]
    results = small(tmp_path / "r.json", folder, runs, methods=METHODS | methods, limit=2, scheduler=scheduler)
    assert read_measured("benchmark", tmp_path / "r.json") == results
    rows = {row["run"]: row for row in results["rows"]}
    for name, words in zip(methods, METHODS_OF_OTHERS.values()):
        assert words in rows[name].get("message", rows[name]["status"])
        assert "\n" not in rows[name].get("message", "")
    assert rows["method 4"]["landmark_error"] > rows["Möbius"]["landmark_error"] > 0
    assert results["provenance"]["threads_per_task"] == 1 and results["provenance"]["workers"] == 1


LEFT = """
import os, pathlib, pickle
from qclearn.benchmark.isolated import isolated_trial
begun = pathlib.Path("begun").absolute()
class Endless:
    def __reduce__(self):
        loop = "import os, time, pathlib; pathlib.Path(%r).write_text(str(os.getpid())); time.sleep(600)"
        return exec, (loop % str(begun),)
isolated_trial(None, None, pickle.dumps(Endless()), 600)
"""


def test_a_row_ends_with_the_worker_that_began_it(tmp_path):
    """Nothing runs on, and nothing lies about, after the worker was killed."""
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    begun = tmp_path / "begun"
    with Popen([sys.executable, "-c", LEFT], cwd=tmp_path, env=environment) as worker:
        wait_until(lambda: begun.exists() and begun.read_text())
        worker.kill()
    row = int(begun.read_text())
    wait_until(lambda: not psutil.pid_exists(row) or psutil.Process(row).status() == psutil.STATUS_ZOMBIE)
    assert list(tmp_path.iterdir()) == [begun]


def wait_until(done):
    while not done():
        time.sleep(0.05)


def test_a_stopped_run_goes_on(tmp_path, folder, scheduler, monkeypatch):
    out, runs = tmp_path / "r.json", [*MOBIUS, Run("thin plate", "thin_plate")]
    rows, asked = module.finished, []

    def stop_after_one(client, tasks, *more):
        asked.append(len(tasks))
        yield next(iter(rows(client, tasks, *more)))
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "finished", stop_after_one)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            small(out, folder, runs, scheduler=scheduler)
        assert not out.exists()
    results = small(out, folder, runs, scheduler=scheduler)
    assert asked == [2, 1] and [row["status"] for row in results["rows"]] == ["done", "done"]
    assert results["provenance"]["resumed"] and not Path(f"{out}.partial").exists()


def test_a_problem_that_cannot_be_made_fails_its_rows_alone(tmp_path, folder, scheduler, monkeypatch):
    def lost():
        raise ValueError("no such surface")

    specs = [Spec("cohort", "a", lost), *problems(1, ["cohort"])]
    monkeypatch.setattr(module, "problems", lambda *_: specs)
    done, lost = small(tmp_path / "r.json", folder, scheduler=scheduler)["rows"]
    assert (lost["status"], lost["message"], done["status"]) == ("failed", "ValueError: no such surface", "done")


REFUSED_WORKERS = [  # their number, their threads, and what is said of them
    (1, 2, "several threads.*--nthreads 1"),
    (1, 1, "has qclearn .*, here 9.9.*install the same"),
    (0, 1, "has no workers; start some"),
]


@pytest.mark.parametrize("workers, threads, words", REFUSED_WORKERS)
def test_workers_that_cannot_serve_are_refused(tmp_path, folder, monkeypatch, workers, threads, words):
    def of_this_thread(*names):
        """What the worker has, which shares this process, and in the thread that asks another version."""
        return {"qclearn": "9.9"} if threading.current_thread() is asking else there(*names)

    asking, there = threading.current_thread(), engine.versions_of
    monkeypatch.setattr(engine, "versions_of", of_this_thread)
    monkeypatch.setattr(engine, "PATIENCE", 20 if workers else 2)
    with cluster_inside(workers, threads) as cluster, pytest.raises(BenchmarkError, match=words):
        small(tmp_path / "r.json", folder, scheduler=cluster.scheduler_address)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere", "tcp://127.0.0.1:http"])
def test_an_unreachable_scheduler_is_named(tmp_path, folder, monkeypatch, address):
    monkeypatch.setattr(engine, "PATIENCE", 1)
    with pytest.raises(BenchmarkError, match=f"{address}: no dask scheduler answers there"):
        small(tmp_path / "r.json", folder, scheduler=address)


REFUSED = [  # what is asked for, and what is said of it
    ({"runs": [Run("a", "magic")]}, "there is no method 'magic'; there are mobius_only, harmonic"),
    ({"runs": [Run("a", "harmonic", {"lambda": 1})]}, "harmonic has no parameter lambda; it has weight, correct"),
    ({"runs": [Run("a", "mobius_only", {"weight": 1})]}, "mobius_only has no parameter weight; it has none"),
    ({"runs": [Run("a", "harmonic", landmarks="guessed")]}, "no landmarks 'guessed'"),
    ({"runs": [Run("a", "harmonic", sets=("cohort", "mars"))]}, "sets some of cohort, displacement"),
    ({"runs": MOBIUS * 2}, r"named twice: \['Möbius'\]"),
    ({"subjects": 0}, "0 subjects: the cohort has 1 to 24"),
    ({"subjects": 25}, "25 subjects: the cohort has 1 to 24"),
    ({"subjects": "3"}, "'3' subjects"),
    ({"sets": ["mars"]}, "no set of problems mars; there are cohort, displacement"),
    ({"sets": ["folder:"]}, "no set of problems folder:; there are cohort"),  # of a variable that is not set
    ({"sets": []}, "no set of problems given"),
    ({"out": "."}, "not a file in a folder that exists"),
    ({"out": "nowhere/r.json"}, "not a file in a folder that exists"),
    ({"folder": "file"}, "cannot be written"),
    ({"peers": ()}, r"benchmark\(peers=\) went with version 0.3: .*"),
    ({"programs": ()}, r"benchmark\(programs=\) went with version 0.3: .*"),
]


@pytest.mark.parametrize("asked, message", REFUSED)
def test_what_cannot_be_done_is_refused_before_anything_runs(tmp_path, monkeypatch, asked, message):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    with pytest.raises(ValueError, match=message):
        benchmark(**{"out": "r.json", "runs": MOBIUS, "subjects": 1} | asked)
    assert os.listdir() == ["file"]


def test_the_sets_problems():
    specs = problems(3, ["cohort", "displacement", "fsaverage5", "heldout", "warp"])
    assert [spec.pair for spec in specs if spec.set == "cohort"] == [f"{seed} to 2001" for seed in (1001, 1002, 1003)]
    assert {spec.options[0] for spec in specs if spec.set == "displacement"} == {0.05, 0.1, 0.2, 0.3, 0.4}
    held = [spec.pair for spec in specs if spec.set == "heldout"]
    assert held == [f"{way}, {half} half" for way in ("right to left", "left to right") for half in ("first", "second")]
    warps = [f"{name}, {size} mm" for name in ("fsaverage5", "synthetic") for size in (6, 9, 12)]
    assert [spec.pair for spec in specs if spec.set == "warp"] == warps
    assert all(spec.seeds == [2001] for spec in specs if "synthetic" in spec.pair)
    assert len({(spec.set, spec.pair) for spec in specs}) == len(specs) == 24


def test_every_run_of_the_table_is_known_and_every_method_has_one_and_defaults():
    check_runs(RUNS + FRONT, METHODS)
    assert {run.method for run in RUNS} == set(METHODS)
    for method in METHODS.values():
        problem, *parameters = inspect.signature(method).parameters.values()
        assert problem.name == "problem" and all(p.default is not p.empty for p in parameters)


def test_runs_whose_networks_are_missing_say_why(monkeypatch):
    def missing(name, preset, gamma=None):
        raise ImportError(f"no {name}")

    assert "got 3" in lacking(Run("other", "cpnet_exact", {"preset": "paper", "gamma": 3.0}))
    for place in (table, networks):
        monkeypatch.setattr(place, "network", missing)
    reasons = {run.name: lacking(run) for run in RUNS}
    assert reasons["harmonic 1"] is None and reasons["Gauss-Newton"] is None
    assert reasons["CP-Net, 1 step"] == reasons["guarded networks"] == "no cpnet"


def test_a_run_is_read_from_the_command_line():
    for text, *given in (
        ("harmonic", {}),
        ("harmonic:weight=2,correct=false", {"weight": 2, "correct": False}),
        ("cpnet_exact:preset=paper,gamma=1e4,landmarks=path", {"preset": "paper", "gamma": 1e4}, "path"),
    ):
        assert run_of(text) == Run(text, text.partition(":")[0], *given)
    for given in ("weight", "weight="):
        with pytest.raises(BenchmarkError, match=f"'{given}' is no parameter; write harmonic:NAME=VALUE"):
            run_of(f"harmonic:{given}")


IN_ONE_LINE = [
    ("--method magic", "there is no method 'magic'"),
    ("--method mobius_only --subjects 99", "the cohort has 1 to 24"),
    ("--method mobius_only --vertices 10", "10 vertices"),
    ("--method mobius_only --workers 0", "at least one worker"),
    ("--method mobius_only --limit 0", "a limit above 0"),
]


@pytest.mark.parametrize("arguments, message", IN_ONE_LINE)
def test_the_command_says_what_is_wrong_in_one_line(tmp_path, capsys, arguments, message):
    with pytest.raises(SystemExit) as stop:
        main(["benchmark", "--out", str(tmp_path / "r.json"), *arguments.split()])
    error = capsys.readouterr().err
    assert stop.value.code == 2 and message in error and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_the_file_and_prints_a_table(tmp_path, folder, capsys):
    out = tmp_path / "r.json"
    options = f"--out {out} --subjects 1 --vertices {SIZE} --workers 1 --data {folder}"
    methods = " --method mobius_only --method harmonic:weight=5 --method harmonic:weight=-1"
    main(["benchmark", *(options + methods).split()])
    printed = capsys.readouterr().out
    assert "harmonic:weight=5" in printed and "1/1" in printed
    assert "harmonic:weight=-1, 1001 to 2001: ValueError: weight = -1: " in printed and "0/1" in printed
    rows = {row["run"]: row for row in read_measured("benchmark", out)["rows"]}
    assert rows["harmonic:weight=5"]["landmark_error"] < rows["mobius_only"]["landmark_error"]
    assert rows["mobius_only"]["correspondence_sulci_mm"] > 0 and rows["mobius_only"]["floor_mm"] > 0
