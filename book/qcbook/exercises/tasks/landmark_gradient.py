import numpy as np

import qclearn as qc

TITLE = "The gradient of the landmark term"
PAGE, MINUTES, POINTS = "fit", 30, 4
TASK = r"""
Let $\mathcal L = \frac\gamma M \sum_k |(Qf)_k - q_k|^2$ with the sparse matrix $Q$, `(M, V)`, that samples a map
at the landmarks, and let $f$ be the map that the disk solver found last, `solver.f`. Return the gradient of
$\mathcal L$ with respect to $\mu$, one complex number a face, `(F,)`, in the convention of the library,
$d\mathcal L = \operatorname{Re}\sum_T \overline{g_T}\,d\mu_T$.

Two things are needed: the gradient with respect to $f$ in the same convention, and `solver.pullback`, which
carries such a gradient `(V,)` back to one with respect to $\mu$. The section *A Gauss-Newton step as small as
the number of landmarks* says what stands behind it.
"""


# %% answer
def landmark_gradient(solver, Q, q, gamma):
    """Gradient of the landmark term with respect to mu, complex (F,)."""
    ### BEGIN SOLUTION
    residual = Q @ solver.f - q
    grad_f = 2 * gamma / len(q) * (Q.T @ residual)
    return solver.pullback(grad_f)
    ### END SOLUTION


# %% test
def cases(rng):
    """(disk, mu, Q, q, gamma, dmu): a coefficient, landmarks, and a direction to differentiate
    along."""
    from qclearn.plane import Disk

    disk = Disk(*qc.polar_disk(6, 20))
    for gamma in (1.0, 50.0):
        mu = 0.3 * np.exp(1j * (3 * disk.centroids.real + rng.uniform(0, 6)))
        p = 0.7 * np.sqrt(rng.uniform(size=5)) * np.exp(2j * np.pi * rng.uniform(size=5))
        q = p + 0.1 * (rng.normal(size=5) + 1j * rng.normal(size=5))
        dmu = rng.normal(size=len(mu)) + 1j * rng.normal(size=len(mu))
        yield disk, mu, disk.interpolation(p), q, gamma, dmu


def slope(case, h=1e-5):
    """The derivative of the loss along dmu, by central differences."""
    disk, mu, Q, q, gamma, dmu = case
    solver = qc.BeltramiDiskSolver(disk.z, disk.faces)
    ahead, behind = (gamma * (abs(Q @ solver.solve(mu + s * dmu) - q) ** 2).mean() for s in (h, -h))
    return (ahead - behind) / (2 * h)


def called(answer, case):
    disk, mu, Q, q, gamma, _ = case
    solver = qc.BeltramiDiskSolver(disk.z, disk.faces)
    solver.solve(mu)
    return answer(solver, Q, q.copy(), gamma)


def verdict(answer, case):
    g, dmu = called(answer, case), case[-1]
    if np.shape(g) != dmu.shape:
        return f"the gradient should have one number a face, shape {dmu.shape}; this has the shape {np.shape(g)}"
    said, right = (np.conj(g) @ dmu).real, slope(case)
    if not abs(said - right) <= 1e-4 * max(abs(right), abs(said)):
        return f"along a random change of mu the gradient predicts {said:.6g} where differences give {right:.6g}"


def evidence(answer, case):
    g = np.asarray(called(answer, case), complex)
    return np.stack([g.real, g.imag])


MISTAKES = {
    "conjugated": (
        ("(Q.T @ residual)", "(Q.T @ residual).conj()"),
        "Transposed, but not conjugated: Q is real, and in the convention of a gradient the residual goes in as it is",
    ),
    "factor 2": (
        ("2 * gamma / len(q)", "gamma / len(q)"),
        "The factor 2 of the square is missing: differentiate the square of a residual before it is pulled back",
    ),
    "sum for mean": (
        ("2 * gamma / len(q)", "2 * gamma"),
        "The landmark term is a mean over the M landmarks, and this is the gradient of the sum: "
        "look at what "
        "stands before the sum sign",
    ),
    "sign": (
        ("Q @ solver.f - q", "q - Q @ solver.f"),
        "The sign: this points downhill, and a gradient points uphill. Which of the mapped point "
        "and its target "
        "is subtracted?",
    ),
    "not pulled back": (
        ("solver.pullback(grad_f)", "grad_f"),
        "This is the gradient by the map, one number a vertex. How the map follows mu is still "
        "missing: carry it "
        "back through the solver",
    ),
}
