import numpy as np

import qclearn as qc

from . import parts

TITLE = "Two maps of folds, compared"
PAGE, MINUTES, POINTS = "folds", 25, 3
TASK = r"""
The section *What is compared* makes two feature maps comparable before it subtracts them. Do it for two maps `s`
and `t` on one surface, `(V,)` each. Given are also the `areas` of the vertices, `(V,)` in mm², the surface's
cotangent matrix `K`, sparse `(V, V)`, and the scale `sigma` in mm. Leave out the clipping, and

1. blur each map by four implicit steps $(A + \tfrac{\sigma^2}8 K)\,u_{\text{new}} = A u$ with the diagonal matrix
   $A$ of the areas;
2. standardise it: mean 0 and variance 1 over the surface's area.

Return two numbers, in a tuple or an array: the mismatch, the mean over the area of the squared difference, and the
correlation $r$. How they hang together is said by {prf:ref}`the mismatch is a correlation <prop-folds-correlation>`.
"""


# %% answer
def mismatch_and_r(s, t, areas, K, sigma):
    """(mismatch, r) of two maps (V,) that are blurred over sigma."""
    from scipy import sparse
    from scipy.sparse.linalg import splu

    ### BEGIN SOLUTION
    shares, made = areas / areas.sum(), []
    A = sparse.diags_array(areas)
    factors = splu((A + sigma**2 / 8 * K).tocsc())
    for u in (s, t):
        for _ in range(4):
            u = factors.solve(areas * u)
        u = u - shares @ u
        made.append(u / np.sqrt(shares @ u**2))
    s, t = made
    return shares @ (s - t) ** 2, shares @ (s * t)
    ### END SOLUTION


# %% test
def cases(rng):
    """(s, t, areas, K, sigma) on a bumpy sheet whose triangles are small in the middle."""
    z, faces = qc.polar_disk(7, 20, power=1.8)
    height = 8 * np.sin(3 * z.real + rng.uniform(0, 6)) * np.cos(4 * z.imag)
    vertices = np.stack([50 * z.real, 50 * z.imag, height], axis=1)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    size = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    areas = np.bincount(faces.ravel(), np.repeat(size / 3, 3), len(z))
    s = np.sin(4 * z.real + rng.uniform(0, 6)) + 2 * abs(z) + 0.3 * rng.normal(size=len(z))
    t = s + rng.uniform(0.5, 1.0) * np.cos(5 * z.imag) + 0.3 * rng.normal(size=len(z))
    for sigma in (4.0, 16.0):
        yield s, 10 + 3 * t, areas, qc.cotangent_stiffness(vertices, faces), sigma


def blurred(u, areas, K, sigma):
    """The four steps by eigenvectors, each of which a step divides by a number of its own."""
    from scipy import linalg

    values, vectors = linalg.eigh(K.toarray(), np.diag(areas))
    return vectors @ ((vectors.T @ (areas * u)) / (1 + sigma**2 / 8 * values) ** 4)


def verdict(answer, case):
    s, t, areas, K, sigma = case
    said = parts(answer(s.copy(), t.copy(), areas.copy(), K, sigma), 2, "the mismatch and r")
    mismatch, r = map(float, said)
    covariance = np.cov([blurred(u, areas, K, sigma) for u in (s, t)], aweights=areas)
    right = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    if not abs(r - right) <= 1e-6:
        return f"blurred over {sigma:g} mm the two maps have r = {right:.6g}, and not {r:.6g}"
    if not abs(mismatch - 2 * (1 - right)) <= 1e-6:
        return f"the mismatch is {mismatch:.6g} where r is {right:.6g}: what does the proposition say?"


def evidence(answer, case):
    s, t, areas, K, sigma = case
    return np.array(answer(s.copy(), t.copy(), areas.copy(), K, sigma), float)


MISTAKES = {
    "by vertices": (
        ("shares, made = areas / areas.sum(), []", "shares, made = 1 / len(areas) + 0 * areas, []"),
        "Each vertex counts alike: where vertices crowd the maps count more. Mean, variance and "
        "mismatch go by "
        "the area of a vertex",
    ),
    "one step": (
        ("range(4)", "range(1)"),
        "One step of the four: the flow stops after a quarter of its time, and the blur is half as wide as sigma",
    ),
    "sigma for its square": (
        ("sigma**2 / 8", "sigma / 8"),
        "The time of a heat flow goes with the square of a length: look at the units of K and of A in the step",
    ),
    "without areas on the right": (
        ("factors.solve(areas * u)", "factors.solve(u)"),
        "The right side of a step lacks the areas: a constant map does not stay constant then, and small vertices gain",
    ),
    "standardised first": (
        (
            "        for _ in range(4):\n            u = factors.solve(areas * u)\n        u = u "
            "- shares @ u\n"
            "        made.append(u / np.sqrt(shares @ u**2))\n",
            "        u = u - shares @ u\n        u = u / np.sqrt(shares @ u**2)\n"
            "        for _ in range(4):\n            u = factors.solve(areas * u)\n        "
            "made.append(u)\n",
        ),
        "The maps are standardised and then blurred: the blur takes variance away, and what is "
        "left is no "
        "correlation. Blur first",
    ),
    "the sum": (
        ("return shares @ (s - t) ** 2,", "return areas @ (s - t) ** 2,"),
        "The mismatch is an integral, in mm². Divided by the area it is a mean without a unit, "
        "and its weight a "
        "plain number",
    ),
}
