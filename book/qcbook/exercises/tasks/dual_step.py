import numpy as np

import qclearn as qc

from . import parts

TITLE = "A step counted in landmarks"
PAGE, MINUTES, POINTS = "fit", 30, 4
TASK = r"""
{prf:ref}`The theorem on the dual step <thm-reg-dual>` solves a system with one row a residual where the field $\nu$
has thousands of unknowns. Take the step, without the Möbius part. Given are the Jacobian $\mathcal J$, `J`, complex
`(2M, N)`, where $\mathcal J\delta\nu$ is $\operatorname{Re}(\overline{\mathcal J}\,\delta\nu)$; the residual `r`, real
`(2M,)`, at the field `nu`, complex `(N,)`; and a function `solve`: `solve(B)` is $W^{-1}B$ for one column `(N,)` or
several, real or complex.

Return two things: the new field $\nu + \delta\nu$, complex `(N,)`, and the minimum that the step promises, a
number. Ask `solve` for $2M$ columns, and invert nothing that has $N$ rows.
"""


# %% answer
def dual_step(solve, J, r, nu):
    """The field (N,) that minimises the model, and the least value."""
    ### BEGIN SOLUTION
    lifted = solve(J.T)
    S = np.eye(len(r)) + (J.conj() @ lifted).real
    constant = r - (J.conj() @ nu).real
    y = np.linalg.solve(S, constant)
    return -lifted @ y, constant @ y
    ### END SOLUTION


# %% test
def cases(rng):
    """(W, J, r, nu): a prior on a small mesh, and the linearisation of a few residuals."""
    from qclearn.plane import Disk

    disk = Disk(*qc.polar_disk(4, 12))
    size = len(disk.z)
    for beta, rows in ((1e-2, 6), (1.0, 10)):
        W = (disk.mass + beta * disk.laplace).toarray() / np.pi
        J, nu = (rng.normal(size=shape) + 1j * rng.normal(size=shape) for shape in ((rows, size), size))
        yield W, 0.1 * J, rng.normal(size=rows), 0.2 * nu


def called(answer, case):
    W, J, r, nu = case
    inverse = np.linalg.inv(W)
    return answer(lambda B: inverse @ B, J.copy(), r.copy(), nu.copy())


def model(case, field):
    """The linear model at a field: its value, and its gradient (N,)."""
    W, J, r, nu = case
    left = r + (J.conj() @ (field - nu)).real
    return (field.conj() @ W @ field).real + left @ left, 2 * (W @ field + J.T @ left)


def verdict(answer, case):
    said = parts(called(answer, case), 2, "the new field and the promise")
    nu = case[-1]
    field, promise = np.asarray(said[0]), float(said[1])
    if field.shape != nu.shape:
        return f"the new field should have the shape {nu.shape}; this has {field.shape}"
    value, slope = model(case, field)
    steepness = abs(slope).max() / abs(model(case, nu)[1]).max()
    if not steepness <= 1e-8:
        return f"at this field the model is not least: its gradient is {steepness:.2g} of what it was at nu"
    if not abs(promise - value) <= 1e-8 * value:
        return f"the promise is {promise:.6g}, and the model has {value:.6g} at the new field"


def evidence(answer, case):
    field, promise = called(answer, case)
    field = np.asarray(field)
    return np.concatenate([field.real, field.imag, [promise]])


MISTAKES = {
    "S without 1": (
        ("np.eye(len(r)) + ", ""),
        "S lacks the 1: this meets the linearised landmarks exactly, at any price. The 1 is the "
        "cost of the "
        "residual that is left",
    ),
    "r alone": (
        ("r - (J.conj() @ nu).real", "r"),
        "The right side is r alone, as if nu were 0: the prior holds the whole field small and "
        "not its change. "
        "See the equation for y",
    ),
    "the change": (
        ("return -lifted @ y,", "return -lifted @ y - nu,"),
        "This is the change. The theorem's formula is already the new field, and nu must not be taken off again",
    ),
    "sign": (
        ("return -lifted @ y,", "return lifted @ y,"),
        "The sign of the field: the derivative of the model vanishes where W times the field and "
        "the pulled-back "
        "y add up to 0",
    ),
    "not conjugated": (
        ("(J.conj() @ lifted).real", "(J @ lifted).real"),
        "The fields are complex: a row of the Jacobian acts on a field by the real part of its "
        "conjugate times the "
        "field, in S, too",
    ),
    "r in the promise": (
        ("constant @ y", "r @ y"),
        "The field is right and the promise is not: it is the product of y with the right side of "
        "its own "
        "equation, the last line of the theorem",
    ),
}
