"""The flux form: a boundary that slides along the circle as the harmonic measure tells, forwards and backwards."""

import numpy as np

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
        """Three lam (V, B) with `dL = sum lam . dK x`, x = Re f, Im f, U, for gradients grad_f (V, B) by f.

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
        return [adjoint.real, adjoint.imag, measure]

    def pushforward(self, changes):
        """The change of f, (V, B), with a change of K, given as `dK x` (V, B) for x = Re f, Im f, U."""
        free, loop, coupling = self.dirichlet.free, self.loop, self.dirichlet.coupling
        real, imaginary, load = changes
        flux = load[loop] - coupling.T @ self.dirichlet.solve_free(load[free])
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
        pull = real[free] + 1j * imaginary[free] + coupling @ change[loop]
        change[free] = -self.dirichlet.solve_free(pull)
        return change
