"""The public functions on meshes given as arrays: derivatives of piecewise linear maps, the Linear
Beltrami Solver, and the map with a free boundary.

Points, maps and gradients of real functions are complex numbers. On a triangle a map is affine: its
Wirtinger derivatives and its Beltrami coefficient are constants. Each function makes a `Disk` of
its arrays, whose method does the work. Only the calls with arrays stand here: `register` and the
fit use `Disk` and `DiskSolver` of solver.py.
"""

import warnings

from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy import sparse

from .bijectivity import RepairWarning, unfold
from .checks import check_pins, check_used, planar_points
from .disk import Disk, Faces, PerFace, PerVertex
from .linear import Dirichlet
from .solver import DiskSolver


def signed_areas(z: PerVertex, faces: Faces) -> Float[ndarray, " F"]:
    """Signed area of each triangle, positive if counter-clockwise: `Im(conj(b - a)(c - a)) / 2`."""
    return Disk(z, faces).areas


def hat_gradients(z: PerVertex, faces: Faces) -> Complex[ndarray, " F 3"]:
    """Gradients of each triangle's hat functions, in 1/length: `grad phi_i = i (z_k - z_j) / (2
    |T|)`.

    The triangle (i, j, k) is counter-clockwise, else BeltramiError. The pair (A_i, B_i) of the
    paper's section on the LBS, its factor corrected (divided by twice the area).
    """
    return Disk(z, faces).gradients


def wirtinger(
    z: PerVertex, faces: Faces, f: PerVertex | Float[ndarray, " V 3"]
) -> tuple[Complex[ndarray, " F *c"], Complex[ndarray, " F *c"]]:
    """`f_z = (f_x - i f_y)/2` and `f_zbar = (f_x + i f_y)/2` of a map; one column a coordinate
    where f is in space."""
    return Disk(z, faces).wirtinger(f)


def jacobian(z: PerVertex, faces: Faces, f: PerVertex) -> Float[ndarray, " F"]:
    """Jacobian determinant of a planar map on each triangle, `|f_z|^2 - |f_zbar|^2`; negative where
    it folds."""
    f = planar_points(f, "f")  # a map to a surface (V, 3) has no orientation
    f_z, f_zbar = Disk(z, faces).wirtinger(f)
    return abs(f_z) ** 2 - abs(f_zbar) ** 2


def beltrami_coefficient(
    z: PerVertex, faces: Faces, f: PerVertex | Float[ndarray, " V 3"]
) -> PerFace:
    """The Beltrami coefficient `mu = f_zbar / f_z` of a map on each triangle.

    f complex: a planar map; |mu| > 1 where it reverses orientation, infinite where it is
    anti-conformal. f real: a surface; `mu = (E - G + 2iF) / (E + G + 2 sqrt(EG - F^2))` of the
    induced metric never exceeds 1 and shows no fold. Source: paper, section 'Quasi-Conformal
    Theory'.
    """
    return Disk(z, faces).coefficient(f)


def stiffness(z: PerVertex, faces: Faces, mu: PerFace) -> Float[sparse.csc_array, " V V"]:
    """The positive semi-definite matrix `K(mu)_ij = sum_T |T| grad phi_i . A(mu_T) grad phi_j`,
    |mu| < 1.

    `(K u)_i = 0` is the corrected form (with the area weight) of the paper's eqs. linear_system_x
    and linear_system_y.
    """
    return Disk(z, faces).stiffness(mu)


def locate(
    z: PerVertex, faces: Faces, points: Complex[ndarray, " P"]
) -> tuple[Integer[ndarray, " P"], Float[ndarray, " P 3"]]:
    """Where finite points lie in a disk mesh: (face, barycentric coordinates, non-negative, sum 1).

    A point beyond the boundary polygon (between a chord and its arc, say) is first moved radially
    onto the polygon; one inside the circle stays short of it by up to INSET of its radius, so that
    triangles there keep an area.
    """
    face, weights = Disk(z, faces).locate(points)
    return face.copy(), weights.copy()


def solve_beltrami(
    z: PerVertex,
    faces: Faces,
    mu: PerFace,
    pinned: Integer[ndarray, " K"],
    values: Complex[ndarray, " K"],
) -> PerVertex:
    """The Linear Beltrami Solver: `div(A(mu) grad u) = 0` for both coordinates, `f = values` at the
    vertices `pinned`.

    Not certified: with the whole boundary pinned the result's own coefficient differs from mu, and
    pins inside can fold it; ask `check_bijective`. BeltramiError for |mu| >= 1, a folded source or
    unusable pins. Source: paper, section 'Linear Beltrami Solver', with the errata of the chapter
    on it.
    """
    disk = Disk(z, faces)
    check_used(disk)
    pinned, values = check_pins(pinned, values, len(disk.z))
    return Dirichlet(disk.stiffness(mu), pinned).solve(values)


def solve_beltrami_disk(z: PerVertex, faces: Faces, mu: PerFace, repair: bool = False) -> PerVertex:
    """The disk self-map with Beltrami coefficient mu (F,) and a free boundary, f(0) = 0 and f(1) =
    1: complex (V,).

    z: its boundary on the unit circle. The flux form: exact up to discretisation, one factorisation
    for the mesh (boundary steps are calibrated at mu = 0 where they are off by more than 1 %) and
    one for mu. Not certified: f can fold where mu varies within few triangles and at slivers; ask
    `check_bijective`. repair: where f folds, switch rows to mean-value weights, which moves f there
    and nearby. A RepairWarning names raised boundary steps, switched rows and faces that stay
    flipped. Errors: BeltramiError, SurfaceError. Source: paper, theorem 1.
    """
    solver = DiskSolver(Disk(z, faces))
    f = solver.solve(mu)
    messages = []
    if solver.floored:
        messages.append(
            f"{solver.floored} boundary steps ran backwards or were lost, and were raised"
        )
    if repair:
        f, rows, _ = unfold(solver, f)
        if len(rows):
            left = len(solver.disk.at(f).flipped)
            messages.append(
                f"{len(rows)} rows switched to mean-value weights, {left} faces stay flipped"
            )
    if messages:
        warnings.warn("; ".join(messages), RepairWarning, stacklevel=2)
    return f


class BeltramiDiskSolver(DiskSolver):
    """`DiskSolver` of a mesh given as arrays: z (V,) complex with its boundary on the unit circle,
    faces (F, 3)."""

    def __init__(self, z: PerVertex, faces: Faces):
        super().__init__(Disk(z, faces))
