"""Maps of a triangulated disk onto the unit disk with a free boundary: the exact solver.

With 0 and 1 held the boundary may slide along the circle, and the map with a given Beltrami coefficient is still the
solution of linear problems: the boundary moves by the harmonic measure of A(mu) seen from 0 (the flux form).
"""

import warnings
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy import sparse

from .beltrami import Dirichlet, assemble, hat_gradients, signed_areas, stiffness, stiffness_blocks
from .bijectivity import RepairWarning, check_embedding, flipped_faces
from .bijectivity import repair as switch_rows
from .checks import check_coefficient, check_mesh, check_used
from .diskmesh import SurfaceError, boundary_loop, locate
from .dissection import nested_dissection
from .mobius import mobius, mobius_inverse

LARGE = 20_000  # vertices from which on the order of elimination is worth its own search
SMALLEST_STEP = 1e-3  # of the mean boundary step, where a negative weight makes the boundary run backwards
LOST_STEP = 1e-8  # of the mean: beyond, at the end of a long peninsula, triangles are lost in the coordinates' rounding


class FreeBoundary:
    """The flux form for one stiffness matrix K, before normalisation: the map `f` sends the pole near 0.

    1. `K_ii U_i = -2 pi e_o`, U = 0 on the boundary; 2. the fluxes `F = (K U)_b` sum to 2 pi, their densities
    `q_k = F_k / (l_{k-1/2} + l_{k+1/2})` give the angle over each boundary edge, `l_{k+1/2} (q_k + q_{k+1})`;
    3. `K_ii f_i = -K_ib f_b` with `f_b = exp(i theta_b)` and the same factorisation.
    """

    def __init__(self, dirichlet, lengths, pole, calibration=None):
        self.dirichlet, self.loop = dirichlet, dirichlet.pinned
        self.lengths, self.spans = lengths, lengths + np.roll(lengths, 1)
        load = np.where(self.dirichlet.free == pole, -2 * np.pi, 0.0)
        self.U = np.zeros(dirichlet.size)
        self.U[self.dirichlet.free] = self.dirichlet.solve_free(load)
        density = self.dirichlet.coupling.T @ self.U[self.dirichlet.free] / self.spans
        self.raw_steps = steps = lengths * (density + np.roll(density, -1))
        self.calibration = calibration
        if calibration is not None:
            steps = calibration @ steps
        # Negative weights can make a step negative: then the smallest steps are raised, and the caller is told.
        self.floored, mean = np.zeros(len(lengths), bool), 2 * np.pi / len(lengths)
        if steps.min() <= LOST_STEP * mean:
            self.floored, steps = steps < SMALLEST_STEP * mean, np.maximum(steps, SMALLEST_STEP * mean)
        self.scale = 2 * np.pi / steps.sum()
        self.steps = self.scale * steps
        self.f = self.dirichlet.solve(np.exp(1j * np.concatenate([[0.0], np.cumsum(self.steps[:-1])])))

    def pullback(self, grad_f, solution=None):
        """Pairs (lam, x) with `dL = sum_pairs lam . dK x`, each (V, B), for gradients grad_f (V, B) with respect to f.

        solution: `K_ii^-1 grad_f` at the free vertices, if it is known.
        """
        free, loop, f = self.dirichlet.free, self.loop, self.f
        adjoint = np.zeros(grad_f.shape, complex)
        adjoint[free] = -(self.dirichlet.solve_free(grad_f[free]) if solution is None else solution)
        del solution
        grad_boundary = grad_f[loop] + self.dirichlet.coupling.T @ adjoint[free]
        grad_theta = (grad_boundary * f[loop, None].conj()).imag
        grad_step = np.cumsum(grad_theta[::-1], axis=0)[::-1] - grad_theta  # a step moves every later angle
        grad_step = self.scale * (grad_step - (self.steps @ grad_step) / (2 * np.pi))
        grad_step[self.floored] = 0
        if self.calibration is not None:
            grad_step = self.calibration.T @ grad_step
        spread = self.lengths[:, None] * grad_step
        measure = np.zeros(grad_f.shape)
        measure[loop] = (spread + np.roll(spread, 1, axis=0)) / self.spans[:, None]
        measure[free] = -self.dirichlet.solve_free(self.dirichlet.coupling @ measure[loop])
        return [(adjoint.real, f.real), (adjoint.imag, f.imag), (measure, self.U)]


