"""Count the maps and products that good landmark problems need at each level: what `MOST_WORK` in
gauss_newton.py rests on.

    python -m book.studies.effort [--count 20] [--folds]

Pairs are fsaverage5's hemispheres, the right one mirrored, by four to eleven of its sulci, given by
their ends or traced; each is fitted at every gamma. Prints one line a fit, and the most of each
level at each gamma.
"""

from collections import defaultdict
from functools import partial
from unittest.mock import patch

import click
import numpy as np

import qclearn as qc
from qclearn.registration import gauss_newton, multiresolution

GAMMAS = (1e3, 1e5, 1e6, 1e7, 1e8)


def counted(fit):
    """[(maps, products) of each level] of one call of fit()."""
    levels = []

    def level(*given, **options):
        levels.append([0, 0])
        return run_level(*given, **options)

    def at(self, *given):
        if levels:
            levels[-1][0] += 1
        return solve(self, *given)

    def forward(self, x):
        levels[-1][1] += 1
        return product(self, x)

    run_level, solve, product = (
        multiresolution.run_level,
        gauss_newton.GaussNewtonObjective.at,
        gauss_newton.ProductStep.forward,
    )
    with (
        patch.object(multiresolution, "run_level", level),
        patch.object(gauss_newton.GaussNewtonObjective, "at", at),
        patch.object(gauss_newton.ProductStep, "forward", forward),
    ):
        fit()
    return [tuple(one) for one in levels]


@click.command()
@click.option("--count", default=20, show_default=True, help="Problems, each fitted at every gamma.")
@click.option("--folds", is_flag=True, help="With folds, the default of `register`.")
def main(count, folds):
    rng, most = np.random.default_rng(1), defaultdict(lambda: (0, 0))
    moving, control = qc.mirror(qc.fsaverage5("right")), qc.fsaverage5("left")
    curves = qc.demo_landmarks()["curves"]
    for number in range(count):
        chosen = [curves[k] for k in rng.choice(11, rng.integers(4, 12), replace=False)]
        given = [curve | {"detect": bool(rng.random() < 0.8)} for curve in chosen]
        for gamma in GAMMAS:
            options = {} if folds else {"features": None}
            fit = partial(qc.register, moving, control, given, gamma=gamma, accept_suspect=True, **options)
            levels = counted(fit)
            click.echo(f"{number} {gamma:g} {len(given)} {levels}")
            for k, (maps, products) in enumerate(levels):
                most[gamma, k] = max(maps, most[gamma, k][0]), max(products, most[gamma, k][1])
    for (gamma, k), (maps, products) in sorted(most.items()):
        click.echo(f"gamma {gamma:g} level {k}: {maps} maps, {products} products")


if __name__ == "__main__":
    main()
