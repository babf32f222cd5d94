import numpy as np

import qclearn as qc

TITLE = "The rival, stopped early"
PAGE, MINUTES, POINTS = "whennetwork", 25, 3
TASK = r"""
The section *DBS-Net against the solver that is stopped early* gives a network its true opponent: conjugate
gradients, preconditioned by the solution at $\mu = 0$, after a step or two. Write it. Given are the stiffness
matrix $K = K(\mu)$ of the inner vertices, sparse `(N, N)`, the right side `load` `(N,)`, a function `solve` with
`solve(r)` $= K(0)^{-1} r$, from a factorisation that serves every $\mu$, and the number of `steps`. Begin at 0 and
return the approximation after these steps, `(N,)`.

Once it is right, look at what a step leaves of the error for a $\mu$ of your own, and hold it against $\max|\mu|$.
"""


# %% answer
def stopped_early(K, load, solve, steps):
    """The approximation (N,) to K x = load after so many steps from 0."""
    ### BEGIN SOLUTION
    x, rest = np.zeros(len(load)), load
    z = p = solve(rest)
    for _step in range(steps):
        image, size = K @ p, rest @ z
        share = size / (p @ image)
        x, rest = x + share * p, rest - share * image
        z = solve(rest)
        p = z + (rest @ z) / size * p
    return x
    ### END SOLUTION


# %% test
def cases(rng):
    """(K, K0, load, steps) of the inner vertices of a small mesh."""
    from qclearn.plane import Disk

    disk = Disk(*qc.polar_disk(6, 18))
    inside = np.setdiff1d(np.arange(len(disk.z)), disk.loop)
    mu = 0.6 * np.exp(1j * (2 * disk.centroids.imag + rng.uniform(0, 6)))
    K, K0 = (matrix.tocsr()[inside][:, inside] for matrix in (disk.stiffness(mu), disk.laplace))
    for steps in (1, 2, 4):
        yield K, np.linalg.inv(K0.toarray()), rng.normal(size=len(inside)), steps


def called(answer, case):
    K, inverse, load, steps = case
    return np.asarray(answer(K, load.copy(), lambda r: inverse @ r, steps))


def verdict(answer, case):
    (K, inverse, load, steps), found = case, called(answer, case)
    if found.shape != load.shape:
        return f"the approximation should have the shape {load.shape}; this has {found.shape}"
    # Nothing in the space of all that k products and solves can reach has a smaller error in the
    # norm of K.
    reached = [inverse @ load]
    for _ in range(steps - 1):
        reached.append(inverse @ (K @ reached[-1]))
    Q, _ = np.linalg.qr(np.stack(reached, axis=1))
    best, exact = Q @ np.linalg.solve(Q.T @ (K @ Q), Q.T @ load), np.linalg.solve(K.toarray(), load)
    least, own = (np.sqrt((x - exact) @ (K @ (x - exact))) for x in (best, found))
    size = np.sqrt(exact @ (K @ exact))
    if own < least - 1e-7 * size:
        return "this is nearer than so many products and solves can come: count the steps, and begin at 0"
    if not own <= least + 1e-7 * size:
        return (
            f"with steps = {steps} the error can fall to {least / size:.2g} of itself, and here it is {own / size:.2g}"
        )


def evidence(answer, case):
    return called(answer, case).astype(float)


MISTAKES = {
    "not preconditioned": (
        ("z = p = solve(rest)", "solve = np.copy\n    z = p = solve(rest)"),
        "Nothing is solved at mu = 0: without the preconditioner the steps grow with the mesh. "
        "Each new direction "
        "comes from a solve",
    ),
    "steepest descent": (
        ("p = z + (rest @ z) / size * p", "p = z"),
        "Each step forgets the direction before it: this is steepest descent. Add the old "
        "direction to make the "
        "new one conjugate",
    ),
    "sizes of the residual": (
        ("image, size = K @ p, rest @ z", "image, size = K @ p, rest @ rest"),
        "The residual's own square measures it here. Preconditioned, its product with the solved "
        "residual does, "
        "in the length of a step and in the new direction",
    ),
    "a step too many": (
        ("range(steps)", "range(steps + 1)"),
        "One step more than was asked for: the start at 0 counts as no step. At a fixed price an "
        "extra step is no "
        "small matter",
    ),
    "the first direction kept": (
        ("p = z + (rest @ z) / size * p", "p = z + p"),
        "The old direction is added as it is: it needs a factor, how much smaller the residual "
        "has become in the "
        "preconditioner's measure",
    ),
}