class BeltramiDiskSolver:
    """The disk self-map with coefficient mu and a free boundary, normalised f(0) = 0 and f(1) = 1, and its adjoint.

    `solve(mu)` keeps its factorisation; `pullback(grad_f)` then carries gradients from f to mu by adjoint solves.
    `floored` counts the boundary steps that had to be raised to stay positive. Results are not certified.
    f(0) is the piecewise linear value in the face that contains 0; f(1) the boundary angle, linear along the edge.
    """

    def __init__(self, z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"]):
        (self.z, self.faces), self.order = check_mesh(z, faces), None
        check_used(self.z, self.faces)
        self.areas, self.gradients = signed_areas(self.z, self.faces), hat_gradients(self.z, self.faces)
        loop = boundary_loop(faces)
        off = abs(abs(self.z[loop]) - 1)
        if off.max() > 1e-6:
            raise SurfaceError(
                f"boundary vertex {loop[off.argmax()]} is {off.max():.1e} off the unit circle; "
                "map the mesh onto the disk first (disk_conformal_map)"
            )
        angle = np.angle(self.z[loop]) % (2 * np.pi)
        first = int(np.argmax(np.where(angle > np.pi, angle, -1)))  # the edge loop[0], loop[1] now holds 1 inside
        self.loop = np.roll(loop, -(first + 1) if angle.min() == 0 else -first)
        before, after = np.angle(self.z[self.loop[:2]])
        self.share = -before / (after - before)  # 1 lies at this share of the edge
        following = np.roll(self.z[self.loop], -1)
        self.lengths = abs(following - self.z[self.loop])
        steps = np.angle(following / self.z[self.loop])
        if steps.min() <= 0:  # a chord spans half of the circle or more
            raise SurfaceError(
                f"the mesh does not cover 0: boundary vertex {self.loop[steps.argmin()]} and the next "
                "are half a turn apart or more; refine the boundary, or centre the mesh by `mobius`"
            )
        face, weights = locate(self.z, self.faces, [0j])
        self.origin, self.weights = self.faces[face[0]], weights[0]
        self.pole = self._choose_pole()

    @cached_property
    def calibration(self) -> Float[sparse.csr_array, " B B"] | None:
        """Sparse (B, B): scales the angle steps so that mu = 0 gives back the mesh itself; None where they do anyway.

        An ear (a triangle with three boundary vertices) carries no flux and a sliver a wrong one; the error is much
        the same for every mu, so that its ratio at mu = 0 takes most of it out.
        """
        raw = FreeBoundary(self._problem(np.zeros(len(self.faces), complex)), self.lengths, self.pole).raw_steps
        moved = mobius(self.z[self.loop], self.z[self.pole])
        exact = np.angle(np.roll(moved, -1) / moved)
        if np.allclose(raw, exact, rtol=0.01, atol=0):
            return None
        valid = np.flatnonzero((raw > 0.2 * exact) & (raw < 5 * exact))
        # Where the discrete flux is no measure of the step, the ratio of the neighbouring steps is taken.
        middle = np.concatenate([[0.0], np.cumsum(self.lengths)])[:-1] + self.lengths / 2
        ring = self.lengths.sum()
        knots = np.concatenate([middle[valid] - ring, middle[valid], middle[valid] + ring])
        after = np.searchsorted(knots, middle, side="right")
        share = (middle - knots[after - 1]) / (knots[after] - knots[after - 1])
        columns, n = np.concatenate([valid[(after - 1) % len(valid)], valid[after % len(valid)]]), len(raw)
        weights = np.concatenate([(1 - share) * exact, share * exact]) / raw[columns]
        return sparse.csr_array((weights, (np.tile(np.arange(n), 2), columns)), shape=(n, n))

    def _problem(self, mu):
        blocks = stiffness_blocks(self.gradients, self.areas, mu)
        matrix = assemble(self.faces, blocks, len(self.z))
        if self.order is None and len(self.z) > LARGE:
            self.order = elimination_order(matrix, self.z, self.loop)
        return Dirichlet(matrix, self.loop, self.order)

    def _choose_pole(self):
        interior = np.setdiff1d(np.arange(len(self.z)), self.loop)
        if not len(interior):
            raise SurfaceError("the disk mesh has no interior vertex; refine it")
        return interior[abs(self.z[interior]).argmin()]

    def solve(self, mu: Complex[ndarray, " F"]) -> Complex[ndarray, " V"]:
        """The map f (V,) with Beltrami coefficient mu (F,); BeltramiError unless |mu| < 1 everywhere."""
        self.mu, self.free_boundary = check_coefficient(mu, len(self.faces)), None  # the last factors make room
        self.free_boundary = FreeBoundary(self._problem(self.mu), self.lengths, self.pole, self.calibration)
        self.floored = int(self.free_boundary.floored.sum())
        return self.normalise(self.free_boundary.f)

    def normalise(self, raw: Complex[ndarray, " V"]) -> Complex[ndarray, " V"]:
        """The disk map (V,) that follows `raw` (V,), which keeps the circle, by the Möbius map to f(0) = 0, f(1)
        = 1."""
        self.a = 0j
        for _ in range(50):  # the vertex values move by a Möbius map, the value at 0 between them not quite
            centre = self.weights @ mobius(raw[self.origin], self.a)
            if abs(centre) < 1e-15 or abs(centre) >= 1:  # out of the disk: folded, and the boundary must not turn over
                break
            self.a = mobius_inverse(centre, self.a)
        w = mobius(raw, self.a)
        edge = w[self.loop[:2]]
        self.turn = np.angle(edge[0]) + self.share * np.angle(edge[1] / edge[0])
        self.f = w * np.exp(-1j * self.turn)
        self.f[self.loop] /= abs(self.f[self.loop])
        return self.f.copy()  # the pullback refers to self.f

    def pullback(self, grad_f: Complex[ndarray, " *B V"]) -> Complex[ndarray, " *B F"]:
        """Gradient with respect to mu, (F,) or (B, F), from gradients with respect to the last f, (V,) or (B, V).

        Both gradients are `dL/dRe + i dL/dIm` of a real L. Two rounds of solves with the kept factorisation.
        """
        grad_f = np.asarray(grad_f, complex)
        grad_raw, origin, grad_centre = self._unnormalise(np.atleast_2d(grad_f).T, np.arange(len(self.z)))
        grad_raw += origin[:, None] * grad_centre
        grad_mu = np.zeros((len(self.faces), grad_raw.shape[1]), complex)
        for lam, x in self.free_boundary.pullback(grad_raw):
            some = lam.any(0)  # gradients of Re f(p) alone have no part in Im f, and the other way round
            grad_mu[:, some] += self.sensitivity(x) @ lam[:, some]
        return grad_mu.T.reshape(*grad_f.shape[:-1], len(self.faces))

    def adjoints(self, grad_f: Complex[sparse.csr_array, " B V"]) -> list[Float[ndarray, " V 2*B"]]:
        """What `pullback` sums up before it comes to the faces, for B gradients and i times each: three, real.

        The gradient with respect to mu is `sum_k sensitivity(x_k) @ adjoint_k`, x_k of
        `parts`. As the system is real, the solutions for i times a gradient are i times its own, up to the origin's.
        """
        count, free = grad_f.shape[0], self.free_boundary.dirichlet.free
        at = np.unique(np.concatenate([grad_f.indices, self.origin, self.loop[:2]]))
        few = grad_f[:, at].toarray().T
        direct, origin, grad_centre = self._unnormalise(np.concatenate([few, 1j * few], axis=1), at)
        load = np.zeros((len(self.z), count + 1), complex)
        load[at] = np.column_stack([direct[:, :count], origin])
        solution = self.free_boundary.dirichlet.solve_free(load[free])
        del load
        solution = np.concatenate([solution[:, :-1], 1j * solution[:, :-1]], 1) + solution[:, -1:] * grad_centre
        grad_raw = np.zeros((len(self.z), 2 * count), complex)
        grad_raw[at] = direct + origin[:, None] * grad_centre
        return [lam for lam, _ in self.free_boundary.pullback(grad_raw, solution)]

    @property
    def parts(self) -> tuple[Float[ndarray, " V"], Float[ndarray, " V"], Float[ndarray, " V"]]:
        """The three potentials (V,) that `adjoints` belong to: Re f, Im f and U of the last solution."""
        return self.free_boundary.f.real, self.free_boundary.f.imag, self.free_boundary.U

    def _unnormalise(self, grad_f, at):
        """Gradients with respect to the raw map at the vertices `at`, sorted, as (direct, origin, grad_centre).

        In all `direct + origin grad_centre`, where inside the disk `direct` is complex linear in grad_f.
        """
        raw, f = self.free_boundary.f[at], self.f[at]
        edge, inner = np.searchsorted(at, self.loop[:2]), np.searchsorted(at, self.origin)
        rotation = np.exp(1j * self.turn)
        grad_w = grad_f * rotation
        w = f * rotation
        grad_turn = (grad_f.conj() * f[:, None]).imag.sum(0)
        grad_w[edge] += np.array([1 - self.share, self.share])[:, None] * 1j * w[edge, None] * grad_turn
        # w = (raw - a) s with s = 1 / (1 - conj(a) raw), and a solves: weighted mean of w at the origin's face = 0.
        s = 1 / (1 - np.conj(self.a) * raw)
        slope, by_conj_a = (1 - abs(self.a) ** 2) * s**2, w * raw * s
        grad_a = (-s.conj()[:, None] * grad_w + by_conj_a[:, None] * grad_w.conj()).sum(0)
        P = -(self.weights * s[inner]).sum()
        Q = (self.weights * by_conj_a[inner]).sum()
        grad_centre = -(grad_a * P - grad_a.conj() * Q) / (abs(P) ** 2 - abs(Q) ** 2)
        origin = np.zeros(len(at), complex)
        origin[inner] = self.weights * slope[inner].conj()
        return grad_w * slope.conj()[:, None], origin, grad_centre

    def sensitivity(self, x: Float[ndarray, " V"]) -> Complex[sparse.sparray, " F V"]:
        """Sparse (F, V): applied to lam, the gradient with respect to mu of `lam . K(mu) x`.

        Per face the derivative of `|T| grad lam . A(mu) grad x`.
        """
        mu, scale = self.mu, 1 / (1 - abs(self.mu) ** 2)
        q = np.einsum("fk,fk->f", self.gradients, x[self.faces])
        r = q + scale * ((2 - 1 / scale) * q - 2 * mu * q.conj())
        # With p = grad lam it is 2 |T| scale (mu Re(conj(p) r) - p q), linear in lam: one sparse matrix for all of
        # them.
        along, across = 0.5 * mu * r.conj() - q, 0.5 * mu * r
        rows = along[:, None] * self.gradients + across[:, None] * self.gradients.conj()
        rows *= (2 * self.areas * scale)[:, None]
        starts = np.arange(0, rows.size + 1, 3)
        return sparse.csr_array((rows.ravel(), self.faces.ravel(), starts), shape=(len(rows), len(self.z)))


def unfold(solver, f):
    """A solver's last map f (V,), after a Möbius map or not, mended by row switching: (f, vertices of switched rows).

    The mean-value rows take the triangles' lengths in the metric of mu. Not certified: a map may stay folded.
    """
    if not len(flipped_faces(solver.faces, f)):
        return f, np.zeros(0, int)
    corners = solver.z[solver.faces]
    sides = np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)
    lengths = abs(sides + solver.mu[:, None] * sides.conj())
    f, rows, _ = switch_rows(stiffness(solver.z, solver.faces, solver.mu), solver.faces, lengths, f)
    return f, rows


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
    solver = BeltramiDiskSolver(z, faces)
    f, words = solver.solve(mu), []
    if solver.floored:
        words.append(f"{solver.floored} boundary steps ran backwards or were lost, and were raised")
    if repair:
        f, rows = unfold(solver, f)
        if len(rows):
            left = len(check_embedding(solver.faces, f).flipped)
            words.append(f"{len(rows)} rows switched to mean-value weights, {left} faces stay flipped")
    if words:
        warnings.warn("; ".join(words), RepairWarning, stacklevel=2)
    return f


def elimination_order(matrix, points, loop):
    """The vertices of a mesh without its boundary loop in an order that keeps the factors of its matrix small."""
    inner = np.setdiff1d(np.arange(len(points)), loop)
    return inner[nested_dissection(matrix.tocsr()[inner][:, inner], points[inner])]
