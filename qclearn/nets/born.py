"""The landmark fit linearised at the identity: its solution as one fixed, differentiable layer (a Born step).

At mu = 0 the map's derivative with respect to nu is known once and for all on a polar mesh; a turn of the disk turns
it. In the eigenvectors of (Laplace, mass) the prior of the fit is diagonal, and the dual Gauss-Newton step of
`fit_landmarks` from nu = 0 is one 2M x 2M system a problem.
"""

import numpy as np
import torch
from torch import nn

from ..beltrami import face_mean, signed_areas, stiffness
from ..disk import BeltramiDiskSolver
from ..diskmesh import polar_disk

RIDGE = 1e-9  # relative, of the three Möbius columns: fewer than two landmarks leave some of them free


def bounded(nu):
    """The paper's activation `tanh(|nu|) nu / |nu|` for complex tensors, 1 - 1e-6 at most."""
    size = nu.abs().clamp(min=1e-6)
    return torch.tanh(size).clamp(max=1 - 1e-6) / size * nu


def mobius(w, a, theta):
    """`exp(i theta) (w - a) / (1 - conj(a) w)` for w (B, n), a and theta (B,)."""
    a = a[:, None]
    return torch.exp(1j * theta)[:, None] * (w - a) / (1 - a.conj() * w)


def mobius_columns(w):
    """Changes (B, n, 3) of points w with an increment (theta, Re a, Im a) after a Möbius map."""
    return torch.stack([1j * w, w ** 2 - 1, -1j * (1 + w ** 2)], 2)


def fit_mobius(f, q, mask, steps=4):
    """Parameters (a, theta), (B,) each, of the disk Möbius map that brings f (B, M) closest to q: Gauss-Newton steps."""
    f, q = f.detach().to(torch.complex128), q.to(torch.complex128)
    a, theta = torch.zeros_like(f[:, 0]), torch.angle((mask * q * f.conj()).sum(1))
    for _ in range(steps):
        w = mobius(f, a, theta)
        columns = torch.view_as_real(mobius_columns(w) * mask[..., None]).mT.flatten(1, 2)
        left = torch.view_as_real((q - w) * mask).flatten(1)
        turn, real, imaginary = _least_squares(columns, left[..., None])[..., 0].unbind(1)
        step = torch.complex(real, imaginary)
        step = step / (2 * step.abs()).clamp(min=1)  # no further than 1/2 at once
        at_one = mobius(mobius(torch.ones_like(f[:, :1]), a, theta), step, turn)[:, 0]
        step = torch.exp(-1j * theta) * step
        pole = (step + a) / (1 + a.conj() * step)
        a, theta = pole, torch.angle(at_one * (1 - pole.conj()) / (1 - pole))
    return a.to(torch.complex64), theta.float()


def _least_squares(columns, right):
    """`(C^T C)^-1 C^T right`, the pseudoinverse itself where right is None."""
    normal = columns.mT @ columns
    size = normal.diagonal(dim1=1, dim2=2).sum(1)[:, None, None]
    eye = torch.eye(3, dtype=normal.dtype, device=normal.device)
    return torch.linalg.solve(normal + RIDGE * (size + 1e-12) * eye, columns.mT if right is None else columns.mT @ right)


class PolarMesh(nn.Module):
    """`polar_disk(nr, nt, power)` with its points located in closed form, batched."""

    def __init__(self, nr, nt, power=1.4):
        super().__init__()
        self.nr, self.nt, self.power = nr, nt, power
        self.mesh = polar_disk(nr, nt, power)
        self.register_buffer("radius", _tensor((np.arange(nr + 1) / nr) ** power), persistent=False)

    def locate(self, points):
        """Corners (..., 3), as vertices of the mesh, and barycentric weights (..., 3) of points of the disk."""
        step = 2 * torch.pi / self.nt
        k = torch.floor(torch.remainder(points.angle(), 2 * torch.pi) / step).long().clamp(max=self.nt - 1)
        turned = points * torch.exp(-1j * step * k)
        y = turned.imag / np.sin(step)  # point = x spoke_k + y spoke_(k + 1)
        x = turned.real - y * np.cos(step)
        shrink = 1 / (x + y).clamp(min=1)  # beyond the last chord: onto it
        x, y = x * shrink, y * shrink
        j = (torch.bucketize((x + y).contiguous(), self.radius, right=True) - 1).clamp(0, self.nr - 1)
        inner, outer = self.radius[j], self.radius[j + 1]
        out = (x + y - inner) / (outer - inner)
        lower = (y <= outer * out) | (j == 0)
        first = torch.where(lower, 1 - out, x / inner.clamp(min=1e-9))
        far = torch.where(lower, y / outer, out)
        ring, spoke = torch.stack([j, j + 1, j + lower.long()], -1), torch.stack([k, k + 1, k + 1 - lower.long()], -1)
        corners = torch.where(ring > 0, 1 + (ring - 1) * self.nt + spoke % self.nt, 0)
        return corners, torch.stack([first, far, 1 - first - far], -1)

    def sample(self, values, places):
        """Values (B, V) at the mesh's vertices, interpolated linearly at places (B, P) that `locate` found."""
        corners, weights = places
        return (values.gather(1, corners.flatten(1)).view(corners.shape) * weights).sum(-1)

    def splat(self, values, places):
        """The transpose of `sample`: real values (B, C, P) shared out to the vertices, (B, C, V)."""
        corners, weights = places
        spread = (values[..., None] * weights[:, None]).flatten(2)
        out = values.new_zeros(*values.shape[:2], len(self.mesh[0]))
        return out.scatter_add_(2, corners.flatten(1)[:, None].expand_as(spread), spread)


