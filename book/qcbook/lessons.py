"""Networks small enough to be trained while a reader watches: printed architectures, random
examples."""

import time
from itertools import count, product

import numpy as np
import torch

from qclearn.nets.cpnet_paper import PaperCPNet, PaperCPNetConfig
from qclearn.nets.dbsnet_paper import PaperDBSNet, PaperDBSNetConfig
from qclearn.nets.losses import L_CP, L_LBS, L_DBSNet, L_LBS_printed, LossMesh
from qclearn.nets.polar import PolarSolver
from qclearn.nets.polargrid import PolarMesh
from qclearn.nets.torchplane import fit_mobius, square_places
from qclearn.nets.torchplane import mobius as mobius_of
from qclearn.nets.train import TrainingError
from qclearn.plane.beltrami import solve_beltrami_disk
from qclearn.plane.grids import POWER
from qclearn.plane.mobius import mobius, mobius_inverse
from qclearn.registration.fit import fit_problem
from qclearn.registration.problem import Problem, Weights
from qclearn.registration.report import measured_losses

SIZE = (12, 36, POWER)  # rings, spokes and grading of the mesh on which a small CP-Net's coefficient is solved for
INSIDE = 1e-4, 60  # tolerance and most steps of that solver
BATCH, MEASURED = 8, 5  # examples a step; steps between two looks at the unseen example
EQUATIONS = {"as corrected": L_LBS, "as printed": L_LBS_printed}


class Lesson:
    """A small network in training by Adam; `history`: a dict a step, "loss" and "unseen", the
    figure of an unseen example.

    A subclass has `name`, `network`, `draw()` of a batch, `loss(batch)` and `unseen()`, whose least
    value is `least`.
    """

    def __init__(self, network, rate, seed):
        self.network, self.history, self.rng = network, [], np.random.default_rng(seed)
        self.optimiser = torch.optim.Adam(network.parameters(), rate)

    def step(self):
        """Take a step, and keep its figures; TrainingError for a loss that is not finite."""
        self.network.train()
        loss = self.loss(self.draw())
        if not torch.isfinite(loss):
            raise TrainingError(f"the loss is {loss.item()} at step {len(self.history)}; start anew with a lower rate")
        self.optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self.optimiser.step()
        looked = self.history[-1]["unseen"] if len(self.history) % MEASURED else self.unseen()
        self.history.append({"loss": loss.item(), "unseen": looked})

    def train(self, seconds, stop=lambda: False, watch=lambda: None):
        """Steps for so many seconds, at least one, until stop() is true; watch() after each. It may
        be called again."""
        end = time.monotonic() + seconds
        for k in count():
            if k and (time.monotonic() >= end or stop()):
                return
            self.step()
            watch()


class CPLesson(Lesson):
    """The paper's CP-Net, corrected and small: 24 landmarks on three curves in, nu on a square out;
    `L_CP` of its map.

    The control's curves are fixed; subjects are the same curves bent by a random twist about a
    random point.
    """

    name, what = "CP-Net", "L_CP of the unseen example"

    def __init__(self, weights, rate=3e-3, seed=0):
        torch.manual_seed(seed)
        t = np.linspace(-1, 1, 8)
        self.target = np.concatenate([0.4 + 0.3j * t, -0.35 + 0.35j + 0.25 * t, -0.1 - 0.45j + 0.3 * t])
        super().__init__(PaperCPNet(PaperCPNetConfig(curves=3, points=8, size=16, widths=(48, 32, 24))), rate, seed)
        self.weights, self.solver, self.mesh = weights, PolarSolver(*SIZE), PolarMesh(*SIZE)
        self.losses = LossMesh(self.mesh.mesh)
        self.network.targets.copy_(torch.from_numpy(self.target))
        self.places = square_places(self.losses.z[self.losses.faces].mean(1))[None, None]
        moving = self.subject(np.random.default_rng(12))  # a seed of its own: the same for every run
        self.problem = Problem(self.mesh.mesh, moving, self.target, np.repeat(np.arange(3), 8))
        fit = self.reference()
        self.least = measured_losses(self.problem, weights, fit.mu, self.problem.samples @ fit.f)["L_CP"]

    def reference(self, *_):
        """The fit of the unseen example, with nu on as many rings as the network's mesh has."""
        return fit_problem(self.problem, self.weights, rings=SIZE[0])

    def subject(self, rng):
        """A subject's landmarks (24,): the target curves before a twist `w exp(i c (1 - |w|^2))`
        about a point."""
        pole, turn = (0.4 * np.sqrt(rng.random()) * np.exp(2j * np.pi * rng.random()), rng.uniform(-0.8, 0.8))
        w = mobius(self.target, pole)
        return mobius_inverse(w * np.exp(1j * turn * (1 - abs(w) ** 2)), pole)

    def draw(self):
        """Landmarks (BATCH, 24) of random subjects."""
        return torch.from_numpy(np.array([self.subject(self.rng) for _ in range(BATCH)])).to(torch.complex64)

    def coefficient(self, p):
        """The network's mu (B, F) on the faces of the mesh for landmarks p (B, 24)."""
        mu = self.network(p)
        image = torch.stack([mu.real, mu.imag], 1)
        places = self.places.expand(len(p), -1, -1, -1)
        found = torch.nn.functional.grid_sample(image, places, align_corners=False, padding_mode="border")[:, :, 0]
        return torch.complex(found[:, 0], found[:, 1])

    def loss(self, p):
        """Mean `L_CP` of the exact maps of the network's coefficients, each followed by the best
        Möbius map."""
        mu, target = self.coefficient(p), self.network.targets.expand_as(p)
        f = self.solver.solve(mu, *INSIDE)
        w = self.mesh.sample(f, self.mesh.locate(p))
        w = mobius_of(w, *fit_mobius(w, target))
        shares = self.losses.areas / self.losses.areas.sum()
        return L_CP(self.losses, mu, w, target, self.weights, shares=shares).mean()

    @torch.no_grad()
    def unseen(self):
        """`L_CP` of the unseen example."""
        self.network.eval()
        return self.loss(torch.from_numpy(self.problem.moving)[None].to(torch.complex64)).item()

    @torch.no_grad()
    def answer(self, moving):
        """The network's mu (F,) on the mesh for landmarks (24,)."""
        self.network.eval()
        return self.coefficient(torch.from_numpy(moving)[None].to(torch.complex64))[0].numpy().astype(complex)


