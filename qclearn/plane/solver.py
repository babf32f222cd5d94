"""Maps of a triangulated disk onto the unit disk with a free boundary: the exact solver.

The boundary slides along the circle while 0 and 1 are held, and yet the map with a given Beltrami
coefficient solves linear problems: the boundary moves by the harmonic measure of A(mu) seen from 0
(the flux form).

`CoefficientMesh` is a solver whose coefficient is a field on a polar mesh.
"""

from copy import copy
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Complex, Float
from numpy import ndarray
from scipy import sparse

from .checks import SurfaceError, check_coefficient, check_used
from .coefficients import bounded, bounded_pullback, diffuse
from .disk import Disk, PerFace, PerVertex
from .linear import Dirichlet, three_a_row
from .mobius import mobius, mobius_inverse, mobius_slope

# Of the mean boundary step. A negative weight can make a step negative: it becomes SMALLEST_STEP.
# At the end of a long peninsula, steps below LOST_STEP are lost, as coordinates round triangles
# away.
SMALLEST_STEP, LOST_STEP = 1e-3, 1e-8
# Points whose adjoint equations are solved together, which bounds the memory.
POINTS_AT_ONCE = 16


class FreeBoundary:
    """The flux form for one stiffness matrix K of A(mu), before normalisation: the map `f` sends
    the pole near 0.

    Away from the pole `log f = U + i V` has the coefficient mu, too, and |f| = 1 is U = 0. So U
    solves `div(A(mu) grad U) = 2 pi delta`, U = 0 on the circle: -U / (2 pi) is the Green's
    function of A(mu) with its pole at 0 (here at the vertex nearest to 0). Its flux through the
    boundary, `A(mu) grad U . n`, is 2 pi times the density of the harmonic measure seen from the
    pole. It equals dV/ds, s the arc length: the map turns the measure into angle. The Linear
    Beltrami Solver alone has to be given boundary values, and with those of another map its result
    has another coefficient than mu. Steps 1 and 2 find the values, step 3 is that solver:

    1. `K_ii U_i = -2 pi e_o`, U = 0 on the boundary;
    2. the fluxes `F = (K U)_b` sum to 2 pi, and their densities `q_k = F_k / (l_{k-1/2} +
       l_{k+1/2})` give the angle over each boundary edge, `l_{k+1/2} (q_k + q_{k+1})`;
    3. `K_ii f_i = -K_ib f_b` with `f_b = exp(i theta_b)` and the same factorisation.
    """

    def __init__(self, dirichlet, lengths, pole, calibration=None):
        self.dirichlet = dirichlet
        self.loop, free = dirichlet.pinned, dirichlet.free
        self.lengths = lengths
        self.spans = lengths + np.roll(lengths, 1)
        self.calibration = calibration
        # 1. The potential U, whose pole is near 0.
        self.U = np.zeros(dirichlet.size)
        self.U[free] = dirichlet.solve_free(np.where(free == pole, -2 * np.pi, 0.0))
        # 2. Its flux through the boundary gives the boundary's steps in angle.
        density = dirichlet.coupling_T @ self.U[free] / self.spans
        self.raw_steps = steps = lengths * (density + np.roll(density, -1))
        if calibration is not None:
            steps = calibration @ steps
        mean = 2 * np.pi / len(lengths)
        self.floored = (steps < SMALLEST_STEP * mean) & (steps.min() <= LOST_STEP * mean)
        steps = np.where(self.floored, SMALLEST_STEP * mean, steps)
        self.scale = 2 * np.pi / steps.sum()
        self.steps = self.scale * steps
        # 3. The map inside, from the boundary's angles.
        self.f = dirichlet.solve(np.exp(1j * np.concatenate([[0.0], np.cumsum(self.steps[:-1])])))

    def pullback(self, grad_f, solution=None):
        """Three lam (V, B) with `dL = sum lam . dK x`, x = Re f, Im f, U; solution: `K_ii^-1
        grad_f`, if known."""
        free, loop, f = self.dirichlet.free, self.loop, self.f
        adjoint = np.zeros(grad_f.shape, complex)
        adjoint[free] = -(self.dirichlet.solve_free(grad_f[free]) if solution is None else solution)
        grad_boundary = grad_f[loop] + self.dirichlet.coupling_T @ adjoint[free]
        grad_theta = (grad_boundary * f[loop, None].conj()).imag
        # A step moves every later angle.
        grad_step = np.cumsum(grad_theta[::-1], axis=0)[::-1] - grad_theta
        grad_step = self.scale * (grad_step - (self.steps @ grad_step) / (2 * np.pi))
        grad_step[self.floored] = 0
        if self.calibration is not None:
            grad_step = self.calibration.T @ grad_step
        spread = self.lengths[:, None] * grad_step
        measure = np.zeros(grad_f.shape)
        measure[loop] = (spread + np.roll(spread, 1, axis=0)) / self.spans[:, None]
        measure[free] = -self.dirichlet.solve_free(self.dirichlet.coupling @ measure[loop])
        return [adjoint.real, adjoint.imag, measure]

    def pushforward(self, changes):
        """The change of f (V, B) with changes `dK x` (V, B), x = Re f, Im f, U."""
        free, loop, dirichlet = self.dirichlet.free, self.loop, self.dirichlet
        real, imaginary, load = changes
        flux = load[loop] - dirichlet.coupling_T @ dirichlet.solve_free(load[free])
        density = flux / self.spans[:, None]
        steps = self.lengths[:, None] * (density + np.roll(density, -1, axis=0))
        if self.calibration is not None:
            steps = self.calibration @ steps
        steps[self.floored] = 0
        steps = self.scale * steps
        steps -= self.steps[:, None] * steps.sum(0) / (2 * np.pi)
        angle = np.cumsum(steps, axis=0) - steps  # a step moves every later angle
        change = np.empty((self.dirichlet.size, angle.shape[1]), complex)
        change[loop] = 1j * self.f[loop, None] * angle
        pull = real[free] + 1j * imaginary[free] + dirichlet.coupling @ change[loop]
        change[free] = -dirichlet.solve_free(pull)
        return change


