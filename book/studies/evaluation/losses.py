"""Small networks of the kind of the paper's CP-Net by three losses, alike in all else: corrected,
whole, and as printed.

Each is trained through the exact solver with several seeds: on three curves that random twists have
bent, as in the training lab. Examples that took no part judge it.
"""

import numpy as np
import torch
from torch.utils.data import TensorDataset

from qcbook.lessons import CPLesson
from qclearn.nets import Objective, PolarSolver, Process, TrainConfig, build, take_step
from qclearn.nets.cpnet_paper import LOSSES
from qclearn.nets.losses import LossMesh
from qclearn.nets.squaremaps import SquareMaps
from qclearn.plane.disk import Disk
from qclearn.plane.grids import square_disk
from qclearn.registration.problem import Weights

from .cpnet import aligned, printed

SMALL = {"preset": "paper", "gamma": 1e5, "curves": 3, "points": 8, "size": 16, "widths": (48, 32, 24)}
STEPS, TRAININGS, EXAMPLES, UNSEEN = 400, 3, 200, 4
SOLVER, STOPPING = (16, 48), (1e-4, 60)  # rings and spokes; tolerance and most steps


def figures(seeds, quick=False):
    """Name of the loss -> `printed` of each training; "steps" of each. `seeds`, of grown subjects,
    are not used."""
    steps, lesson = 2 if quick else STEPS, CPLesson(Weights())
    unseen = [lesson.subject(np.random.default_rng([1, k])) for k in range(UNSEEN)]
    found = {
        loss: [printed(trained(loss, seed, steps, lesson), unseen, quick) for seed in range(TRAININGS)]
        for loss in LOSSES
    }
    return found | {"steps": steps, "examples": EXAMPLES}


def trained(loss, seed, steps, lesson):
    """A network after so many steps; its seed is that of the first values, of the examples and of
    their order."""
    torch.manual_seed(seed)
    network, polar = build("cpnet", SMALL | {"loss": loss}), PolarSolver(*SOLVER)
    square = SquareMaps(SMALL["size"], polar.mesh, polar.solve)
    network.solver = [LossMesh(Disk(*square_disk(SMALL["size"]))), lambda mu: square(mu, *STOPPING)]
    rng = np.random.default_rng([0, seed])
    moving = [aligned(lesson.subject(rng), lesson.target)[0] for _ in range(EXAMPLES)]
    examples = [torch.tensor(np.array(side)).to(torch.complex64) for side in (moving, EXAMPLES * [lesson.target])]
    recipe, objective = TrainConfig(steps, 8, 2e-3, seed=seed, warmup=20), Objective(network)
    optimiser = torch.optim.AdamW(network.parameters(), recipe.rate, weight_decay=recipe.weight_decay)
    for step in range(steps):
        take_step(objective, optimiser, TensorDataset(*examples), recipe, step, Process())
    return network.eval().requires_grad_(False)
