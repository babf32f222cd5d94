import numpy as np

import qclearn as qc

from . import shaped

TITLE = "Standardised, but over what?"
PAGE, MINUTES, POINTS = "folds", 20, 2
TASK = r"""
Before two feature maps are compared, each is standardised: mean 0 and variance 1 *over the area of its own surface*,
as the section *What is compared* says. A mean over vertices would change with the mesh, though the surface stays the
same. Write `standardised`: given are `values`, one real number at each vertex, `(V,)`, the points `vertices` in mm,
real `(V, 3)`, and `faces`, integer `(F, 3)`; return the standardised values, real `(V,)`. The weight of a vertex is a
third of the area of all triangles around it, that of $x_1 x_2 x_3$ being $\tfrac12 |(x_2 - x_1) \times (x_3 - x_1)|$.
With these weights the mismatch of two features is {prf:ref}`a correlation <prop-folds-correlation>`.
"""


# %% answer
def standardised(values, vertices, faces):
    """The values (V,) with mean 0 and variance 1 over the surface."""
    a, b, c = (vertices[corner] for corner in faces.T)
    ### BEGIN SOLUTION
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    share = np.bincount(faces.flat, np.repeat(area / 3, 3))
    share = share / share.sum()
    values = values - share @ values
    return values / np.sqrt(share @ values**2)
    ### END SOLUTION


# %% test
def cases(rng):
    """Bumps over a disk whose mesh is much finer at the centre."""
    for _ in range(3):
        z, faces = qc.polar_disk(8, 20, power=rng.uniform(1.5, 2))
        height = rng.uniform(0.5, 1) * np.cos(3 * z.real + rng.uniform(0, 6)) * np.sin(3 * z.imag)
        values = rng.uniform(2, 4) + abs(z) ** 2 + 0.3 * rng.normal(size=len(z))
        yield values, 40 * np.stack([z.real, z.imag, height], axis=1), faces


def verdict(answer, case):
    values, vertices, faces = case
    before, share = values.copy(), qc.Surface(vertices, faces).vertex_areas
    said = shaped(answer(*case), before.shape)
    mean = share @ said / share.sum()
    variance = share @ (said - mean) ** 2 / share.sum()
    if not max(abs(mean), abs(variance - 1)) < 1e-6:
        return f"over the area the mean is {mean:.2g} and the variance {variance:.6g}"
    if not abs(np.corrcoef(said, before)[0, 1] - 1) < 1e-6:
        return "the values are changed by more than a shift and a positive factor"


def evidence(answer, case):
    return np.asarray(answer(*case), float)


MISTAKES = {
    "every vertex alike": (
        ("share = share / share.sum()", "share = np.full(len(values), 1 / len(values))"),
        "Every vertex counts alike: where the mesh is fine, the surface counts more. Weigh the "
        "vertices by area, in"
        " the mean and in the variance",
    ),
    "areas in mm²": (
        ("share = share / share.sum()", "share = 1 * share"),
        "The weights are areas in mm² and do not add up to 1. A mean over the surface divides by "
        "the whole area, and"
        " the variance does, too",
    ),
    "every triangle alike": (
        ("np.repeat(area / 3, 3)", "np.repeat(area**0, 3)"),
        "The weight of a vertex is its number of triangles, large or small. Each triangle has to "
        "bring a third of its"
        " area, as the task defines the weight",
    ),
    "the last triangle wins": (
        (
            "share = np.bincount(faces.flat, np.repeat(area / 3, 3))",
            "share = np.zeros(len(values)); share[faces.ravel()] += np.repeat(area / 3, 3)",
        ),
        "Each vertex keeps the area of one triangle only: adding to an array at repeated indices "
        "writes, and does not"
        " sum. See np.bincount or np.add.at",
    ),
    "variance unweighted": (
        ("np.sqrt(share @ values**2)", "np.std(values)"),
        "The mean is by area, but the standard deviation still counts vertices. The variance is "
        "an integral over the"
        " surface, too",
    ),
    "variance, not its root": (
        ("np.sqrt(share @ values**2)", "(share @ values**2)"),
        "The values are divided by the variance, so they keep a unit: 1 over theirs. What is "
        "divided by has to have"
        " the values' own unit",
    ),
    "mean left in": (
        ("values = values - share @ values", "values = 1 * values"),
        "The mean has not been taken off, so that the second moment is 1 and not the variance. "
        "See the first line of"
        " the proof that the mismatch is a correlation",
    ),
}