class DiskSolver:
    """The self-map of a `Disk` with coefficient mu and a free boundary, f(0) = 0 and f(1) = 1, and
    its adjoint.

    `solve(mu)` keeps its factorisation for `pullback(grad_f)` and `pushforward(dmu)`. `floored`
    counts the boundary steps that were raised to stay positive. Not certified. f(0) is the value in
    the face that holds 0; f(1) the angle, linear along the boundary edge.
    """

    def __init__(self, disk: Disk):
        self.disk = disk
        check_used(disk)
        _ = disk.gradients  # which refuses folded triangles
        z, loop = disk.z, disk.loop
        off = abs(abs(z[loop]) - 1)
        if off.max() > 1e-6:
            raise SurfaceError(
                f"boundary vertex {loop[off.argmax()]} is {off.max():.1e} off the unit circle; map "
                "the mesh onto the disk first (disk_conformal_map)"
            )
        angle = np.angle(z[loop]) % (2 * np.pi)
        # The edge loop[0], loop[1] holds 1; `share` is the part of it before 1.
        first = int(np.argmax(np.where(angle > np.pi, angle, -1)))
        self.loop = np.roll(loop, -(first + 1) if angle.min() == 0 else -first)
        before, after = np.angle(z[self.loop[:2]])
        self.share = -before / (after - before)
        following = np.roll(z[self.loop], -1)
        self.lengths = abs(following - z[self.loop])
        steps = np.angle(following / z[self.loop])
        if steps.min() <= 0:  # a chord spans half of the circle or more
            raise SurfaceError(
                f"the mesh does not cover 0: boundary vertex {self.loop[steps.argmin()]} and the "
                "next are half a turn apart or more; refine the boundary, or centre the mesh by "
                "`mobius`"
            )
        face, weights = disk.locate([0j])
        self.origin = disk.faces[face[0]]
        self.weights = weights[0]
        interior = np.setdiff1d(np.arange(len(z)), loop)
        if not len(interior):
            raise SurfaceError("the disk mesh has no interior vertex; refine it")
        self.pole = interior[abs(z[interior]).argmin()]
        self.order = self.pattern = None  # those of the first factorisation serve all others

    @cached_property
    def calibration(self) -> Float[sparse.csr_array, " B B"] | None:
        """Sparse (B, B): scales the angle steps so that mu = 0 gives back the mesh itself; None
        where they do anyway.

        An ear (a triangle with three boundary vertices) carries no flux and a sliver a wrong one.
        The error is much the same for every mu: its ratio at mu = 0 takes most of it out.
        """
        problem = self._problem(np.zeros(len(self.disk.faces), complex))
        raw = FreeBoundary(problem, self.lengths, self.pole).raw_steps
        rim = mobius(self.disk.z[self.loop], self.disk.z[self.pole])
        exact = np.angle(np.roll(rim, -1) / rim)
        if np.allclose(raw, exact, rtol=0.01, atol=0):
            return None
        valid = np.flatnonzero((raw > 0.2 * exact) & (raw < 5 * exact))
        # Where the discrete flux is no measure of the step, the ratio of the neighbouring steps is
        # taken.
        middle = np.concatenate([[0.0], np.cumsum(self.lengths)])[:-1] + self.lengths / 2
        ring = self.lengths.sum()
        knots = np.concatenate([middle[valid] - ring, middle[valid], middle[valid] + ring])
        after = np.searchsorted(knots, middle, side="right")
        share = (middle - knots[after - 1]) / (knots[after] - knots[after - 1])
        columns = np.concatenate([valid[(after - 1) % len(valid)], valid[after % len(valid)]])
        weights = np.concatenate([(1 - share) * exact, share * exact]) / raw[columns]
        rows = np.tile(np.arange(len(raw)), 2)
        return sparse.csr_array((weights, (rows, columns)), shape=(len(raw), len(raw)))

    def _problem(self, mu):
        problem = Dirichlet(self.disk.stiffness(mu), self.loop, self.order, self.pattern)
        if self.order is None and self.pattern is None:
            self.pattern = getattr(problem.factors, "pattern", None)
            if self.pattern is None:  # SuperLU keeps nothing but the order
                self.order = problem.free[np.argsort(problem.factors.perm_c)]
        return problem

    def solve(self, mu: PerFace) -> PerVertex:
        """The map f (V,) with Beltrami coefficient mu (F,); BeltramiError unless |mu| < 1
        everywhere."""
        self.mu = check_coefficient(mu, len(self.disk.faces))
        self.free_boundary = None  # the last factors make room
        vars(self).pop("sensitivities", None)
        # The calibration is a mesh's first problem, so that the order is the same for every mu.
        calibration = self.calibration
        problem = self._problem(self.mu)
        self.free_boundary = FreeBoundary(problem, self.lengths, self.pole, calibration)
        self.floored = int(self.free_boundary.floored.sum())
        return self.normalise(self.free_boundary.f)

    def normalise(self, raw: PerVertex) -> PerVertex:
        """The map `raw` (V,), which keeps the circle, moved by a Möbius map to f(0) = 0 and f(1) =
        1."""
        self.a = 0j
        # In rounds: the values of the vertices move by a Möbius map, the value at 0 between them
        # not quite. Where it leaves the disk the map is folded, and the boundary must not turn
        # over.
        for _ in range(50):
            centre = self.weights @ mobius(raw[self.origin], self.a)
            if abs(centre) < 1e-15 or abs(centre) >= 1:
                break
            self.a = mobius_inverse(centre, self.a)
        w = mobius(raw, self.a)
        edge = w[self.loop[:2]]
        self.turn = np.angle(edge[0]) + self.share * np.angle(edge[1] / edge[0])
        self.f = w * np.exp(-1j * self.turn)
        self.f[self.loop] /= abs(self.f[self.loop])
        return self.f.copy()  # the pullback refers to self.f

    def pullback(self, grad_f: Complex[ndarray, " *B V"]) -> Complex[ndarray, " *B F"]:
        """Gradients `dL/dRe + i dL/dIm` by mu, (F,) or (B, F), from those by the last f, (V,) or
        (B, V): two solves."""
        grad_f = np.asarray(grad_f, complex)
        everywhere = np.arange(len(self.disk.z))
        grad_raw, origin, grad_centre = self._unnormalise(np.atleast_2d(grad_f).T, everywhere)
        grad_raw += origin[:, None] * grad_centre
        grad_mu = np.zeros((len(self.disk.faces), grad_raw.shape[1]), complex)
        for matrix, lam in zip(self.sensitivities, self.free_boundary.pullback(grad_raw)):
            some = lam.any(0)  # a gradient of Re f alone has no part in Im f, and vice versa
            grad_mu[:, some] += matrix @ lam[:, some]
        return grad_mu.T.reshape(*grad_f.shape[:-1], len(self.disk.faces))

    def adjoints(self, grad_f: Complex[sparse.csr_array, " B V"]) -> list[Float[ndarray, " V 2*B"]]:
        """Three adjoints of B gradients and i times each: by mu these are `sum_k sensitivities[k] @
        adjoint_k`.

        The system is real: solutions for i times a gradient are i times its own, up to the
        origin's.
        """
        count = grad_f.shape[0]
        free = self.free_boundary.dirichlet.free
        at = np.unique(np.concatenate([grad_f.indices, self.origin, self.loop[:2]]))
        few = grad_f[:, at].toarray().T
        direct, origin, grad_centre = self._unnormalise(np.concatenate([few, 1j * few], axis=1), at)
        load = np.zeros((len(self.disk.z), count + 1), complex)
        load[at] = np.column_stack([direct[:, :count], origin])
        solution = self.free_boundary.dirichlet.solve_free(load[free])
        both = np.concatenate([solution[:, :-1], 1j * solution[:, :-1]], 1)
        solution = both + solution[:, -1:] * grad_centre
        grad_raw = np.zeros((len(self.disk.z), 2 * count), complex)
        grad_raw[at] = direct + origin[:, None] * grad_centre
        return self.free_boundary.pullback(grad_raw, solution)

    @cached_property
    def sensitivities(self) -> list[Complex[sparse.sparray, " F V"]]:
        """Three sparse (F, V), of x = Re f, Im f and U: applied to lam, the gradient of `lam .
        K(mu) x` by mu. Made once a solution."""
        disk, mu, found = self.disk, self.mu, []
        scale = 1 / (1 - abs(mu) ** 2)
        f, U = self.free_boundary.f, self.free_boundary.U
        for x in (f.real, f.imag, U):
            q = np.einsum("fk,fk->f", disk.gradients, x[disk.faces])
            r = q + diffuse(mu, q)
            # On a face, with p = grad lam: 2 |T| scale (mu Re(conj(p) r) - p q), linear in lam.
            along = 0.5 * mu * r.conj() - q
            across = 0.5 * mu * r
            rows = along[:, None] * disk.gradients + across[:, None] * disk.gradients.conj()
            rows *= (2 * disk.areas * scale)[:, None]
            found.append(three_a_row(rows, disk.faces, len(disk.z)))
        return found

    def pushforward(self, dmu: Complex[ndarray, " *B F"]) -> Complex[ndarray, " *B V"]:
        """Change of the last f, (V,) or (B, V), with a change of mu, (F,) or (B, F): three real
        solves.

        The transpose of `pullback`: `Re sum conj(grad_f) pushforward(dmu) = Re sum
        conj(pullback(grad_f)) dmu`.
        """
        dmu = np.asarray(dmu, complex)
        changes = [(matrix.T @ np.atleast_2d(dmu).conj().T).real for matrix in self.sensitivities]
        df = self._renormalise(self.free_boundary.pushforward(changes))
        return df.T.reshape(*dmu.shape[:-1], len(self.disk.z))

    def _unnormalise(self, grad_f, at):
        """Gradients by the raw map at sorted vertices `at`, `direct + origin grad_centre`: these
        three.

        Inside the disk `direct` is complex linear in grad_f.
        """
        edge = np.searchsorted(at, self.loop[:2])
        inner = np.searchsorted(at, self.origin)
        w, by_a, slope, by_conj_a = self._derivatives(at)
        grad_w = grad_f * np.exp(1j * self.turn)
        grad_turn = (grad_f.conj() * self.f[at, None]).imag.sum(0)
        shares = np.array([1 - self.share, self.share])
        grad_w[edge] += 1j * (shares * w[edge])[:, None] * grad_turn
        grad_a = (by_a.conj()[:, None] * grad_w + by_conj_a[:, None] * grad_w.conj()).sum(0)
        P, Q = self.weights @ by_a[inner], self.weights @ by_conj_a[inner]
        grad_centre = -(grad_a * P - grad_a.conj() * Q) / (abs(P) ** 2 - abs(Q) ** 2)
        origin = np.zeros(len(at), complex)
        origin[inner] = self.weights * slope[inner].conj()
        return grad_w * slope.conj()[:, None], origin, grad_centre

    def _renormalise(self, change):
        """The change of f with a change (V, B) of the raw map, the transpose of `_unnormalise`."""
        w, by_a, slope, by_conj_a = (part[:, None] for part in self._derivatives(slice(None)))
        dw = slope * change
        at = self.origin
        edge = self.loop[:2]
        P, Q, centre = (self.weights @ part[at] for part in (by_a, by_conj_a, dw))
        # This change of a holds the value at 0.
        da = (Q * centre.conj() - P.conj() * centre) / (abs(P) ** 2 - abs(Q) ** 2)
        dw += by_a * da + by_conj_a * da.conj()
        dturn = np.array([1 - self.share, self.share]) @ (dw[edge] / w[edge]).imag
        return (dw - 1j * w * dturn) * np.exp(-1j * self.turn)

    def _derivatives(self, at):
        """At vertices `at`: w = (raw - a) / (1 - conj(a) raw), its derivatives by a, by raw and by
        conj(a)."""
        raw = self.free_boundary.f[at]
        w = self.f[at] * np.exp(1j * self.turn)
        s = 1 / (1 - np.conj(self.a) * raw)
        return w, -s, (1 - abs(self.a) ** 2) * s**2, w * raw * s


