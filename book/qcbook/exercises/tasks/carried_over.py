import numpy as np

import qclearn as qc

from . import parts

TITLE = "Labels one way, areas the other"
PAGE, MINUTES, POINTS = "ownbrain", 25, 3
TASK = r"""
The section *Carried* takes measures from surface to surface by the map. Not everything may be averaged. A
registration has sent the moving vertex $k$ to the point `f[k]` of the control's disk, complex `(V,)`; the
control's vertices lie at `w`, complex `(W,)`, with triangles `faces`. Carry two things.

- `labels` `(W,)`, whole numbers that name the control's regions, to the moving vertices: each takes the label of
  the corner that weighs most in the triangle in which it lies.
- `areas` `(V,)`, how much moving cortex each moving vertex stands for, in mm², to the control: each area is shared
  out among the three corners by their weights, so that no area is lost.

Return both, `(V,)` labels and `(W,)` areas. `face, weights = qc.locate(w, faces, f)` says in which triangle each
point lies, `(V,)`, and its barycentric weights, `(V, 3)`.
"""


# %% answer
def carry_over(labels, areas, w, faces, f):
    """The control's labels at f (V,), and the areas that land (W,)."""
    ### BEGIN SOLUTION
    face, weights = qc.locate(w, faces, f)
    corners = faces[face]
    there = labels[corners[np.arange(len(f)), weights.argmax(1)]]
    landed = np.zeros(len(w))
    np.add.at(landed, corners, weights * areas[:, None])
    return there, landed
    ### END SOLUTION


# %% test
def cases(rng):
    """A control of few vertices, a finer moving mesh sent into it, and regions that are sectors of
    the disk."""
    w, faces = qc.polar_disk(5, 16, power=1.4)
    z, _ = qc.polar_disk(9, 30)
    f = 0.97 * z * np.exp(1j * (rng.uniform(0, 6) + 0.5 * abs(z) ** 2))
    names = rng.permutation([3, 7, 12, 40, 41])
    labels = names[((np.angle(w) + np.pi) / 2 / np.pi * len(names) - 1e-9).astype(int)]
    yield labels, rng.uniform(0.5, 3.0, len(z)), w, faces, f


def verdict(answer, case):
    from qclearn.plane import Disk

    labels, areas, w, faces, f = case
    said = parts(answer(*(part.copy() for part in case)), 2, "labels and areas")
    there, landed = map(np.asarray, said)
    if there.shape != f.shape or landed.shape != w.shape:
        return f"the shapes should be {f.shape} and {w.shape}; these are {there.shape} and {landed.shape}"
    strange = ~np.isin(there, labels)
    if strange.any():
        return f"{strange.sum()} vertices have a label that names no region, {there[strange][0]:g} for one"
    shares = Disk(w, faces).interpolation(f).toarray()
    largest = shares.max(1)
    own = np.array([row[labels == label].max() for row, label in zip(shares, there)])
    if not (own >= largest - 1e-9).all():
        return f"{(own < largest - 1e-9).sum()} of {len(f)} vertices do not have the label of their largest weight"
    if not abs(landed.sum() - areas.sum()) <= 1e-6 * areas.sum():
        return f"{areas.sum():.6g} mm² were sent out, and {landed.sum():.6g} mm² have landed"
    if not abs(landed @ w - areas @ f) <= 1e-6 * areas.sum():
        return (
            f"no area is lost, but its centre has moved by {abs(landed @ w - areas @ f) / areas.sum():.2g} of a radius"
        )
    if not np.allclose(landed, shares.T @ areas):
        return "sum and centre of the areas are right, and single vertices are not"


def evidence(answer, case):
    there, landed = answer(*(part.copy() for part in case))
    return np.concatenate([np.asarray(there, float), np.asarray(landed, float)])


MISTAKES = {
    "labels averaged": (
        (
            "labels[corners[np.arange(len(f)), weights.argmax(1)]]",
            "np.rint((weights * labels[corners]).sum(1)).astype(int)",
        ),
        "Labels are averaged and rounded: the mean of regions 3 and 7 is no region, or a third "
        "one. A label is a "
        "name; take one of the three",
    ),
    "the first corner": (
        ("weights.argmax(1)]", "0 * face]"),
        "Each vertex takes the label of the triangle's first corner, however far that is. Take "
        "the corner that "
        "weighs most",
    ),
    "nearest vertex": (
        ("labels[corners[np.arange(len(f)), weights.argmax(1)]]", "labels[abs(f[:, None] - w).argmin(1)]"),
        "The label is that of the nearest vertex. That need not be a corner of the triangle in "
        "which the point lies, "
        "nor the one that weighs most there",
    ),
    "each landing once": (
        ("np.add.at(landed, corners, weights * areas[:, None])", "landed[corners] += weights * areas[:, None]"),
        "Area is lost: an indexed sum with += keeps one of all the shares that land on a vertex. "
        "numpy has a "
        "function that adds at repeated places",
    ),
    "all to the largest": (
        (
            "np.add.at(landed, corners, weights * areas[:, None])",
            "np.add.at(landed, corners[np.arange(len(f)), weights.argmax(1)], areas)",
        ),
        "Each area goes to one corner as a whole, as a label does: none is lost, but it moves by "
        "up to half a "
        "triangle. Share it out",
    ),
    "to all three": (
        ("weights * areas[:, None]", "0 * weights + areas[:, None]"),
        "Each corner gets the whole area, so that far more cortex lands than was sent. Share it "
        "out by the "
        "weights, whose sum is 1",
    ),
    "averaged": (
        (
            "return there, landed",
            "count = np.zeros(len(w)) + 1e-9\n    np.add.at(count, corners, weights)\n    return there, landed / count",
        ),
        "The areas are averaged over what lands on a vertex, as thickness would be. An area is an "
        "amount, and "
        "amounts add up",
    ),
}
