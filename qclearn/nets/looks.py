"""Looks at the truth: an exact map on the caller's mesh, and one Gauss-Newton step with its derivative in closed form.

A look at nu solves for its map f, refits the Möbius map M after it, and proposes the step that `fit_landmarks` would
take there, but for the derivative: `plane.tangent` carries that of the identity by the map, and needs no solve. nu
lives on the rings of a polar mesh, in whose eigenvectors the prior is diagonal.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from ..plane.disk import BeltramiDiskSolver
from ..plane.diskmesh import polar_disk, sampling_matrix
from ..plane.fields import bounded
from ..plane.mobius import compose_mobius, mobius, mobius_fields, mobius_slope
from ..plane.tangent import Carrier, Tangent
from .polargrid import eigenvectors, ring_tables

POWER = 1.4  # by which the rings crowd towards the centre
MOST = 0.6  # of |change of nu| that one step may make: beyond, gamma is lowered along the dual path
LOWER, LEAST = 0.3, 1e-7  # by how much at once, and how far at most
RISE, BACK = 1.02, 0.4  # a look whose objective is that much higher is taken back to this share of its step
TURNS = 6  # Gauss-Newton steps of the Möbius map at each look
RIDGE = 1e-9  # relative, of the Möbius columns: fewer than two landmarks leave some of them free


class Spectrum:
    """Fields nu on a polar mesh of rings and spokes in all eigenvectors E of (Laplace, lumped mass), `E^* A E = pi`.

    values (spokes rings,): the eigenvalues, in the order of the coefficients: by angular mode, then radial.
    """

    def __init__(self, rings, spokes):
        self.rings, self.spokes, self.mesh = rings, spokes, polar_disk(rings, spokes, POWER)
        area, *weights = ring_tables(self.mesh, spokes)
        self.radial, values, kept = eigenvectors(area, *weights, spokes, rings * spokes)
        self.areas, self.values = np.repeat(area, spokes), np.empty(rings * spokes)
        self.values[kept] = values
        self.cell = np.sqrt(area.mean())

    def gradients(self, fields):
        """`E^* fields` (n, modes) of gradients (n, 1 + rings spokes) with respect to nu at the mesh's vertices."""
        nodal = fields[:, 1:].reshape(-1, self.rings, self.spokes)
        nodal[:, 0] += fields[:, :1] / self.spokes  # the centre is the mean of the first ring
        waves = scipy.fft.fft(nodal, norm="ortho").transpose(2, 0, 1)  # (spokes, n, rings)
        real, imaginary = waves.real @ self.radial, waves.imag @ self.radial
        return (real + 1j * imaginary).transpose(1, 0, 2).reshape(len(fields), -1)

    def coefficients(self, nu):
        """Those of a field (1 + rings spokes,) with the mean of its first ring in the centre: `E^* A nu / pi`."""
        weighted = np.concatenate([[0], self.areas * nu[1:]])
        return self.gradients(weighted[None])[0] / np.pi

    def field(self, coefficients):
        """nu at the mesh's vertices (1 + rings spokes,) of coefficients (modes,)."""
        waves = (self.radial @ coefficients.reshape(self.spokes, self.rings, 1))[..., 0]
        nu = np.fft.ifft(waves.T, norm="ortho")
        return np.concatenate([[nu[0].mean()], nu.ravel()])


class Link:
    """A disk mesh z (V,), faces (F, 3) beside the polar mesh that carries nu: what no landmark changes."""

    def __init__(self, z, faces, spectrum):
        self.spectrum, self.solver = spectrum, BeltramiDiskSolver(z, faces)
        _ = self.solver.calibration  # cached
        self.carrier = Carrier(self.solver, spectrum.mesh)
        self.to_faces = sampling_matrix(*spectrum.mesh, self.solver.z[self.solver.faces].mean(1))


@dataclass(frozen=True, eq=False)
class Look:
    """What one look has seen: x whitened coefficients, f (V,) the solver's map, mobius what follows it, and the scaled
    residual r (2 M,); objective: `L_CP / alpha` of nu on its mesh."""

    x: np.ndarray
    f: np.ndarray
    mobius: tuple
    r: np.ndarray

    @property
    def objective(self):
        return self.x @ self.x + self.r @ self.r


@dataclass(frozen=True, eq=False)
class Proposal:
    """A nu (N,) at the vertices of the polar mesh, not looked at yet: x its coefficients, and whether the step towards
    it was cut."""

    nu: np.ndarray
    x: np.ndarray
    cut: bool = False


