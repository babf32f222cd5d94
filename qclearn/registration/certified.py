"""A map with its measures and its certificate, and the two ways to one without a fit."""

from dataclasses import dataclass

from jaxtyping import Complex, Integer
from numpy import ndarray

from ..plane.mobius import best_mobius, mobius
from ..plane.solver import DiskSolver, unfold


@dataclass(frozen=True)
class CertifiedMap:
    """A disk map of a problem's landmarks, measured, and certified or reported.

    f: the map, Möbius part included; mu: its measured coefficient; mobius: (a, theta); landmark_error: mean
    |f(p) - q|, 0 without landmarks; bijective, flipped: its certificate; fallbacks: words on what was done besides,
    empty if nothing was; switched: at how many vertices rows were, the most where maps were tried one after the other.
    """

    f: Complex[ndarray, " V"]
    mu: Complex[ndarray, " F"]
    mobius: tuple
    landmark_error: float
    bijective: bool
    flipped: Integer[ndarray, " k"]
    fallbacks: tuple
    switched: int


def certified(problem, f, parameters, fallbacks=(), switched=0):
    """A map f (V,) of a problem with the Möbius parameters that it holds, measured: CertifiedMap."""
    certificate, off = problem.disk.certify(f), abs(problem.samples @ f - problem.target)
    return CertifiedMap(
        f,
        problem.disk.coefficient(f),
        parameters,
        float(off.mean()) if len(off) else 0.0,
        certificate.bijective,
        certificate.flipped,
        tuple(fallbacks),
        switched,
    )


def moved_map(problem, f, fallbacks=()):
    """M after f (V,), M the disk Möbius map with the least `mean |M(f(p)) - q|^2`: CertifiedMap."""
    loop = problem.disk.loop
    parameters = best_mobius(problem.samples @ f, problem.target)
    f = mobius(f, *parameters)
    f[loop] /= abs(f[loop])
    return certified(problem, f, parameters, fallbacks)


def exact_map(problem, mu):
    """`moved_map` of the exact solver's map for mu (F,); where it folds, rows are switched and it is solved again."""
    solver = DiskSolver(problem.disk)
    solved = solver.solve(mu)
    found = moved_map(problem, solved, solver_words(solver))
    if found.bijective:
        return found
    f, rows = unfold(solver, mobius(solved, *found.mobius))
    return certified(problem, f, found.mobius, solver_words(solver, len(rows)), len(rows))


def solver_words(solver, switched=0):
    """What a solver's last map needed to stay one, in words, empty if nothing."""
    words = [f"{switched} rows switched"] if switched else []
    return (*words, f"{solver.floored} boundary steps raised") if solver.floored else tuple(words)
