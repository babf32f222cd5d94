import numpy as np

import qclearn as qc
from qclearn.plane import Disk

from . import shaped

TITLE = "What must vanish at a free boundary"
PAGE, MINUTES, POINTS = "dbsnet", 20, 3
TASK = r"""
The printed loss asks that all rows $(Kf)_i$ vanish, and it is smallest for a collapsed map, [E6](#erratum-6). What
vanishes at the right map is the gradient of energy minus area: [the residual](#eq-fb-residual) $R$ of the section
*Why the printed loss collapses the map*. Write `residual`, which returns it at every vertex, complex `(V,)`. Given
are `z`, complex `(V,)`, counter-clockwise `faces`, integer `(F, 3)`, `mu`, complex `(F,)`, any map `f`, complex
`(V,)`, and `loop`, integer `(B,)`, the boundary vertices in counter-clockwise order. `qc.stiffness(z, faces, mu)` is
the matrix $K$. The energy is $\tfrac12 \operatorname{Re}\sum_i \overline{f_i}\,(Kf)_i$, and in the convention of the
library it changes, less the area, by $\operatorname{Re}\sum_i \overline{R_i}\,df_i$: inside, $R_i$ is $(Kf)_i$
without another factor. The check asks about maps that solve nothing, too: your answer has to be the gradient, not
only vanish where the gradient does.
"""


# %% answer
def residual(z, faces, mu, f, loop):
    """Gradient of energy minus area with respect to f, complex (V,)."""
    ### BEGIN SOLUTION
    R = qc.stiffness(z, faces, mu) @ f
    along = np.roll(f[loop], -1) - np.roll(f[loop], 1)
    R[loop] += 0.5j * along
    return R
    ### END SOLUTION


# %% test
def cases(rng):
    """An affine map with its own coefficient, where the gradient is 0, and arbitrary maps and
    coefficients."""
    z, faces = qc.polar_disk(4, 13)
    order = rng.permutation(len(z))
    disk = Disk(z[order], np.argsort(order)[faces])
    z, count = disk.z, len(disk.faces)
    p, q = rng.normal(size=(2, 2)) @ [1, 1j]
    mu = 0.5 * q / abs(q)
    yield "an affine map", z, disk.faces, np.full(count, mu), p * (z + mu * z.conj()), disk.loop
    for _ in range(2):
        mu = rng.uniform(0.1, 0.7, count) * np.exp(2j * np.pi * rng.uniform(size=count))
        f = z + 0.2 * (rng.normal(size=(len(z), 2)) @ [1, 1j])
        yield "an arbitrary map", z, disk.faces, mu, f, disk.loop


def gradient(z, faces, mu, f):
    """Derivative of sum |T| 2 |f_zbar - mu f_z|^2 / (1 - |mu|^2), which is energy minus area, by f."""
    f_z, f_zbar = qc.wirtinger(z, faces, f)
    hats, area = qc.hat_gradients(z, faces), qc.signed_areas(z, faces)
    slope = (2 * area * (f_zbar - mu * f_z) / (1 - abs(mu) ** 2))[:, None]
    terms = slope * (hats.conj() - mu.conj()[:, None] * hats)
    found = np.zeros(len(z), complex)
    np.add.at(found, faces, terms)
    return found


def verdict(answer, case):
    words, *given, loop = case
    right = gradient(*given)
    said = shaped(answer(*given, loop), right.shape)
    off = abs(said - right)
    if not off.max() < 1e-8:
        rim, inner = off[loop].max(), np.delete(off, loop).max()
        return f"for {words} the gradient is off by up to {rim:.2g} on the boundary and {inner:.2g} inside"


def evidence(answer, case):
    return np.asarray(answer(*case[1:]), complex)


MISTAKES = {
    "all rows": (
        ("R[loop] += 0.5j * along", "R[loop] += 0"),
        "These are the plain rows of K everywhere, the printed ones of erratum E6. At the "
        "boundary the right map's"
        " rows are not 0: area has a gradient there",
    ),
    "sign of the area": (
        ("R[loop] += 0.5j", "R[loop] -= 0.5j"),
        "The gradient of the area has the wrong sign: this is energy plus area. Check that it "
        "vanishes for the"
        " identity and mu = 0",
    ),
    "inner rows alone": (
        ("R[loop] += 0.5j * along", "R[loop] = 0"),
        "The boundary rows are set to 0, so that any placement of the boundary would do: the inner "
        "rows vanish for each",
    ),
    "one neighbour": (
        ("np.roll(f[loop], -1) - np.roll(f[loop], 1)", "np.roll(f[loop], -1) - f[loop]"),
        "The step goes to the next neighbour only. A boundary vertex belongs to two edges, so the "
        "area's derivative"
        " there knows both neighbours",
    ),
    "twice the area": (
        ("0.5j * along", "1j * along"),
        "The gradient of the area is too large by a factor of two. Differentiate the formula for "
        "the area as a sum"
        " along the boundary",
    ),
    "not turned": (
        ("0.5j * along", "0.5 * along"),
        "The step along the boundary is not turned by a right angle: area grows where a point "
        "moves outwards, across"
        " the boundary. The residual on the page has an i there",
    ),
}