class PolarGrid(PolarMesh):
    """Complex fields nu (B, nr, nt) on the rings of a polar mesh; the centre takes the first ring's mean.

    modes: how many eigenvectors E of (Laplace, lumped mass) are kept, the smoothest: `E^* A E = pi`.
    """

    def __init__(self, nr, nt, power=1.4, modes=512):
        super().__init__(nr, nt, power)
        z, faces = self.mesh
        area = np.bincount(faces.ravel(), np.repeat(signed_areas(z, faces), 3))[1::nt] / 3
        K, first = stiffness(z, faces, np.zeros(len(faces))), np.arange(nr) * nt + 1
        spokes, arcs = -np.asarray(K[first[:-1], first[1:]]).ravel(), -np.asarray(K[first, first + 1]).ravel()
        radial, values, kept = _eigenvectors(area, spokes, arcs, nt, modes)
        tables = {"z": z[1:].reshape(nr, nt), "area": area[:, None], "spokes": spokes[:, None], "arcs": arcs[:, None],
                  "radial": radial, "values": values, "kept": kept}
        for name, table in tables.items():
            self.register_buffer(name, _tensor(table), persistent=False)

    def terms(self, nu):
        """`mean|nu|^2` and `mean|grad nu|^2` over the disk, (B,) each."""
        size = (self.area * _square(nu)).sum((1, 2))
        slope = (self.spokes * _square(nu[:, 1:] - nu[:, :-1])).sum((1, 2))
        slope = slope + (self.arcs * _square(nu - nu.roll(-1, -1))).sum((1, 2))
        return size / torch.pi, slope / torch.pi

    def on_faces(self, nu):
        """Means over the corners of each face of the mesh, (B, F)."""
        following = nu.roll(-1, -1)
        fan = nu[:, 0].mean(-1, keepdim=True) + nu[:, 0] + following[:, 0]
        common = nu[:, :-1] + following[:, 1:]
        bands = torch.stack([common + nu[:, 1:], common + following[:, :-1]], 2)
        return torch.cat([fan, bands.flatten(1)], 1) / 3

    def with_centre(self, nu):
        """(B, nr, nt) as values at the mesh's vertices (B, V)."""
        return torch.cat([nu[:, 0].mean(-1, keepdim=True), nu.flatten(1)], 1)

    def gradients(self, fields):
        """`E^* fields` (..., modes) of fields (..., nr, nt): gradients with respect to the coefficients."""
        waves = torch.fft.fft(fields, norm="ortho").movedim(-1, -2)[..., None, :]  # (..., nt, 1, nr)
        return (waves @ self.radial.to(waves)).flatten(-3)[..., self.kept]

    def coefficients(self, nu):
        """Coefficients (B, modes) of a field, those of its projection: `E^* A nu / pi`."""
        return self.gradients(nu * self.area) / torch.pi

    def field(self, coefficients):
        """nu (B, nr, nt) of coefficients (B, modes)."""
        waves = coefficients.new_zeros(*coefficients.shape[:-1], self.nr * self.nt)
        waves = waves.index_copy(-1, self.kept, coefficients).unflatten(-1, (self.nt, 1, self.nr))
        waves = waves @ self.radial.mT.to(waves)  # (..., nt, 1, nr)
        return torch.fft.ifft(waves[..., 0, :].movedim(-1, -2), norm="ortho")


def _square(x):
    return x.real ** 2 + x.imag ** 2


def _tensor(table):
    table = np.asarray(table)
    if table.dtype.kind in "iu":
        return torch.as_tensor(table)
    return torch.as_tensor(table.astype(np.complex64 if np.iscomplexobj(table) else np.float32))


def _eigenvectors(area, spokes, arcs, nt, count):
    """Radial parts (nt, nr, nr) of all eigenvectors by angular mode; eigenvalues and places of the smoothest (count,)."""
    nr, inner = len(area), np.arange(len(area) - 1)
    radial = np.zeros((nr, nr))
    radial[inner, inner + 1] = radial[inner + 1, inner] = -spokes
    radial -= np.diag(radial.sum(1))
    angular = 2 - 2 * np.cos(2 * np.pi * np.arange(nt) / nt)
    root = 1 / np.sqrt(area)
    matrices = root[:, None] * (radial + angular[:, None, None] * np.diag(arcs)) * root
    values, vectors = np.linalg.eigh(matrices)  # (nt, nr), (nt, nr, nr)
    kept = np.argsort(values, axis=None, kind="stable")[:count]
    return np.sqrt(np.pi) * root[:, None] * vectors, values.ravel()[kept].clip(min=0), kept


