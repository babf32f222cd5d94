import numpy as np

import qclearn as qc

from . import shaped

TITLE = "One row of the solver"
PAGE, MINUTES, POINTS = "lbs", 25, 3
TASK = r"""
Row $i$ of the linear system of the LBS has the entry $c_i$ at the vertex itself and an entry $c_l$ at each neighbour,
[as sums over triangles](#eq-lbs-coefficients). The paper's formula for $c_l$ takes the hat function of the wrong
vertex, [E5](#erratum-5), and the sum of the row does not show it. Build the row triangle by triangle: write `row_of`.
Given are the number `i` of a vertex, `z`, complex `(V,)`, counter-clockwise `faces`, integer `(F, 3)`, and `mu`,
complex `(F,)` with $|\mu| < 1$; return the whole row, real `(V,)`, with zeros where there is no neighbour. On the
triangle `t`, `hats[t, k]` is the gradient of the hat function of vertex `faces[t, k]` as a complex number, and
`area[t]` is the area. Remember that $A(\mu)\,g = \bigl((1 + |\mu|^2)\,g - 2\mu\bar g\bigr) / (1 - |\mu|^2)$, and that
the inner product of two gradients is $\operatorname{Re}(\bar g\,h)$. The section *The coefficients of the neighbours*
has the rest.
"""


# %% answer
def row_of(i, z, faces, mu):
    """Row i of K(mu), real (V,)."""
    hats, area = qc.hat_gradients(z, faces), qc.signed_areas(z, faces)
    c = np.zeros(len(z))
    ### BEGIN SOLUTION
    for t, k in zip(*np.nonzero(faces == i)):
        m = abs(mu[t]) ** 2
        flux = (1 + m) * hats[t] - 2 * mu[t] * hats[t].conj()
        inner = (hats[t, k].conj() * flux).real / (1 - m)
        c[faces[t]] += area[t] * inner
    ### END SOLUTION
    return c


# %% test
def cases(rng):
    """A crooked mesh and a random coefficient; an inner vertex, the centre and a vertex of the
    boundary."""
    z, faces = qc.polar_disk(3, 8)
    for i in (0, 1 + rng.integers(16), 17 + rng.integers(8)):
        crooked = z + 0.06 * (rng.uniform(-1, 1, (len(z), 2)) @ [1, 1j])
        mu = rng.uniform(0.2, 0.7, len(faces)) * np.exp(2j * np.pi * rng.uniform(size=len(faces)))
        yield i, crooked, faces, mu


def verdict(answer, case):
    i, z, faces, mu = case
    right = qc.stiffness(z, faces, mu).toarray()[i]
    said = shaped(answer(*case), right.shape)
    off = abs(said - right)
    if not off.max() < 1e-8:
        where = "the vertex itself" if off[i] > 1e-8 else "its neighbours"
        return f"the row sums to {abs(said.sum()):.2g}, and at {where} it is off by up to {off.max():.2g}"


def evidence(answer, case):
    return np.asarray(answer(*case), float)


MISTAKES = {
    "third vertex": (
        ("c[faces[t]] +=", "c[np.roll(np.roll(faces[t], -k)[[0, 2, 1]], k)] +="),
        "The entries of the two neighbours are exchanged in each triangle, as the paper prints "
        "them, erratum E5. To"
        " the neighbour belongs its own hat function",
    ),
    "no area": (
        ("+= area[t] * inner", "+= inner"),
        "The weight by area is missing, erratum E3: each triangle enters an integral. Read 'Why "
        "the area belongs into"
        " every row'",
    ),
    "one triangle for two": (
        ("c[faces[t]] += area", "c[faces[t]] = area"),
        "A later triangle overwrites what an earlier one has brought: an edge inside has a "
        "triangle on either side,"
        " and the vertex itself has many. They add up",
    ),
    "A of -mu": (
        ("- 2 * mu[t]", "+ 2 * mu[t]"),
        "The sign before 2 mu is wrong: this is the inverse of A, which stretches where A "
        "shrinks. The proof of the"
        " proposition on the matrix tests it on two directions",
    ),
    "gradient not conjugated": (
        ("mu[t] * hats[t].conj()", "mu[t] * hats[t]"),
        "A multiplies by mu without a conjugate, so it is not symmetric. The matrix A takes g and "
        "its conjugate: look"
        " at the formula above",
    ),
    "product not conjugated": (
        ("(hats[t, k].conj() * flux)", "(hats[t, k] * flux)"),
        "The inner product lacks its conjugate: the real part of g h is no inner product, and the "
        "rows give no"
        " energy. The task's last formula has it",
    ),
}
