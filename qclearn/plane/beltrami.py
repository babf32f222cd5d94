"""Piecewise linear quasi-conformal geometry in complex arithmetic, and the Linear Beltrami Solver: the public doors.

A point, a map and the gradient of a real function are complex numbers; on a triangle a map is affine, so that its
Wirtinger derivatives and its Beltrami coefficient are constants of the triangle. Each door takes a mesh as arrays,
makes a `Disk` of it and asks that.
"""

import warnings

from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy import sparse

from .bijectivity import RepairWarning, unfold
from .checks import check_pins, check_used, planar_points
from .disk import Disk
from .linear import Dirichlet
from .solver import DiskSolver


def signed_areas(z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"]) -> Float[ndarray, " F"]:
    """Signed area of each triangle, positive when counter-clockwise: Im(conj(b - a)(c - a)) / 2.

    BeltramiError where a face names a vertex that is not there.
    """
    return Disk(z, faces).areas


def hat_gradients(z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"]) -> Complex[ndarray, " F 3"]:
    """Gradients of the three hat functions of each triangle as complex numbers, in 1/length.

    `grad phi_i = i (z_k - z_j) / (2 |T|)` for a counter-clockwise triangle (i, j, k): the pair (A_i, B_i) of the
    paper's section on the LBS with its factor mended (divided by twice the area). Raises BeltramiError where a
    triangle of the source mesh is clockwise or has no area.
    """
    return Disk(z, faces).gradients


def wirtinger(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], f: Complex[ndarray, " V"] | Float[ndarray, " V 3"]
) -> tuple[Complex[ndarray, " F *c"], Complex[ndarray, " F *c"]]:
    """The derivatives `f_z = (f_x - i f_y)/2` and `f_zbar = (f_x + i f_y)/2` of a piecewise linear map.

    A map into space, real, gives one column a coordinate.
    """
    return Disk(z, faces).wirtinger(f)


def jacobian(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], f: Complex[ndarray, " V"]
) -> Float[ndarray, " F"]:
    """Jacobian determinant of a planar map on each triangle, `|f_z|^2 - |f_zbar|^2`; negative where it folds."""
    f = planar_points(f, "f")  # a surface (V, 3) has no sign to tell
    f_z, f_zbar = Disk(z, faces).wirtinger(f)
    return abs(f_z) ** 2 - abs(f_zbar) ** 2


def beltrami_coefficient(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], f: Complex[ndarray, " V"] | Float[ndarray, " V 3"]
) -> Complex[ndarray, " F"]:
    """The Beltrami coefficient `mu = f_zbar / f_z` of a map on each triangle.

    `f` complex: a planar map; |mu| > 1 where it reverses orientation, infinite where it is anti-conformal.
    `f` real: a surface; then `mu = (E - G + 2iF) / (E + G + 2 sqrt(EG - F^2))` of the induced metric, which
    never exceeds 1 and so cannot show a fold. Source: paper, section 'Quasi-Conformal Theory'.
    """
    return Disk(z, faces).coefficient(f)


def stiffness(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], mu: Complex[ndarray, " F"]
) -> Float[sparse.csc_array, " V V"]:
    """The matrix `K(mu)_ij = sum_T |T| grad phi_i . A(mu_T) grad phi_j`, sparse (V, V), positive semi-definite.

    `(K u)_i = 0` is the mended form of the paper's eqs. linear_system_x and linear_system_y (with the area weight).
    """
    return Disk(z, faces).stiffness(mu)


def locate(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], points: Complex[ndarray, " P"]
) -> tuple[Integer[ndarray, " P"], Float[ndarray, " P 3"]]:
    """Where points lie in a disk mesh: (face, barycentric coordinates, non-negative, sum 1).

    A point beyond the boundary polygon (between a chord and its arc, say) is first moved radially onto the polygon;
    one inside the circle stays short of it by up to INSET of its radius, so that triangles there keep an area.
    BeltramiError for a point that is not finite.
    """
    return Disk(z, faces).locate(points)


def solve_beltrami(
    z: Complex[ndarray, " V"],
    faces: Integer[ndarray, " F 3"],
    mu: Complex[ndarray, " F"],
    pinned: Integer[ndarray, " K"],
    values: Complex[ndarray, " K"],
) -> Complex[ndarray, " V"]:
    """The Linear Beltrami Solver: the piecewise linear map with coefficient mu and given values.

    Solves `div(A(mu) grad u) = 0` for both coordinates with `f = values` at the vertices `pinned`.
    Not certified: with pins on the whole boundary the result's own coefficient differs from mu, and pins inside
    can fold it; ask `check_bijective`. Raises BeltramiError for |mu| >= 1, a folded source or unusable pins.
    Source: paper, section 'Linear Beltrami Solver', with the errata of the chapter on it.
    """
    disk = Disk(z, faces)
    check_used(disk)
    pinned, values = check_pins(pinned, values, len(disk.z))
    return Dirichlet(disk.stiffness(mu), pinned).solve(values)


def solve_beltrami_disk(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], mu: Complex[ndarray, " F"], repair: bool = False
) -> Complex[ndarray, " V"]:
    """The disk self-map with Beltrami coefficient mu (F,) and a free boundary, f(0) = 0 and f(1) = 1: complex (V,).

    z (V,) complex with its boundary on the unit circle. Exact up to discretisation: the flux form, one factorisation
    for the mesh (its boundary steps are calibrated at mu = 0 where they are off by more than 1 %) and one for mu.
    Not certified: a discrete map can fold where mu varies within few triangles, or where triangles are slivers; ask
    `check_bijective`. repair: where it folds, switch rows to mean-value weights, which moves f there and nearby. A
    RepairWarning says if boundary steps had to be raised, if rows were switched, and whether faces stay flipped.
    Errors: BeltramiError, SurfaceError. Source: paper, theorem 1 (existence and uniqueness).
    """
    solver = DiskSolver(Disk(z, faces))
    f, words = solver.solve(mu), []
    if solver.floored:
        words.append(f"{solver.floored} boundary steps ran backwards or were lost, and were raised")
    if repair:
        f, rows = unfold(solver, f)
        if len(rows):
            left = len(solver.disk.at(f).reversed)
            words.append(f"{len(rows)} rows switched to mean-value weights, {left} faces stay flipped")
    if words:
        warnings.warn("; ".join(words), RepairWarning, stacklevel=2)
    return f


class BeltramiDiskSolver(DiskSolver):
    """`DiskSolver` of a mesh given as arrays: z (V,) complex with its boundary on the unit circle, faces (F, 3)."""

    def __init__(self, z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"]):
        super().__init__(Disk(z, faces))
