"""The paper's networks as registration methods: CP-Net proposes mu, DBS-Net, the exact solver or a few steps make the map."""

from contextlib import nullcontext

from ..registration.checked import Networks, exact_map, guarded_map, moved_map
from .gauss_newton import MESH, few_steps
from .problem import report

TOLERANCE = 2e-3  # landmark error in the disk above which `guarded` refines


NEEDS = {
    "cpnet_dbsnet": ("cpnet", "dbsnet"),
    "cpnet_exact": ("cpnet",),
    "cpnet_steps": ("cpnet",),
    "guarded": ("cpnet", "dbsnet"),
}  # method -> networks


def networks_of(method, parameters):
    """The networks that a method named so uses with these parameters, loaded: a list, empty for all others."""
    preset, gamma = parameters.get("preset", "best"), parameters.get("gamma")
    return [network(name, preset, gamma) for name in NEEDS.get(method, ())]


def network(name, preset, gamma=None):
    """A network with its shipped weights; WeightsError if there are none, ImportError without torch."""
    from ..nets import load

    return load(name, preset, gamma)


def proposed(problem, mesh, preset, alpha, beta, gamma):
    """CP-Net's mu (F,) on a disk mesh (z, faces); the paper's has weights for a gamma of 1e4, 1e5 and 2e5 each, at
    alpha = beta = 1."""
    return network("cpnet", preset, gamma).predict(
        *mesh, problem.moving, problem.target, alpha=alpha, beta=beta, gamma=gamma, curve=problem.curve
    )


def cpnet_dbsnet(problem, preset="best", alpha=1.0, beta=1e-2, gamma=1e5):
    """M after DBS-Net's map for CP-Net's mu, M the best disk Möbius map for the landmarks: as it comes, folds and all.

    Source: paper, section 'Landmark-based Brain Cortical Surface Registration'.
    """
    mu = proposed(problem, (problem.z, problem.faces), preset, alpha, beta, gamma)
    f = network("dbsnet", preset).solve(problem.z, problem.faces, mu)
    return moved_map(problem.z, problem.faces, f, problem.moving, problem.target).f


def cpnet_exact(problem, preset="best", alpha=1.0, beta=1e-2, gamma=1e5):
    """The same with the exact solver in DBS-Net's place; a RepairWarning says if rows were switched against folds."""
    mu = proposed(problem, (problem.z, problem.faces), preset, alpha, beta, gamma)
    fit = exact_map(problem.z, problem.faces, mu, problem.moving, problem.target)
    report(fit.fallbacks)
    return fit.f


def cpnet_steps(problem, preset="best", steps=1, alpha=1.0, beta=1e-2, gamma=1e5):
    """`few_steps` from CP-Net's mu: at most so many Gauss-Newton steps on a polar mesh, then one exact solve."""
    return few_steps(problem, proposed(problem, MESH, preset, alpha, beta, gamma), steps, alpha, beta, gamma)


def guarded(problem, alpha=1.0, beta=1e-2, gamma=1e5, tolerance=TOLERANCE):
    """What `register(method="network", tolerance=TOLERANCE)` does: the networks, their exact twins where they fold or miss.

    A RepairWarning says each step aside.
    """
    networks, words = Networks(None, network("cpnet", "best").predict, network("dbsnet", "best").solve), []
    fit = guarded_map(
        networks,
        problem.z,
        problem.faces,
        problem.moving,
        problem.target,
        alpha,
        beta,
        gamma,
        problem.curve,
        tolerance,
        words,
        lambda name: nullcontext(),
    )
    report(words)
    return fit.f
