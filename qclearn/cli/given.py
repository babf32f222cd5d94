"""Units and features from the options of `qclearn register`."""

from pathlib import Path

import click
import numpy as np

from ..io.hemisphere import require_side
from ..io.values import read_map
from ..registration.features import FOLDS, Feature, FeatureError
from ..surfaces.units import UNITS

units_option = click.option(
    "--units",
    type=click.Choice(list(UNITS)),
    default="mm",
    help="Of the files; a surface that has another unit by its length is not scaled.",
)
merge_option = click.option(
    "--merge", is_flag=True, help="Merge points doubled along a seam; copies count as cut away."
)


def given_features(sides, files, none, delta):
    """Features of the options --feature and --no-features; by default the folds.

    files: pairs of two files, or of a name of FOLDS twice; the second may have a weight behind a
    colon. sides: side -> `Hemisphere`.
    """
    for option, used in (("--feature", files), ("--delta", delta is not None)):
        if used and none:
            raise FeatureError(f"{option} and --no-features exclude each other; drop one")
    features = []
    for moving, control in files:
        path, colon, weight = control.rpartition(":")
        try:
            control, weight = (path, float(weight)) if colon else (control, 1.0)
        except ValueError:  # a colon in the path
            weight = 1.0
        if moving == control and moving in FOLDS:
            features.append((moving, weight))
            continue
        values = feature_of(sides["moving"], moving), feature_of(sides["control"], control)
        features.append((Feature(Path(moving).name, *values), weight))
    return None if none else features or FOLDS


def feature_of(hemisphere, path):
    """The values of a file on the disk; FeatureError where one is not finite there."""
    given = read_map(path)
    require_side(path, given.side, hemisphere.frame.side, hemisphere.path)
    if given.is_integer and len(given.labels or ()) > 1:  # more than Workbench's ???
        raise FeatureError(f"{path}: holds labels, no measure; give a map of numbers")
    values = hemisphere.numbering.on_cut_surface(given.values, path)
    finite = np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    # `register` would name the vertices by their numbers on the disk.
    if len(given.values) > len(values) and not finite.all():
        bad = hemisphere.numbering.table[~finite]
        raise FeatureError(
            f"{path}: not finite on the cortex at vertices {bad[:5].tolist()}; fill them in first"
        )
    return values
