import numpy as np

from . import shaped

TITLE = "A coefficient from three corners"
PAGE, MINUTES, POINTS = "quasiconformal", 20, 2
TASK = r"""
A piecewise linear map is affine on a triangle, so two edges tell all about it. Let $p, q$ be the edges that leave the
first corner, and $P, Q$ their images. By [the differential](#eq-qc-differential)

$$
P = f_z\, p + f_{\bar z}\, \bar p, \qquad Q = f_z\, q + f_{\bar z}\, \bar q .
$$

Solve for the two derivatives, and let `mu_of` return $\mu = f_{\bar z}/f_z$ on every triangle, complex `(F,)`. Given
are the vertices `z`, complex `(V,)`, the triangles `faces`, integer `(F, 3)`, and the images `f`, complex `(V,)`. Use
nothing but the edges: source triangles may run either way round, and the map turns some of them over. The section
*The coefficient of a piecewise linear map* says what $\mu$ is there.
"""


# %% answer
def mu_of(z, faces, f):
    """The Beltrami coefficient of f on each triangle, complex (F,)."""
    ### BEGIN SOLUTION
    source, image = z[faces], f[faces]
    p, q = source[:, 1] - source[:, 0], source[:, 2] - source[:, 0]
    P, Q = image[:, 1] - image[:, 0], image[:, 2] - image[:, 0]
    determinant = p * q.conj() - q * p.conj()
    f_z = (P * q.conj() - Q * p.conj()) / determinant
    f_zbar = (Q * p - P * q) / determinant
    return f_zbar / f_z
    ### END SOLUTION


# %% test
def cases(rng):
    """Triangles that share no vertex, each with an affine map f_z z + f_zbar conj(z) of its own,
    two of them folded."""
    count = 10
    for _ in range(3):
        corners = 2 * np.pi * (np.arange(3) / 3 + 0.15 * rng.uniform(-1, 1, (count, 3)))
        z = np.exp(1j * corners) + 3 * (rng.normal(size=(2, count, 1)) * [[[1]], [[1j]]]).sum(0)
        f_z = rng.uniform(0.5, 2, count) * np.exp(2j * np.pi * rng.uniform(size=count))
        mu = rng.uniform(0.2, 0.8, count) * np.exp(2j * np.pi * rng.uniform(size=count))
        mu[:2] *= 4 / abs(mu[:2])
        f = f_z[:, None] * (z + mu[:, None] * z.conj()) + rng.normal(size=(count, 1))
        faces = np.arange(3 * count).reshape(count, 3)
        faces[1::2] = faces[1::2, ::-1]
        yield z.ravel(), faces, f.ravel(), mu


def verdict(answer, case):
    *given, right = case
    said = shaped(answer(*given), right.shape)
    if bad := int((~np.isfinite(said)).sum()):
        return f"on {bad} of {len(said)} triangles the answer is no number: is something divided by 0 there?"
    off = abs(said - right)
    if not off.max() < 1e-8:
        worst = off.argmax()
        where = f"on a triangle with |mu| = {abs(right[worst]):.2f}"
        return f"{where} the answer is off by {off[worst]:.2g}; do the two equations hold?"


def evidence(answer, case):
    return np.asarray(answer(*case[:-1]), complex)


MISTAKES = {
    "upside down": (
        ("return f_zbar / f_z", "return f_z / f_zbar"),
        "The quotient stands upside down: a map without folds gets |mu| above 1. Look at the "
        "Beltrami equation, and"
        " at which of the two derivatives is 0 for a conformal map",
    ),
    "minus": (
        ("f_zbar = (Q * p - P * q)", "f_zbar = (P * q - Q * p)"),
        "This is minus mu: every ellipse is turned by a right angle. Put your two derivatives "
        "back into the first of"
        " the two equations, and see which one has the wrong sign",
    ),
    "source and image exchanged": (
        ("source, image = z[faces], f[faces]", "source, image = f[faces], z[faces]"),
        "Source and image are exchanged, or a conjugate stands at the wrong factor below the "
        "line: this is the"
        " coefficient of the inverse map. The two formulas of the"
        " proposition on compositions show how the two differ",
    ),
    "size alone": (
        ("return f_zbar / f_z", "return abs(f_zbar / f_z)"),
        "This is the size of mu alone. The direction of the stretch is in its argument: see the "
        "proposition 'What mu"
        " does to a small circle'",
    ),
    "conjugated": (
        ("return f_zbar / f_z", "return (f_zbar / f_z).conj()"),
        "The size is right, and the argument has the wrong sign: the ellipse leans to the other "
        "side. Follow the"
        " conjugates through the two equations",
    ),
    "seen from the image": (
        ("return f_zbar / f_z", "return f_zbar / f_z.conj()"),
        "The size is right, but the direction depends on how the map turns the triangle. The "
        "Beltrami equation"
        " divides by the derivative itself, not by its conjugate",
    ),
    "blind to folds": (
        ("return f_zbar / f_z", "return np.where(abs(f_zbar) > abs(f_z), (f_z / f_zbar).conj(), f_zbar / f_z)"),
        "Folded triangles get |mu| below 1, as from a metric, which does not know which side is "
        "up. Read the"
        " paragraph 'Folds' once more: in the plane mu sees them",
    ),
}