class DBSLesson(Lesson):
    """The paper's DBS-Net, corrected and small: mu on 16 x 16 pixels of the square in, a map of its
    mesh out; `L_DBSNet`.

    equation: a name of `EQUATIONS`; rho: the weight of the boundary's term. Coefficients are drawn
    at random: a few waves over the square, of a largest modulus between 0.1 and 0.5.
    """

    name, what = "DBS-Net", "mean distance from the exact map, unseen mu"
    least = 0.0

    def __init__(self, equation="as corrected", rho=1e-6, rate=3e-3, seed=0):
        torch.manual_seed(seed)
        super().__init__(PaperDBSNet(PaperDBSNetConfig(size=16, frequencies=4)), rate, seed)
        self.equation, self.rho, self.size = EQUATIONS[equation], rho, 16
        self.mu = self.waves(np.random.default_rng(12))
        mesh = self.network.mesh
        self.z, self.faces = mesh.z.numpy().astype(complex), mesh.faces.numpy()
        self.exact = solve_beltrami_disk(self.z, self.faces, np.tile(self.mu.ravel(), 2))

    def waves(self, rng):
        """A coefficient (16, 16) on the pixels of the square."""
        x, y = np.meshgrid(*2 * [(np.arange(self.size) + 0.5) * 2 / self.size - 1])
        mu = 0
        for m, n in product((-1, 0, 1), repeat=2):
            mu = mu + (rng.normal() + 1j * rng.normal()) * np.exp(1j * np.pi * (m * x + n * y) / 2)
        return mu * rng.uniform(0.1, 0.5) / abs(mu).max()

    def draw(self):
        """Coefficients (BATCH, 16, 16) drawn at random."""
        return torch.from_numpy(np.array([self.waves(self.rng) for _ in range(BATCH)])).to(torch.complex64)

    def loss(self, mu):
        """Mean `L_DBSNet` of the network's maps."""
        f, angles = self.network(mu)
        mesh = self.network.mesh
        return L_DBSNet(mesh, self.network.on_faces(mu), f, angles, rho=self.rho, equation=self.equation).mean()

    @torch.no_grad()
    def answer(self, mu):
        """The network's map (V,) of its mesh for mu (16, 16)."""
        self.network.eval()
        return self.network(torch.from_numpy(mu)[None].to(torch.complex64))[0][0].numpy().astype(complex)

    def unseen(self):
        """Mean distance of the map of the unseen coefficient from the exact one."""
        return float(abs(self.answer(self.mu) - self.exact).mean())


def lesson(network, settings):
    """A new `Lesson` of "CP-Net" or "DBS-Net" with settings: alpha, beta, gamma, or equation and
    rho; and rate."""
    if network == "CP-Net":
        return CPLesson(Weights(settings["alpha"], settings["beta"], settings["gamma"]), settings["rate"])
    return DBSLesson(settings["equation"], settings["rho"], settings["rate"])
