"""The networks as methods: CP-Net proposes mu; DBS-Net, the exact solver or steps make maps."""

from dataclasses import replace

from ...plane.grids import FINE, polar
from ...registration.fit import exact_map, moved_map
from ...registration.networks import certified_network_map, predicted
from ...registration.problem import Weights
from .gauss_newton import few_steps
from .solver import warn_of

# Landmark error in the disk above which `guarded` refines; `register` allows more.
TIGHT_TOLERANCE = 2e-3
NEEDS = {  # method -> networks
    "cpnet_dbsnet": ("cpnet", "dbsnet"),
    "cpnet_exact": ("cpnet",),
    "cpnet_steps": ("cpnet",),
    "guarded": ("cpnet", "dbsnet"),
}


def network(name, preset="best", gamma=None):
    """`qclearn.nets.load`."""
    from ...nets import load  # here, as it needs torch

    return load(name, preset, gamma)


def networks_of(method, parameters):
    """The loaded networks that the method of this name uses with these parameters, list."""
    preset, gamma = parameters.get("preset", "best"), parameters.get("gamma")
    return [network(name, preset, gamma) for name in NEEDS.get(method, ())]


def proposed(problem, preset, weights):
    """CP-Net's mu (F,) on a problem's disk mesh; the paper's needs (1, 1, 1e4), 1e5 or 2e5."""
    return predicted(network("cpnet", preset, weights.gamma).predict, problem, weights)


def cpnet_dbsnet(
    problem, preset="best", alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma
):
    """DBS-Net's map for CP-Net's mu, then the landmarks' best Möbius map, without any correction.

    Source: paper, section 'Landmark-based Brain Cortical Surface Registration'.
    """
    mu = proposed(problem, preset, Weights(alpha, beta, gamma))
    f = network("dbsnet", preset).solve(problem.disk.z, problem.disk.faces, mu)
    return moved_map(problem, f).f


def cpnet_exact(
    problem, preset="best", alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma
):
    """The exact solver's map for CP-Net's mu; a RepairWarning names switched rows."""
    result = exact_map(problem, proposed(problem, preset, Weights(alpha, beta, gamma)))
    warn_of(result.fallbacks)
    return result.f


def cpnet_steps(
    problem, preset="best", steps=1, alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma
):
    """`few_steps` from CP-Net's mu: Gauss-Newton steps on a polar mesh, then one exact solve."""
    weights, there = Weights(alpha, beta, gamma), replace(problem, disk=polar(*FINE))
    return few_steps(problem, proposed(there, preset, weights), steps, weights)


def guarded(
    problem, alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma, tolerance=TIGHT_TOLERANCE
):
    """`register(method="network")`: the networks' map, or where it falls short their
    exact counterparts'.

    A RepairWarning says each step aside.
    """
    predict, solve = network("cpnet", "best").predict, network("dbsnet", "best").solve
    result = certified_network_map(predict, solve, problem, Weights(alpha, beta, gamma), tolerance)
    warn_of(result.fallbacks)
    return result.f
