"""The explorable of the free boundary, what Python knows of it; the browser's side is `boundary.js`."""

from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from ..plane.beltrami import stiffness
from ..plane.disk import solve_beltrami_disk
from ..plane.diskmesh import polar_disk, sampling_matrix
from ..plane.mobius import mobius
from .live import Live, as_pairs
from .plot import disk_axes, grid_plot

STEPS, MEMORY = 100, 10
RHO, LEAST = 1e-8, 1e-12  # the paper's weight of L_Boundary, and the least angle


class Boundary(Live):
    """Harmonic measure seen from a pole, and descents of two losses, of the chapter on the free boundary."""

    page = "boundary"
    initial = MappingProxyType({"strength": 0.5, "pole": (0.5, 0.6), "loss": "printed", "step": 0, "centred": False})
    mesh = polar_disk(24, 73)  # an odd number of spokes: no boundary point lies opposite to 1
    rim = np.arange(1 + 23 * 73, 1 + 24 * 73)

    def coefficient(self, state):
        """mu (F,) of the sliding map z exp(i s Im(z) |z|)."""
        z, faces = self.mesh
        c = z[faces].mean(1)
        h_z = state["strength"] / 2 * (-1j * abs(c) + c.imag * c.conj() / abs(c))
        return 1j * c * h_z.conj() / (1 + 1j * c * h_z)

    def seen_from(self, f, pole):
        """The map that sends the pole to 0 and 1 to 1, after f."""
        value = sampling_matrix(*self.mesh, np.array([complex(*pole)])) @ f
        f = mobius(f, value[0])
        return f / f[self.rim[0]]

    def descent(self, state):
        """(boundary points of each step (S, N), E (V, N) that extends them inside) of the descent asked for."""
        z, faces = self.mesh
        mu, inside = self.coefficient(state), np.setdiff1d(np.arange(len(z)), self.rim)
        right = self.seen_from(solve_beltrami_disk(z, faces, mu), state["pole"])
        K, extend = stiffness(z, faces, mu).toarray(), np.zeros((len(z), len(self.rim)))
        extend[self.rim] = np.eye(len(self.rim))
        extend[inside] = -np.linalg.solve(K[np.ix_(inside, inside)], K[np.ix_(inside, self.rim)])
        system = K[self.rim] @ extend, len(z)
        judge = objective(system, gap if state["loss"] == "right" else printed, RHO * (state["loss"] == "penalised"))
        logits = np.log(np.angle(np.roll(right[self.rim], -1) / right[self.rim]) % (2 * np.pi))
        return [points(angles(x)) for x in descend(judge, logits, STEPS)], extend

    def map(self, state):
        """(f (V,) after the steps of the descent, how many the descent has in all)."""
        path, extend = self.descent(state)
        f = extend @ path[min(state["step"], len(path) - 1)]
        return self.seen_from(f, (0, 0)) if state["centred"] else f, len(path) - 1

    def answer(self, state):
        """The map with dense matrices, and the steps of its descent."""
        f, count = self.map(state)
        return {"map": as_pairs(f), "count": count}

    def picture(self, state):
        """A Matplotlib figure of harmonic measure seen from the pole and of the map at this step, and a description."""
        (z, faces), (f, _), pole = self.mesh, self.map(state), complex(*state["pole"])
        figure = Figure(figsize=(6.4, 3.3))
        seen, image = (disk_axes(ax) for ax in figure.subplots(1, 2))
        steps = np.angle(np.roll(f[self.rim], -1) / f[self.rim]) % (2 * np.pi)
        middle = z[self.rim] * np.exp(1j * np.pi / len(steps))
        band = middle * np.maximum(0.02, 1 - 0.2 * steps / steps.mean())
        seen.fill(middle.real, middle.imag, color="#E69F00")
        seen.fill(band.real, band.imag, color="white")
        seen.plot(pole.real, pole.imag, "o", color="#B22222")
        grid_plot(image, z, faces, f)
        image.plot(f[self.rim].real, f[self.rim].imag, ".", color="#E69F00")
        for ax, title in ((seen, "harmonic measure seen from the pole"), (image, "boundary points of the map")):
            ax.set_title(title, fontsize=10)
        return figure, "A band along the circle, wide where a red pole is near, and a grid whose boundary points crowd."


def angles(logits):
    """Positive angles with sum 2 pi."""
    theta = np.exp(logits - logits.max())
    return np.maximum(2 * np.pi * theta / theta.sum(), LEAST)


def points(theta):
    """Points of the circle from 1 on, the given angles apart."""
    return np.exp(1j * np.append(0, np.cumsum(theta[:-1])))


def printed(system, f):
    """Mean of |rows| over the boundary (the inner ones are zero), and its gradient."""
    S, count = system
    row = S @ f
    slope = S @ (np.sign(row.real) + 1j * np.sign(row.imag))
    return (abs(row.real) + abs(row.imag)).sum() / (2 * count), slope / (2 * count)


def gap(system, f):
    """Energy minus area, 1/2 f* S f - area, and its gradient."""
    row, area = system[0] @ f, 0.5 * (f.conj() * np.roll(f, -1)).imag.sum()
    return 0.5 * (f.conj() @ row).real - area, row + 0.5j * (np.roll(f, -1) - np.roll(f, 1))


def objective(system, loss, rho):
    """Loss plus rho sum 1/theta as a function of logits, and its gradient."""

    def judge(logits):
        theta = angles(logits)
        f = points(theta)
        value, slope = loss(system, f)
        slope = (slope * f.conj()).imag
        slope = np.cumsum(slope[::-1])[::-1] - slope - rho / theta**2  # an angle moves all later points
        return value + rho * (1 / theta).sum(), theta * (slope - theta @ slope / (2 * np.pi))

    return judge


def descend(judge, x, most):
    """L-BFGS with the first of the steps 1, 1/2, 1/4, ... that goes down enough: the path, as `descent.js` walks it."""
    path, pairs, (value, grad) = [x], [], judge(x)
    while len(path) <= most:
        way = direction(grad, pairs)
        for t in 0.5 ** np.arange(30):
            there = x + t * way
            found = judge(there)
            if found[0] < value + 1e-4 * t * (grad @ way):
                break
        else:
            break
        s, y = there - x, found[1] - grad
        if s @ y > 1e-12 * np.sqrt((s @ s) * (y @ y)):
            pairs = [*pairs, (s, y)][-MEMORY:]
        x, (value, grad) = there, found
        path.append(x)
    return path


def direction(grad, pairs):
    """Minus the inverse Hessian that the last steps have taught, times the gradient."""
    q, shares = -grad, []
    for s, y in reversed(pairs):
        shares.append((s @ q) / (s @ y))
        q = q - shares[-1] * y
    q = q * ((pairs[-1][0] @ pairs[-1][1]) / (pairs[-1][1] @ pairs[-1][1]) if pairs else 0.1 / np.linalg.norm(grad))
    for (s, y), share in zip(pairs, reversed(shares)):
        q = q + (share - (y @ q) / (s @ y)) * s
    return q
