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
    "cpu_seconds": "CPU s",
    "memory_mb": "MB",
}


@click.command()
@click.argument("network", type=click.Choice(["ldnet", "cpnet", "dbsnet"]))
@click.option("--preset", type=click.Choice(["best", "paper"]), default="best", show_default=True)
@click.option(
    "--gamma",
    type=float,
    help="The paper's CP-Net alone: the weight it is trained for (1e4, 1e5 or 2e5).",
)
@click.option(
    "--out",
    required=True,
    help="Folder of the run; one that was interrupted goes on from its checkpoint.",
)
@click.option("--data", help="Folder where training sets are kept (default: the user's cache).")
@click.option("--steps", type=int, help="Fewer or more steps than the recipe.")
@click.option("--seed", type=int, help="Another seed than the recipe's.")
@click.option("--quick", is_flag=True, help="A tiny training set, to see that all works.")
@click.option("--threads", type=int, help="Threads of torch (default: all cores).")
def train(network, preset, gamma, out, data, steps, seed, quick, threads):
    """Train a network by the recipe of its shipped weights; writes log, checkpoint and weights.
    `torchrun` runs it on several processes or machines: torchrun --nproc-per-node 2 -m qclearn
    train dbsnet --out run."""
    from ..nets.run import run_training, use_threads

    use_threads(threads)
    changes = {
        name: value for name, value in (("steps", steps), ("seed", seed)) if value is not None
    }
    path, row = run_training(network, preset, gamma, Path(out), data, quick, **changes)
    if path:
        click.echo(
            f"{path}: validation loss {row['validation_loss']:.4g} after {row['step']:.0f} steps, "
            f"{row['seconds']:.0f} s"
        )


@click.command()
@click.option(
    "--out",
    required=True,
    help="JSON file to write; a run that was stopped goes on from FILE.partial.",
)
@click.option(
    "--subjects",
    type=int,
    default=24,
    show_default=True,
    help="How many of the synthetic cohort's 24.",
)
@click.option("--vertices", type=int, default=10_000, show_default=True)
@click.option(
    "--set",
    "sets",
    multiple=True,
    default=["cohort"],
    show_default=True,
    help="cohort, displacement, fsaverage5, heldout, warp or conte69; may be repeated.",
)
@click.option(
    "--method",
    "methods",
    multiple=True,
    help="Instead of all: harmonic, harmonic:weight=2,landmarks=path; repeatable.",
)
@click.option(
    "--program",
    "programs",
    multiple=True,
    help="A method that is a program, NAME='COMMAND' with {moving}, {moving_sphere}, {control}, {control_sphere} and "
    "{out}: GIFTI surfaces and spheres in, the moving sphere on the control's out; repeatable.",
)
@click.option(
    "--limit",
    type=float,
    default=3600,
    show_default=True,
    help="Seconds that a --program may take.",
)
@click.option(
    "--peers",
    type=click.Choice(["with", "without", "only"]),
    default="with",
    show_default=True,
    help="Competitors: beside ours, not at all, or with those of ours alone that the page 'Peers' shows.",
)
@click.option(
    "--fronts",
    is_flag=True,
    help="Also fits along a front of weights, to compare at equal distortion.",
)
@click.option(
    "--scheduler",
    help="Address of a dask scheduler, tcp://HOST:8786 (default: processes of this machine).",
)
@click.option(
    "--workers", type=int, default=2, show_default=True, help="Processes, without --scheduler."
)
@click.option(
    "--data", help="Folder where synthetic subjects are kept (default: the user's cache)."
)
def benchmark(
    out, subjects, vertices, sets, methods, programs, limit, peers, fronts, scheduler, workers, data
):
    """Run registration methods on the same problems and write all figures to one file.

    heldout and warp measure on real cortex, by curves that take no part and by the same folds in
    another shape; conte69 does so where the package brainspace is installed: `pip install
    'qclearn[conte69]'`. Competitors on spheres need cat-surf: `pip install 'qclearn[peers]'`.
    """
    from ..benchmark.run import benchmark as run_benchmark
    from ..benchmark.runs import program_of, run_of

    runs = [run_of(text) for text in methods] or None
    results = run_benchmark(
        out,
        subjects,
        vertices,
        sets,
        runs,
        scheduler=scheduler,
        workers=workers,
        folder=data,
        fronts=fronts,
        peers={"with": True, "without": False}.get(peers, peers),
        programs=[program_of(text, limit) for text in programs],
    )
    click.echo(f"{'run':38} done  certified  " + "  ".join(FIGURES.values()))
    for name in sets:
        click.echo(f"{name}:")
        for line in lines_of([row for row in results["rows"] if row["set"] == name]):
            click.echo(line)
    for name, reason in results["provenance"]["left_out"].items():
        click.echo(f"left out: {name}: {reason}")


def lines_of(rows):
    """Lines of one set's rows: each run's means, and the true map's own figures where it is known."""
    from ..benchmark.rows import failures, summary

    table = summary(rows)
    for run, line in table.items():
        failed = failures(rows, run)
        words = (
            f"  failed here on {len(failed)}: ends farther off than the rotation" if failed else ""
        )
        figures = [(len(head), line.get(key)) for key, head in FIGURES.items()]
        cells = [
            " " * width if value is None else f"{value:{width}.2g}" for width, value in figures
        ]
        counts = f"{line['pairs'] - line['failed']:2}/{line['pairs']:<2}  {line['certified']:9}"
        yield f"{run:38} {counts}  " + "  ".join(cells) + words
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
            f"{line['floor_mm']:.1f} mm by arc "
            f"length, r depth {line['true_r_depth']:.2f}"
        )
