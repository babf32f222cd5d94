"""`qclearn train` and `benchmark`: runs of hours, which go on where they were stopped."""

from pathlib import Path

import click

FIGURES = {  # of the benchmark's table: key of a run's summary -> head of the column
    "landmark_error": "landmark error",
    "mean_abs_mu": "mean |mu|",
    "correspondence_sulci_mm": "near sulci, mm",
    "correspondence_mm": "from truth, mm",
    "held_out_mm": "held out, mm",
    "held_out_middle_mm": "middle, mm",
    "there_and_back_mm": "and back, mm",
    "r_depth": "r depth",
    "areal_95": "log2 J 95 %",
    "shape_95": "log2 R 95 %",
    "reversed_on_sphere": "reversed",
    "seconds": "seconds",
}


@click.command()
@click.argument("network", metavar="NETWORK")
@click.option(
    "--preset",
    type=click.Choice(["best", "paper"]),
    default="best",
    help="best: our own network; paper: the paper's, with its errata corrected.",
)
@click.option("--gamma", type=float, help="Of the paper's CP-Net alone: 1e4, 1e5 or 2e5.")
@click.option("--out", required=True, help="Folder; an interrupted run in it goes on.")
@click.option("--data", help="Folder of training sets  [default: the user's cache]")
@click.option("--steps", type=int, help="Fewer or more steps than the recipe.")
@click.option("--seed", type=int, help="Another seed than the recipe's.")
@click.option("--quick", is_flag=True, help="A tiny training set, for a trial.")
def train(network, preset, gamma, out, data, steps, seed, quick):
    """Train a NETWORK, ldnet, cpnet or dbsnet, by the recipe of its shipped weights; write log,
    checkpoint and weights.

    It takes all cores, or the threads of OMP_NUM_THREADS.

    `torchrun` runs it on several processes or machines:

    \b
        torchrun --nproc-per-node 2 -m qclearn train dbsnet --out run
    """
    from ..nets.run import run_training

    changes = {"steps": steps, "seed": seed}
    changes = {name: value for name, value in changes.items() if value is not None}
    path, row = run_training(network, preset, gamma, Path(out), data, quick, **changes)
    if path:
        loss, step, seconds = row["validation_loss"], row["step"], row["seconds"]
        print(f"{path}: validation loss {loss:.4g} after {step:.0f} steps, {seconds:.0f} s")


@click.command()
@click.option("--out", required=True, help="JSON file; a stopped run goes on from FILE.partial.")
@click.option("--subjects", type=int, default=24, help="How many of the synthetic cohort's 24.")
@click.option("--vertices", type=int, default=10_000, help="Of each synthetic subject.")
@click.option(
    "--set",
    "sets",
    multiple=True,
    default=["cohort"],
    help="cohort, displacement, fsaverage5, heldout, warp, conte69 or folder:DIR; repeatable.",
)
@click.option(
    "--method",
    "methods",
    multiple=True,
    help="Instead of all: harmonic, harmonic:weight=2,landmarks=path; repeatable.",
)
@click.option("--limit", type=float, default=3600, help="Seconds for a row of another's method.")
@click.option("--fronts", is_flag=True, help="Also fits along a front, to compare at one |mu|.")
@click.option("--scheduler", help="Address of a dask scheduler, `tcp://HOST:8786`.")
@click.option("--workers", type=int, default=2, help="Processes, without --scheduler.")
@click.option("--data", help="Folder of synthetic subjects  [default: the user's cache]")
def benchmark(out, methods, data, **options):
    """Run registration methods on the same problems and write all figures to one file.

    heldout and warp measure on real cortex: with held-out curves, and with the same folds in another
    shape. folder:DIR takes each person of a folder onto each other: open hemispheres of one side,
    NAME.npz, with curves of the same names. conte69 needs `pip install 'qclearn[conte69]'`.
    """
    from ..benchmark.run import benchmark as run_benchmark
    from ..benchmark.runs import run_of

    runs = [run_of(text) for text in methods] or None
    results = run_benchmark(out, runs=runs, folder=data, **options)
    print(f"{'run':38} done  certified  " + "  ".join(FIGURES.values()))
    for name in results["settings"]["sets"]:
        print(f"{name}:")
        for line in lines_of([row for row in results["rows"] if row["set"] == name]):
            print(line)
    for name, reason in results["provenance"]["left_out"].items():
        print(f"left out: {name}: {reason}")


def lines_of(rows):
    """Lines of one set's rows: each run's means, and the figures of the true map if it is known."""
    from ..benchmark.rows import failures, summary

    table = summary(rows)
    for run, line in table.items():
        failed = len(failures(rows, run))
        note = f"  failed here on {failed}: ends farther off than the rotation" if failed else ""
        figures = [(len(head), line.get(key)) for key, head in FIGURES.items()]
        cells = [" " * size if value is None else f"{value:{size}.2g}" for size, value in figures]
        counts = f"{line['pairs'] - line['failed']:2}/{line['pairs']:<2}  {line['certified']:9}"
        yield f"{run:38} {counts}  " + "  ".join(cells) + note
    failed = {}
    for row in rows:
        if row["status"] == "failed":
            failed.setdefault((row["run"], row["message"]), []).append(row["pair"])
    for (run, message), (first, *others) in failed.items():
        yield f"{run}, {first}{f' and {len(others)} more' if others else ''}: {message}"
    line = next((line for line in table.values() if "floor_mm" in line), None)
    if line:
        yield (
            f"the true map itself: curves {line['floor_curve_mm']:.1f} mm apart, "
            f"{line['floor_mm']:.1f} mm by arc length, r depth {line['true_r_depth']:.2f}"
        )