class Looks:
    """The looks at one landmark problem: moving p and target q (M,), weights beta / alpha and gamma / alpha.

    Whitened coefficients x: those of nu times sqrt(1 + beta Laplace), real and imaginary parts by turns, so that the
    objective is `|x|^2 + |r|^2`.
    """

    def __init__(self, link, p, q, beta, gamma):
        self.link, self.target, self.scale = link, q, np.sqrt(gamma / len(p))
        self.root = np.sqrt(1 + beta * link.spectrum.values)
        self.samples, _ = link.carrier.values_at(p)
        self.tangent = Tangent(link.solver, link.spectrum.mesh, self.samples, link.carrier)

    def proposal(self, nu):
        """A nu (N,) from elsewhere as a `Proposal`."""
        return Proposal(nu, (self.root * self.link.spectrum.coefficients(nu)).view(float))

    def field(self, x):
        return self.link.spectrum.field(x.view(complex) / self.root)

    def run(self, start, count):
        """The proposals from `start`, a `Proposal`, on: itself, and one after each of `count` looks; and the looks.

        A look that raises the objective is not stepped on from: the next proposal lies between the last good one and it.
        """
        best, proposal, share = self.at_zero(), start, 1.0
        yield proposal, best
        for _ in range(count):
            look = self.look(proposal, best.mobius)
            if look.objective < RISE * best.objective:
                best, share = look, 1.0
                wanted = proposal = self.step(look, proposal.nu)
            else:
                wanted, share = proposal if share == 1 else wanted, share * BACK
                x = best.x + share * (wanted.x - best.x)
                proposal = Proposal(self.field(x), x, True)
            yield proposal, best

    def at_zero(self):
        """The look at nu = 0, whose map is the mesh itself."""
        return self.seen(np.zeros(2 * len(self.root)), self.link.solver.z.copy(), None)

    def look(self, proposal, parameters):
        """The map of a proposal, solved for, and what it leaves of the landmarks."""
        f = self.link.solver.solve(bounded(self.link.to_faces @ proposal.nu))
        return self.seen(proposal.x, f, parameters)

    def seen(self, x, f, parameters):
        parameters = refit(self.samples @ f, self.target, parameters)
        return Look(x, f, parameters, self.components(self.samples @ mobius(f, *parameters) - self.target))

    def components(self, change):
        return self.scale * np.concatenate([change.real, change.imag])

    def step(self, look, nu):
        """The Gauss-Newton step from a look: gamma is lowered while nu would change by more than MOST somewhere."""
        rows, off = self.rows(look, nu)
        gap, S = off(look.r - rows @ look.x), off(off(rows @ rows.T).T)
        share = 1.0
        while True:
            y = scipy.linalg.solve(S + np.eye(len(S)) / share, gap, assume_a="pos")
            x = -(off(y) @ rows)
            proposed = self.field(x)
            if abs(proposed - nu).max() <= MOST or share < LEAST:
                return Proposal(proposed, x, share < 1)
            share *= LOWER

    def rows(self, look, nu):
        """The derivative of r with respect to x (2 M, n), and the projection of residuals off what a Möbius map does."""
        real, imaginary = self.tangent.gradients(nu, look.f)
        slope = (self.samples @ mobius_slope(look.f, *look.mobius))[:, None]
        turned = slope.real * real - slope.imag * imaginary, slope.imag * real + slope.real * imaginary
        rows = self.link.spectrum.gradients(np.concatenate(turned)) * (self.scale / self.root)
        fields = mobius_fields(self.samples @ mobius(look.f, *look.mobius))
        columns, _ = np.linalg.qr(self.components(fields))
        return rows.view(float), lambda r: r - columns @ (columns.T @ r)


def refit(f, q, parameters=None):
    """Parameters (a, theta) of the disk Möbius map that brings f (M,) nearest to q, by steps from `parameters`."""
    parameters = parameters or (0j, float(np.angle((q * f.conj()).sum())))
    for _ in range(TURNS):
        w = mobius(f, *parameters)
        columns, left = ((np.concatenate([part.real, part.imag])) for part in (mobius_fields(w), q - w))
        normal = columns.T @ columns
        normal += RIDGE * (np.trace(normal) + RIDGE) * np.eye(3)
        turn, real, imaginary = np.linalg.solve(normal, columns.T @ left)
        a = complex(real, imaginary)
        parameters = compose_mobius(parameters, (a / max(1.0, 2 * abs(a)), turn))  # no further than 1/2 at once
    return parameters
