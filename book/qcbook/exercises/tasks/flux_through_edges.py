import numpy as np

import qclearn as qc

from . import shaped

TITLE = "What flows through an edge"
PAGE, MINUTES, POINTS = "lbs", 25, 3
TASK = r"""
Let $f = u + iv$ have the coefficient $\mu$ on every triangle. [The equation](#eq-lbs-conjugate) $\nabla v = i A(\mu)
\nabla u$ says that what $A\nabla u$ carries through an edge is what $v$ gains along it. The solver for the [free
boundary](#term-free-boundary) lives on this. Write `fluxes`: given are `z`, complex `(V,)`, counter-clockwise
`faces`, integer `(F, 3)`, `mu`, complex `(F,)`, and `u`, real `(V,)`; return a real array `(F, 3)`. Its column $k$
holds the flux

$$
\int A(\mu) \nabla u \cdot n \, ds
$$

out of the triangle through the edge opposite its corner $k$, with the outward unit normal $n$. Gradients are complex
numbers, and the inner product of two of them is $\operatorname{Re}(\bar g\, h)$; `grad_u`, `(F,)`, is given. The
section *From one complex equation to two real ones* has $A$. A test that needs no map: how much leaves a triangle
altogether?
"""


# %% answer
def fluxes(z, faces, mu, u):
    """Flux of A grad u out through the edge opposite each corner (F, 3)."""
    grad_u = (qc.hat_gradients(z, faces) * u[faces]).sum(axis=1)
    ### BEGIN SOLUTION
    m = abs(mu) ** 2
    flow = ((1 + m) * grad_u - 2 * mu * grad_u.conj()) / (1 - m)
    edges = np.roll(z[faces], -2, axis=1) - np.roll(z[faces], -1, axis=1)
    outward = -1j * edges
    return (flow.conj()[:, None] * outward).real
    ### END SOLUTION


# %% test
def cases(rng):
    """Maps without folds, their coefficients and both their parts."""
    z, faces = qc.polar_disk(4, 12)
    for _ in range(3):
        p, q = rng.normal(size=(2, 2)) @ [1, 1j]
        f = p / abs(p) * (z * np.exp(0.6j * (1 - abs(z) ** 2)) + 0.3 * q / abs(q) * z.conj())
        yield z, faces, qc.beltrami_coefficient(z, faces, f), f.real, f.imag


def verdict(answer, case):
    *given, v = case
    ahead, behind = (np.roll(v[given[1]], -k, axis=1) for k in (2, 1))
    said = shaped(answer(*given), ahead.shape)
    off = abs(said - (ahead - behind)).max()
    if not off < 1e-8:
        leaves = abs(said.sum(axis=1)).max()
        told = f"off by up to {off:.2g} from what v gains along the edge"
        if leaves < 1e-8:
            return f"{told}; nothing leaves a triangle altogether, so look at A and at which edge a column has"
        return f"{told}; up to {leaves:.2g} leaves a triangle altogether, and it should be nothing"


def evidence(answer, case):
    return np.asarray(answer(*case[:-1]), float)


MISTAKES = {
    "inward": (
        ("outward = -1j", "outward = 1j"),
        "The normal points inwards, and every flux has the wrong sign. Walk round a triangle "
        "counter-clockwise: the"
        " outside is on your right",
    ),
    "normal of length 1": (
        ("outward = -1j * edges", "outward = -1j * edges / abs(edges)"),
        "The normal has length 1, so this is a flux per length. The integral runs along the whole "
        "edge, and long"
        " edges let more through",
    ),
    "along the edge": (
        ("outward = -1j * edges", "outward = edges"),
        "This is what flows along the edge and not across it. Turn either the flow or the edge by "
        "a right angle: see"
        " how grad v comes out of A grad u",
    ),
    "plain gradient": (
        ("return (flow.conj()", "return (grad_u.conj()"),
        "The gradient itself is taken, without A: that is right for mu = 0 alone. With another mu "
        "the lines of v are"
        " not perpendicular to those of u",
    ),
    "A of -mu": (
        ("- 2 * mu * grad_u", "+ 2 * mu * grad_u"),
        "The sign before 2 mu is wrong, and this is the inverse of A. Test it on f = z + mu "
        "conj(z) with a real mu,"
        " where u and v are stretched by known factors",
    ),
    "another edge": (
        ("np.roll(z[faces], -2, axis=1) - np.roll(z[faces], -1, axis=1)", "np.roll(z[faces], -1, axis=1) - z[faces]"),
        "The columns are shifted: column k has the edge that begins at corner k. Asked is the one "
        "opposite to it, as"
        " for the gradients of hat functions",
    ),
}
