import numpy as np

import qclearn as qc

from . import shaped

TITLE = "First one map, then another"
PAGE, MINUTES, POINTS = "quasiconformal", 20, 3
TASK = r"""
A second map $g$ follows a first map $f$. Of $g$ only the coefficient is known: `mu_g(w)` gives $\mu_g$ at any points
$w$ of the plane in which the picture of $f$ lies. Write `mu_after`: return the coefficient of $g \circ f$ on every
triangle, complex `(F,)`, by {prf:ref}`the proposition on compositions <prop-composition>`. Given are `z`, complex
`(V,)`, `faces`, integer `(F, 3)`, the first map `f`, complex `(V,)`, and the function `mu_g` from complex arrays to
complex arrays. Take the value of $\mu_g$ at the centroid of a triangle's image. `qc.wirtinger` gives $f_z$ and
$f_{\bar z}$, `(F,)` each. Before you write, ask where each of the two coefficients lives, and what $f$ does to
directions on its way.
"""


# %% answer
def mu_after(z, faces, f, mu_g):
    """The coefficient of g after f on each triangle, complex (F,)."""
    f_z, f_zbar = qc.wirtinger(z, faces, f)
    ### BEGIN SOLUTION
    mu_f = f_zbar / f_z
    turned = f_z.conj() / f_z * mu_g(f[faces].mean(axis=1))
    return (mu_f + turned) / (1 + mu_f.conj() * turned)
    ### END SOLUTION


# %% test
def cases(rng):
    """Twisted, stretched and turned disks, followed by g = w + c conj(w)^2 + c conj(w)^3 / 6."""
    z, faces = qc.polar_disk(5, 15)
    for _ in range(3):
        turn, c = np.exp(2j * np.pi * rng.uniform(size=2))
        twist = rng.uniform(0.3, 0.6)
        f = turn * (z * np.exp(1j * twist * (1 - abs(z) ** 2)) + 0.2 * z.conj())
        yield z, faces, f, 0.3 * c


def called(answer, case):
    z, faces, f, c = case
    return np.asarray(answer(z, faces, f, lambda w: 2 * c * np.conj(w) + c * np.conj(w) ** 2 / 2))


def verdict(answer, case):
    z, faces, f, c = case
    f_z, f_zbar = qc.wirtinger(z, faces, f)
    w = f[faces].mean(axis=1).conj()
    g_wbar = 2 * c * w + c * w**2 / 2  # and g_w = 1: the chain rule, before anything is divided
    right = (f_zbar + g_wbar * f_z.conj()) / (f_z + g_wbar * f_zbar.conj())
    said = shaped(called(answer, case), right.shape)
    off = abs(said - right).max()
    if not off < 1e-8:
        part = "arguments" if np.allclose(abs(said), abs(right)) else "sizes"
        return (
            f"for g = w + c conj(w)² + c conj(w)³ / 6 the {part} differ from the chain rule's; off by up to {off:.2g}"
        )


def evidence(answer, case):
    return called(answer, case).astype(complex)


MISTAKES = {
    "asked at the source": (
        ("mu_g(f[faces]", "mu_g(z[faces]"),
        "The coefficient of g is asked for at points of the source. It lives where f ends: the "
        "proposition has mu_g"
        " after f, not mu_g",
    ),
    "not turned": (
        ("f_z.conj() / f_z * mu_g", "mu_g"),
        "The axes of g are not turned back. The derivative of f turns each triangle on its way, "
        "and the tau of the"
        " proposition undoes that",
    ),
    "turned the wrong way": (
        ("f_z.conj() / f_z", "f_z / f_z.conj()"),
        "The axes of g are turned the wrong way. Test with a plain turn for f: the stretch of g "
        "has to be seen from"
        " before the turn",
    ),
    "half of the turn": (
        ("f_z.conj() / f_z", "f_z.conj() / abs(f_z)"),
        "The axes of g are turned back by half of what is due. A coefficient turns by twice the "
        "angle by which its"
        " ellipse turns",
    ),
    "added": (
        (" / (1 + mu_f.conj() * turned)", ""),
        "The two coefficients are only added. That is right to first order; for large ones the "
        "sum can leave the unit"
        " disk, and the denominator of the proposition prevents it",
    ),
    "denominator without a conjugate": (
        ("1 + mu_f.conj() * turned", "1 + mu_f * turned"),
        "A conjugate is missing in the denominator. Derive it: divide the two lines of the chain "
        "rule in the proof of"
        " the proposition",
    ),
}