class CoefficientMesh:
    """A polar `Disk` mesh, which carries nu (N,) at its vertices, beside the `Disk` that is mapped,
    maybe itself."""

    def __init__(self, disk, mesh):
        self.disk, self.mesh = disk, mesh
        self.solver = DiskSolver(disk)
        _ = self.solver.calibration  # cached here, so that copies of the solver have it
        # By the area of the disk: terms are means over it.
        self.mass = mesh.mass / np.pi
        self.laplace = mesh.laplace / np.pi
        self.to_faces = mesh.to_faces if disk is mesh else mesh.interpolation(disk.centroids)

    def coefficient(self, nu):
        """mu (F,) on the faces of the mapped mesh of nu (N,)."""
        return bounded(self.to_faces @ nu)

    def solution(self, nu):
        """A copy of the solver, with the map of nu (N,) and its factors."""
        solution = copy(self.solver)
        solution.solve(self.coefficient(nu))
        return solution

    def gradients(self, nu, solution, samples, parameters):
        """Gradients of Re w and Im w by nu (N,), complex (2, P, N), of points `w = samples @ M(f)`,
        f a `solution` of nu and M the disk Möbius map of these parameters, by adjoint solves."""
        slope = mobius_slope(solution.f, *parameters)
        points = (samples @ sparse.diags_array(slope.conj())).tocsr()
        # From an adjoint of a potential to the gradient by nu, real parts above imaginary ones:
        # sparse (2 N, V), without a dense array.
        to_nodes, at_faces, chains = self.to_faces.T.tocsr(), self.to_faces @ nu, []
        for sensitivity in solution.sensitivities:
            by_mu = sensitivity.tocoo()
            data = bounded_pullback(at_faces[by_mu.row], by_mu.data)
            chain = to_nodes @ sparse.csr_array((data, by_mu.coords), shape=by_mu.shape)
            chains.append(sparse.vstack([chain.real, chain.imag]).tocsr())
        size = len(nu)
        parts = [np.zeros((2, 0, size), complex)]
        for first in range(0, points.shape[0], POINTS_AT_ONCE):
            adjoints = solution.adjoints(points[first : first + POINTS_AT_ONCE])
            by_nu = sum(chain @ adjoint for chain, adjoint in zip(chains, adjoints))
            parts.append((by_nu[:size] + 1j * by_nu[size:]).T.reshape(2, -1, size))
        return np.concatenate(parts, axis=1)


@lru_cache(maxsize=8)
def on_itself(mesh):
    """The `CoefficientMesh` of a polar `Disk` that carries nu and is mapped itself, made once."""
    return CoefficientMesh(mesh, mesh)
