import numpy as np

import qclearn as qc

TITLE = "Stretch is size and shape"
PAGE, MINUTES, POINTS = "worth", 20, 3
TASK = r"""
A map stretches a triangle by $\sigma_1 \ge \sigma_2 > 0$ in two perpendicular directions. The benchmark reports two
numbers, [both as logarithms to base two](#sec-be-real): size, $\log_2 J$ with the ratio of areas
$J = \sigma_1\sigma_2$, and shape, $\log_2 R$ with $R = \sigma_1/\sigma_2$. They are the sum and the difference of
Hencky's logarithmic strains $\log_2\sigma_1$ and $\log_2\sigma_2$, and shape is all that $|\mu|$ knows of a map.
Write `size_and_shape` for a map without folds: given are `z`, complex `(V,)`, counter-clockwise `faces`, integer
`(F, 3)`, and `f`, complex `(V,)`; return two real arrays, `(F,)` each. A change of scale shall count for nothing:
divide each $J$ by the ratio of the total areas first. The sizes of $f_z$ and $f_{\bar z}$ and the areas of the source
are given; {prf:ref}`the proposition on ellipses <prop-ellipse>` says what the two derivatives make of a small circle.
"""


# %% answer
def size_and_shape(z, faces, f):
    """(log2 J, total areas made equal; log2 R) of the faces, (F,) each."""
    f_z, f_zbar = map(abs, qc.wirtinger(z, faces, f))
    area = qc.signed_areas(z, faces)
    ### BEGIN SOLUTION
    J, R = f_z**2 - f_zbar**2, (f_z + f_zbar) / (f_z - f_zbar)
    scale = area @ J / area.sum()
    return np.log2(J / scale), np.log2(R)
    ### END SOLUTION


# %% test
def cases(rng):
    """Stretched, turned and scaled disks on meshes that are finer at the centre."""
    for _ in range(3):
        z, faces = qc.polar_disk(5, 15, power=1.5)
        scale = rng.uniform(2, 4) * np.exp(2j * np.pi * rng.uniform())
        f = z * (1 + 0.5 * abs(z) ** 2) * np.exp(0.4j * (1 - abs(z) ** 2)) + 0.2 * z.conj()
        yield z, faces, scale * f


def singular_values(z, faces, f):
    """The stretches of each triangle, (F, 2), from the real matrix that takes its edges to their
    images."""
    edges, images = ((w[faces[:, 1:]] - w[faces[:, :1]])[:, None] for w in (z, f))
    before, after = (np.concatenate([w.real, w.imag], axis=1) for w in (edges, images))
    return np.linalg.svd(after @ np.linalg.inv(before), compute_uv=False)


def verdict(answer, case):
    z, faces, f = case
    longer, shorter = singular_values(z, faces, f).T
    ratio = qc.signed_areas(f, faces).sum() / qc.signed_areas(z, faces).sum()
    said = answer(*case)
    if np.shape(said) != (2, len(faces)):
        return f"two arrays of {len(faces)} numbers are asked for, and it returns the shape {np.shape(said)}"
    for name, one, right in zip(("size", "shape"), said, (longer * shorter / ratio, longer / shorter)):
        off = abs(one - np.log2(right))
        if not off.max() < 1e-8:
            k = off.argmax()
            return f"the {name} of face {k} should be {np.log2(right[k]):.6g}, and not {one[k]:.6g}"


def evidence(answer, case):
    return np.array(answer(*case), float)


MISTAKES = {
    "scale left in": (
        ("np.log2(J / scale)", "np.log2(J)"),
        "The change of scale is still in the size: a map that only enlarges would be called "
        "distorted. Divide by the"
        " ratio of the total areas",
    ),
    "scale by triangles": (
        ("area @ J / area.sum()", "J.mean()"),
        "The scale is a mean in which every triangle counts alike, so it depends on the mesh. The "
        "ratio of the total"
        " areas weighs by area",
    ),
    "mean of the logarithms": (
        ("np.log2(J / scale)", "np.log2(J) - area @ np.log2(J) / area.sum()"),
        "The mean logarithm is taken off, a geometric mean of the ratios. That is not the ratio "
        "of the total areas,"
        " which is an arithmetic one",
    ),
    "natural logarithms": (
        ("return np.log2(J / scale), np.log2(R)", "return np.log(J / scale), np.log(R)"),
        "These are natural logarithms. The benchmark's have base two, so that one means a factor of two",
    ),
    "area of the turning part": (
        ("f_z**2 - f_zbar**2,", "f_z**2,"),
        "The ratio of areas is that of the turning part alone. The reflected part takes area "
        "away: see the"
        " determinant at the beginning of the page on quasi-conformal maps",
    ),
    "sum of squares": (
        ("f_z**2 - f_zbar**2,", "f_z**2 + f_zbar**2,"),
        "The two derivatives' squares are added, which is the energy's density. Area is the "
        "product of the two"
        " half-axes of the ellipse: multiply them",
    ),
    "quotient of squares": (
        ("(f_z + f_zbar) / (f_z - f_zbar)", "(f_z**2 + f_zbar**2) / (f_z**2 - f_zbar**2)"),
        "The shape is energy over area, which stays near 1 even where mu is large. The quotient "
        "of the half-axes of"
        " the ellipse is asked for, the dilatation",
    ),
}
