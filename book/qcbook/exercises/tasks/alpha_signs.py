import numpy as np

TITLE = "Three entries of a matrix"
PAGE, MINUTES, POINTS = "lbs", 15, 2
TASK = r"""
Equation (6) of the paper says how the derivatives of $f = u + iv$ hang together,

$$
v_y = \alpha_1 u_x + \alpha_2 u_y, \qquad -v_x = \alpha_2 u_x + \alpha_3 u_y .
$$

Write `alphas`: it returns the three numbers as functions of $\mu = \rho + i\tau$: a tuple of three real numbers for a
complex number, of three real arrays for an array. Signs decide here, and [the paper itself has slipped](#erratum-1),
so derive them: from $\nabla v = i A(\mu) \nabla u$ in the section *From one complex equation to two real ones*, or
from the four derivatives of $f = z + \mu\bar z$. Then test yourself by
{prf:ref}`the proposition on the matrix <prop-matrix>`: what is $\det A$, and which direction does $A$ shrink?
"""
READ = "Why do the wrong signs of (10), [E1](#erratum-1), not change the map that (15) and (16) give?"


# %% answer
def alphas(mu):
    """(alpha_1, alpha_2, alpha_3) for complex mu, a number or an array."""
    ### BEGIN SOLUTION
    rho, tau = np.real(mu), np.imag(mu)
    size = 1 - rho**2 - tau**2
    narrow, wide = (rho - 1) ** 2 + tau**2, (rho + 1) ** 2 + tau**2
    return narrow / size, -2 * tau / size, wide / size
    ### END SOLUTION


# %% test
def cases(rng):
    """Affine maps p z + p mu conj(z), one alone, then six at once: mu and the four derivatives."""
    for shape in ((), (6,)):
        axis, lean = (rng.integers(4, size=shape), rng.uniform(0.2, 0.8, shape))  # no mu is real or imaginary
        mu = rng.uniform(0.3, 0.8, shape) * np.exp(0.5j * np.pi * (axis + lean))
        p = rng.normal(size=(*shape, 2)) @ [1, 1j]
        f_x, f_y = p + mu * p, 1j * (p - mu * p)
        yield mu, f_x.real, f_y.real, f_x.imag, f_y.imag


def verdict(answer, case):
    mu, u_x, u_y, v_x, v_y = case
    words = "for an array of mu" if np.shape(mu) else f"for mu = {mu:.2f}"
    said = answer(mu)
    if np.shape(said) != (3, *np.shape(mu)):
        return f"three numbers of the shape of mu are asked for, and it returns the shape {np.shape(said)}"
    a1, a2, a3 = said
    first, second = (np.max(abs(off)) for off in (v_y - a1 * u_x - a2 * u_y, v_x + a2 * u_x + a3 * u_y))
    if not max(first, second) < 1e-9:
        return f"{words}, v_y = ... is off by {first:.2g} and -v_x = ... by {second:.2g}"


def evidence(answer, case):
    return np.array(answer(case[0]), float)


MISTAKES = {
    "sign of alpha_2": (
        ("-2 * tau / size", "2 * tau / size"),
        "alpha_2 has the wrong sign. Take mu = 0.5i: circles become ellipses along 45 degrees, "
        "and by the proposition"
        " on the matrix A is smallest in that direction",
    ),
    "alpha_1 and alpha_3 exchanged": (
        (
            "narrow, wide = (rho - 1) ** 2 + tau**2, (rho + 1) ** 2",
            "wide, narrow = (rho - 1) ** 2 + tau**2, (rho + 1) ** 2",
        ),
        "alpha_1 and alpha_3 are exchanged. Take a real mu > 0, a stretch along x: by the "
        "proposition on the matrix A"
        " shrinks the long axis",
    ),
    "the inverse": (
        ("rho, tau = np.real(mu), np.imag(mu)", "rho, tau = -np.real(mu), -np.imag(mu)"),
        "This is the inverse of A, the matrix that belongs to -mu: the short and the long axis "
        "are exchanged. The"
        " proof of the proposition on the matrix has the eigenvectors",
    ),
    "half of alpha_2": (
        ("-2 * tau / size", "-tau / size"),
        "alpha_2 is half of what it should be, so that the determinant is not 1. Square |mu - 1| "
        "and |mu + 1| once"
        " more, and see what is left between them",
    ),
    "divided by 1 - |mu|": (
        ("size = 1 - rho**2 - tau**2", "size = 1 - np.hypot(rho, tau)"),
        "The denominator has |mu| in place of its square: the determinant of A is not 1. See "
        "where the derivative f_z"
        " is eliminated in the text",
    ),
    "the printed pair": (
        ("return narrow / size, -2 * tau / size, wide / size", "return -narrow / size, 2 * tau / size, -wide / size"),
        "These are the signs of the paper's (10), erratum E1: such an A is negative definite, and "
        "its energy has no"
        " least value",
    ),
}