class Born(nn.Module):
    """Derivatives at mu = 0 of the map at any point of the disk, and the fit's dual step with them.

    one, two (nr, modes): `df = sum conj(one) c + two conj(c)` at the first spoke's nodes for coefficients c of nu.
    response (V, 2, modes): gradients of Re f and Im f at every vertex.
    """

    def __init__(self, grid):
        super().__init__()
        self.grid, (one, two) = grid, _responses(grid)
        mode = grid.kept.numpy() // grid.nr
        turn = 2 * np.pi / grid.nt * np.arange(grid.nt)[:, None]
        # A turn of the disk by t multiplies the two by phases, and each angular mode m of nu.
        first, second = one[:, None] * np.exp(1j * turn * (1 - mode)), two[:, None] * np.exp(1j * turn * (3 - mode))
        rows = np.stack([first + second, 1j * (first - second)], 2).reshape(grid.nr * grid.nt, 2, -1)
        tables = {"one": one.conj(), "two": two, "response": np.concatenate([np.zeros((1, *rows.shape[1:])), rows]),
                  "waves": np.concatenate([mode - 1, 3 - mode]) % grid.nt}
        for name, table in tables.items():
            self.register_buffer(name, _tensor(table), persistent=False)

    def jacobian(self, places):
        """Gradients of Re f and Im f at places (B, M) with respect to the coefficients of nu: (B, M, 2, modes)."""
        corners, weights = places
        return (self.response[corners] * weights[..., None, None]).sum(-3)

    def moved(self, c):
        """Displacements (B, nr, nt) of the nodes by coefficients c (B, modes), to first order."""
        parts = torch.cat([c[:, None] * self.one, c.conj()[:, None] * self.two], 2)  # (B, nr, 2 modes)
        waves = parts.new_zeros(*parts.shape[:2], self.grid.nt).index_add(2, self.waves, parts)
        return torch.fft.ifft(waves, norm="forward")

    def prepare(self, J, slope, columns, scale, alpha, beta):
        """The linearised fit of landmarks (B, M) with `jacobian` J whose map is followed by one of this slope (B, M).

        Returns `step(residual) -> (coefficients, promised)` for complex scaled residuals (B, M).
        """
        factor = (slope * scale)[..., None]
        J = torch.stack([factor.real * J[:, :, 0] - factor.imag * J[:, :, 1],
                         factor.imag * J[:, :, 0] + factor.real * J[:, :, 1]], 2).flatten(1, 2)
        D = alpha[:, None] + beta[:, None] * self.grid.values
        rows = torch.view_as_real(J * D.rsqrt()[:, None]).flatten(2)
        columns = torch.view_as_real(columns * scale[..., None]).transpose(2, 3).flatten(1, 2).double()
        inverse = _least_squares(columns, None)

        def project(x):  # off what a Möbius map does
            return x - columns @ (inverse @ x)

        S = project(project((rows @ rows.mT).double()).mT)
        S.diagonal(dim1=1, dim2=2).add_(1)
        factors = torch.linalg.cholesky(S)

        def step(residual):
            r = project(torch.view_as_real(residual).flatten(1).double()[..., None])
            y = torch.cholesky_solve(r, factors)
            promised = (r * y).sum((1, 2))
            y = project(y).to(J)
            return -(y.mT @ J)[:, 0] / D, promised.float()

        return step


def _responses(grid):
    """`one`, `two` (nr, modes) of `Born`, in the gauge f(0) = 0 without a mean turn of the circle."""
    (z, faces), nr, nt = grid.mesh, grid.nr, grid.nt
    solver = BeltramiDiskSolver(z, faces)
    solver.solve(np.zeros(len(faces), complex))
    rings, rim = 1 + nt * np.arange(nr), np.arange(len(z) - nt, len(z))
    real = np.zeros((nr, len(z)), complex)
    real[np.arange(nr), rings] = 1
    imaginary = 1j * real
    imaginary[:, rim] -= z[rings, None] * 1j * z[rim] / nt
    grad_mu = solver.pullback(np.concatenate([real, imaginary]))
    grad_nu = grad_mu @ face_mean(faces, len(z))
    nodal = grad_nu[:, 1:]
    nodal[:, :nt] += grad_nu[:, :1] / nt  # the centre is the mean of the first ring
    fields = torch.from_numpy(nodal.reshape(2 * nr, nr, nt)).to(torch.complex64)
    re, im = grid.gradients(fields).numpy().reshape(2, nr, -1)
    return (re - 1j * im) / 2, (re + 1j * im) / 2
