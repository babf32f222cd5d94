"""The benchmark's engine: tasks on processes, kept as they finish, and resumed; what it refuses."""

import inspect
import json
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import asdict
from importlib import import_module
from pathlib import Path

import pytest
from distributed import Client, LocalCluster

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

SIZE = 1000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the subjects lie: all that the tests of two pairs ask for."""
    folder = str(tmp_path_factory.mktemp("cohort"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("data_synth.cohort"), "make_cortex", stand_in)
        hemispheres((1001, 1002, 2001), SIZE, folder, progress=False)
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
def client():
    with cluster_inside() as cluster, Client(cluster) as client:
        yield client


@pytest.fixture
def inside(client, monkeypatch):
    """What is asked of processes of this machine is done inside this one."""

    @contextmanager
    def connect(scheduler, workers):
        if scheduler is None:
            yield client
        else:
            with there(scheduler, workers) as other:
                yield other

    there = module.connect
    monkeypatch.setattr(module, "connect", connect)


def small(out, folder, runs, **options):
    options = {"subjects": 2, "vertices": SIZE, "workers": 1, "progress": False} | options
    return benchmark(out, runs=runs, folder=folder, **options)


def crash(problem):
    os.kill(os.getpid(), signal.SIGSEGV)


def recursion(problem):
    return recursion(problem)


def endless(problem):
    while True:
        time.sleep(1)


def shifted(by):
    return lambda problem: mobius(mobius(problem.disk.z, *problem.mobius), by)


METHODS_OF_OTHERS = {  # method -> its row's status, or the words of its message
    crash: "its process ended with SIGSEGV",
    (lambda problem: sys.exit("no licence")): "SystemExit: no licence",
    recursion: "RecursionError: maximum recursion depth exceeded",
    endless: "not done after 4 s and was stopped: give it more time by the limit",
    shifted(0.1): "done",
}


def test_whatever_a_method_of_others_does_touches_no_other_row(tmp_path, folder, inside, monkeypatch):
    def soon(pair, run, method, limit):
        """The loop alone is stopped soon: on a busy machine the other processes need longer."""
        return isolated_trial(pair, run, method, limit if run.name == "method 3" else 600)

    monkeypatch.setattr(engine, "isolated_trial", soon)
    methods = {f"method {k}": method for k, method in enumerate(METHODS_OF_OTHERS)}
    runs = [Run("Möbius", "mobius_only"), *(Run(name, name) for name in methods)]
    results = small(tmp_path / "r.json", folder, runs, subjects=1, methods=METHODS | methods, limit=4)
    assert read_measured("benchmark", tmp_path / "r.json") == results
    rows = {row["run"]: row for row in results["rows"]}
    for name, words in zip(methods, METHODS_OF_OTHERS.values()):
        assert words in rows[name].get("message", rows[name]["status"])
        assert "\n" not in rows[name].get("message", "")
    assert rows["method 4"]["landmark_error"] > rows["Möbius"]["landmark_error"] > 0
    assert results["provenance"]["threads_per_task"] == 1 and results["provenance"]["workers"] == 1


def test_a_stopped_run_goes_on(tmp_path, folder, inside, monkeypatch):
    out, runs = tmp_path / "r.json", [Run("Möbius", "mobius_only"), Run("thin plate", "thin_plate")]
    rows = module.finished

    def stop_after_one(*arguments):
        yield next(iter(rows(*arguments)))
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(module, "finished", stop_after_one)
        with pytest.raises(KeyboardInterrupt):
            small(out, folder, runs, subjects=1)
    (kept,) = Path(f"{out}.partial").glob("row-*.json")
    kept = json.loads(kept.read_text())
    assert not out.exists()
    tasks = []
    monkeypatch.setattr(
        module, "finished", lambda client, wanted, *rest: tasks.extend(wanted) or rows(client, wanted, *rest)
    )
    results = small(out, folder, runs, subjects=1)
    assert len(tasks) == 1 and len(results["rows"]) == 2 and results["provenance"]["resumed"]
    assert kept in results["rows"] and not Path(f"{out}.partial").exists()


def test_a_problem_that_cannot_be_made_fails_its_rows_alone(tmp_path, monkeypatch):
    def lost():
        raise ValueError("no such surface")

    run, kept = Run("Möbius", "mobius_only"), read_measured("benchmark")["rows"][0]
    figures = {name: kept[name] for name in kept if name not in ("set", "pair", "run", *asdict(run))}
    specs = [Spec("cohort", "a", lost), Spec("cohort", "b", dict)]
    monkeypatch.setattr(module, "problems", lambda *_: specs)
    monkeypatch.setattr(engine, "trial", lambda pair, run, method: figures)
    with cluster_inside() as cluster:
        lost, done = small(tmp_path / "r.json", None, [run], scheduler=cluster.scheduler_address)["rows"]
    assert (lost["status"], lost["message"]) == ("failed", "ValueError: no such surface")
    assert done["pair"] == "b" and done["status"] == "done" and done["landmark_error"] == kept["landmark_error"]


@pytest.mark.parametrize(
    "workers, threads, words",
    [
        (1, 2, "several threads.*--nthreads 1"),
        (1, 1, "has qclearn .*, here 9.9.*install the same"),
        (0, 1, "has no workers; start some"),
    ],
)
def test_workers_that_cannot_serve_are_refused(tmp_path, folder, monkeypatch, workers, threads, words):
    def of_this_thread(*names):
        """What the worker has, which shares this process, and in the thread that asks another version."""
        return {"qclearn": "9.9"} if threading.current_thread() is asking else there(*names)

    asking, there = threading.current_thread(), engine.versions_of
    monkeypatch.setattr(engine, "versions_of", of_this_thread)
    monkeypatch.setattr(engine, "PATIENCE", 20 if workers else 2)
    with cluster_inside(workers, threads) as cluster, pytest.raises(BenchmarkError, match=words):
        small(tmp_path / "r.json", folder, [Run("Möbius", "mobius_only")], scheduler=cluster.scheduler_address)


def test_a_folder_for_subjects_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="cannot be written"):
        small(tmp_path / "r.json", tmp_path / "file", [Run("Möbius", "mobius_only")])
    assert not (tmp_path / "r.json.partial").exists()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere", "tcp://127.0.0.1:http"])
def test_an_unreachable_scheduler_is_named(tmp_path, folder, monkeypatch, address):
    monkeypatch.setattr(engine, "PATIENCE", 1)
    with pytest.raises(BenchmarkError, match=f"{address}: no dask scheduler answers there"):
        small(tmp_path / "r.json", folder, [Run("Möbius", "mobius_only")], scheduler=address)


# What is asked for, before anything runs


@pytest.mark.parametrize(
    "runs, message",
    [
        ([Run("a", "magic")], "there is no method 'magic'; there are mobius_only, harmonic"),
        ([Run("a", "harmonic", {"lambda": 1})], "harmonic has no parameter lambda; it has weight, correct"),
        ([Run("a", "mobius_only", {"weight": 1})], "mobius_only has no parameter weight; it has none"),
        ([Run("a", "harmonic", landmarks="guessed")], "no landmarks 'guessed'"),
        ([Run("a", "harmonic", sets=("cohort", "mars"))], "sets some of cohort, displacement"),
        ([Run("a", "harmonic"), Run("a", "mobius_only")], r"named twice: \['a'\]"),
    ],
)
def test_impossible_runs_are_refused(runs, message):
    with pytest.raises(BenchmarkError, match=message):
        check_runs(runs, METHODS)


@pytest.mark.parametrize(
    "subjects, sets, message",
    [
        (0, ["cohort"], "0 subjects"),
        (25, ["cohort"], "1 to 24"),
        ("3", ["cohort"], "'3' subj"),
        (1, ["mars"], "no set of problems mars; there are cohort, displacement"),
        (1, [], "no set of problems given"),
    ],
)
def test_other_counts_and_sets_are_refused(subjects, sets, message):
    with pytest.raises(BenchmarkError, match=message):
        problems(subjects, sets)


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


def test_every_run_of_the_table_is_known_and_every_method_has_one():
    check_runs(RUNS + FRONT, METHODS)
    assert {run.method for run in RUNS} == set(METHODS)


def test_runs_whose_networks_are_missing_say_why(monkeypatch):
    def missing(name, preset, gamma=None):
        raise ImportError(f"no {name}")

    for place in (table, networks):
        monkeypatch.setattr(place, "network", missing)
    reasons = {run.name: lacking(run) for run in RUNS}
    assert reasons["harmonic 1"] is None and reasons["Gauss-Newton"] is None
    assert reasons["CP-Net, 1 step"] == reasons["guarded networks"] == "no cpnet"


@pytest.mark.parametrize(
    "text, parameters, landmarks",
    [
        ("harmonic", {}, "given"),
        ("harmonic:weight=2,correct=false", {"weight": 2, "correct": False}, "given"),
        ("cpnet_exact:preset=paper,gamma=1e4,landmarks=path", {"preset": "paper", "gamma": 1e4}, "path"),
    ],
)
def test_a_run_is_read_from_the_command_line(text, parameters, landmarks):
    assert run_of(text) == Run(text, text.partition(":")[0], parameters, landmarks)


def test_a_parameter_without_a_value_is_refused():
    with pytest.raises(BenchmarkError, match="'weight' is no parameter; write harmonic:NAME=VALUE"):
        run_of("harmonic:weight")


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--method", "magic"], "there is no method 'magic'"),
        (["--subjects", "99"], "the cohort has 1 to 24"),
        (["--vertices", "10"], "10 vertices"),
        (["--workers", "0"], "at least one worker"),
        (["--limit", "0"], "a limit above 0"),
    ],
)
def test_the_command_says_what_is_wrong_in_one_line(tmp_path, capsys, arguments, message):
    given = ["--method", "mobius_only", *arguments] if "--method" not in arguments else arguments
    with pytest.raises(SystemExit) as stop:
        main(["benchmark", "--out", str(tmp_path / "r.json"), *given])
    error = capsys.readouterr().err
    assert stop.value.code == 2 and message in error and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["peers", "programs"])
def test_what_version_0_2_took_is_answered_in_one_line(name):
    with pytest.raises(BenchmarkError, match=rf"benchmark\({name}=\) went with version 0.3: .*"):
        benchmark("out.json", **{name: ()})


def test_an_out_that_cannot_be_written_is_named_before_anything_runs(tmp_path):
    for out in (tmp_path, tmp_path / "nowhere" / "r.json"):
        with pytest.raises(BenchmarkError, match="not a file in a folder that exists"):
            benchmark(out, 1, runs=[Run("a", "mobius_only")])


def test_the_command_writes_the_file_and_prints_a_table(tmp_path, folder, capsys):
    out = tmp_path / "r.json"
    options = {"--out": out, "--subjects": 1, "--vertices": SIZE, "--workers": 1, "--data": folder}
    methods = ["--method", "mobius_only", "--method", "harmonic:weight=5", "--method", "harmonic:weight=-1"]
    main(["benchmark", *(str(word) for option in options.items() for word in option), *methods])
    printed = capsys.readouterr().out
    assert "harmonic:weight=5" in printed and "1/1" in printed
    assert "harmonic:weight=-1, 1001 to 2001: ValueError: weight = -1: " in printed and "0/1" in printed
    rows = {row["run"]: row for row in read_measured("benchmark", out)["rows"]}
    assert rows["harmonic:weight=5"]["landmark_error"] < rows["mobius_only"]["landmark_error"]
    assert rows["mobius_only"]["correspondence_sulci_mm"] > 0 and rows["mobius_only"]["floor_mm"] > 0


def test_methods_have_defaults_for_all_parameters():
    for name, method in METHODS.items():
        parameters = list(inspect.signature(method).parameters.values())
        assert parameters[0].name == "problem", name
        assert all(parameter.default is not inspect.Parameter.empty for parameter in parameters[1:]), name
