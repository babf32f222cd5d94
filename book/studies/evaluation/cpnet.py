"""CP-Net on problems it has not seen, against `fit_landmarks`: every map measured on the mesh of
its problem.

Three kinds, as many of each: pairs of synthetic subjects of other seeds and scattered points moved
by random maps, both on one polar mesh, and real sulci, those of fsaverage5 in both directions, on
its own mesh. A coefficient's map is the exact solver's, followed by the best Möbius map; `L_CP` is
that of its measured coefficient.
"""

import time
from itertools import islice, pairwise

import numpy as np
import torch

from data_synth.cohort import hemispheres
from data_synth.fields import KINDS, random_coefficient
from qclearn.benchmark.pairs import fsaverage_pair, prepare
from qclearn.nets import L_grad_mu, L_lost, LossMesh, load
from qclearn.nets.networks import PAPER_GAMMAS
from qclearn.plane.coefficients import bounded
from qclearn.plane.disk import Disk
from qclearn.plane.grids import COARSE, FINE, polar, square_disk
from qclearn.plane.mobius import best_mobius, mobius
from qclearn.plane.solver import DiskSolver
from qclearn.registration.curves import sample_curve
from qclearn.registration.fit import exact_map, fit_problem, moved_map
from qclearn.registration.levels import Level, MultiresolutionFit
from qclearn.registration.networks import predicted
from qclearn.registration.problem import Problem, Weights, distinct
from qclearn.registration.report import measured_losses
from qclearn.surfaces.conformal import parameterize

MESH = polar(*FINE)
POINTS = 10  # on each curve
EACH = 16  # problems of each kind
LOOKS, TIMED = 7, 3  # at most, of those whose answers are measured, and whose times
SEED = 5301
AS_MANY = {"Born step": "Born step, as many looks", "CP-Net": "U-Net's start, as many looks"}  # as CP-Net has there
FIXED = {"default": Weights(), "stiff": Weights(gamma=1e5)}
PAPERS = {name: Weights(1.0, 1.0, float(name)) for name in ("1e4", "1e5", "2e5")}


def figures(seeds, quick=False):
    """Ratios to the fit at random weights, at the default and at the paper's, the paper's preset,
    and times.

    "Born step, 1 look": the same steps from where nothing was learned. "exact step": the fit's own
    first Gauss-Newton steps, by adjoint solves. Times are the processor's.
    """
    rng, size, net = np.random.default_rng(SEED), 2_500 if quick else 10_000, load("cpnet")
    landmarks = curves_of(seeds[:2] if quick else seeds[: EACH + 1], size)
    makers = {"other seeds": subjects(landmarks), "scattered": scattered(rng), "real": real(rng)}
    problems = {kind: list(islice(maker, 1 if quick else EACH)) for kind, maker in makers.items()}
    rows = {"random": [], **{name: [] for name in FIXED}}
    for kind, some in problems.items():
        for problem in some:
            for name, weights in {"random": random_weights(net.config, rng), **FIXED}.items():
                rows[name].append({"kind": kind, **compare(net, problem, weights)})
    named = {name: summary(rows[name]) for name in FIXED}
    for name, weights in list(PAPERS.items())[: 1 if quick else None]:
        named[name] = summary([compare(net, problem, weights) for problem in problems["other seeds"][:8]])
    return {
        "random": summary(rows["random"]),
        "kinds": {
            kind: {name: summary([row for row in some if row["kind"] == kind]) for name, some in rows.items()}
            for kind in problems
        },
        "bands": bands([row for some in rows.values() for row in some]),
        "named": named,
        "paper": paper(landmarks, quick),
        "ranges": {"beta / alpha": net.config.smooth, "gamma / alpha": net.config.match},
        "looks": {name: net.looks_at(weights) for name, weights in FIXED.items()},
        "latency_ms": latency(net, problems),
    }


def curves_of(seeds, vertices):
    """Each subject's named curves as landmarks of its disk, POINTS a curve by arc length: list of
    (M,) complex."""
    found = []
    for subject in hemispheres(seeds, vertices):
        surface, z = subject.surface, parameterize(subject.surface).disk.z
        found.append(np.concatenate([sample_curve(surface, path, POINTS) @ z for path in surface.curves.values()]))
    return found


def subjects(landmarks):
    """Problems of each subject against the next one."""
    for p, q in zip(landmarks, [*landmarks[1:], landmarks[0]]):
        yield Problem(MESH, *aligned(p, q))


def scattered(rng):
    """Problems of 4 to 128 scattered points that a random map has moved."""
    solver = DiskSolver(MESH)
    while True:
        q = 0.95 * np.sqrt(rng.random(round(2 ** rng.uniform(2, 7))))
        q = q * np.exp(2j * np.pi * rng.random(len(q)))
        f = solver.solve(random_coefficient(MESH, rng, kind=rng.choice(KINDS), max_abs=(0.1, 0.6)))
        yield Problem(MESH, *aligned(MESH.interpolation(q) @ f, q))


def real(rng):
    """Problems of fsaverage5's two sides, turn about: all their sulci, then some of them at ten or
    five points each."""
    there = fsaverage_pair()
    swapped = [entry | {"moving": entry["control"], "control": entry["moving"]} for entry in there.curves]
    back = type(there)(there.control, there.moving, tuple(swapped))
    both = [prepare(pair).problem for pair in (there, back)]
    for number in range(2 * EACH):
        problem = both[number % 2]
        labels = np.unique(problem.curve)
        chosen = labels if number < 2 else rng.choice(labels, rng.integers(3, len(labels) + 1), replace=False)
        every = 1 if number < 2 else rng.integers(1, 3)
        some = np.flatnonzero(np.isin(problem.curve, chosen))[::every]
        yield Problem(problem.disk, problem.moving[some], problem.target[some])


def aligned(p, q):
    """The two sides' distinct landmarks (M,), the moving ones after the best Möbius map."""
    p = mobius(p, *best_mobius(p, q))
    once = distinct(p, q)
    return p[once], q[once]


def random_weights(config, rng):
    """Weights with alpha over three decades and both ratios over the network's ranges."""
    alpha = 10 ** rng.uniform(-1.5, 1.5)
    ratios = [10 ** rng.uniform(*config.smooth), 10 ** rng.uniform(*config.match)]
    return Weights(float(alpha), *(float(alpha * ratio) for ratio in ratios))


def compare(net, problem, weights):
    """One problem: the fit's loss and landmark error, and what each answer has, as ratios to them."""
    start = time.process_time()
    fit = fit_problem(problem, weights)
    seconds = {"fit": time.process_time() - start}
    predicted(net.predict, problem, weights)  # the mesh is known from a call before
    start = time.process_time()
    answers = {"CP-Net": predicted(net.predict, problem, weights)}
    seconds["network"] = time.process_time() - start
    answers |= net.answers(problem, weights, LOOKS)
    found = {name: exact_map(problem, mu) for name, mu in answers.items()}
    found |= {name: found[f"{start}, {net.looks_at(weights)} looks"] for start, name in AS_MANY.items()}
    for number, (passed, one) in enumerate(stepped(problem, weights), 1):
        found[f"exact step {number}"], seconds[f"exact step {number}"] = one, passed
    reference = measured(problem, weights, fit)["L_CP"]
    return {
        "weights": [weights.alpha, weights.beta, weights.gamma],
        "before": float(abs(problem.moving - problem.target).mean()),
        "fit_error": fit.landmark_error,
        "seconds": seconds,
        "ratio": {name: measured(problem, weights, one)["L_CP"] / reference for name, one in found.items()},
        "error": {name: one.landmark_error for name, one in found.items()},
        "flipped": {name: len(one.flipped) for name, one in found.items()},
    }


def measured(problem, weights, found):
    return measured_losses(problem, weights, found.mu, problem.samples @ found.f)


def stepped(problem, weights, steps=3):
    """The first Gauss-Newton steps by adjoint solves, from nu = 0 and at the whole gamma: (seconds
    so far, map)."""
    start, mesh = time.process_time(), polar(*COARSE)
    level = Level(COARSE[0], None, steps)
    objective = MultiresolutionFit(problem).objective(level, weights)
    to_faces = mesh.interpolation(problem.disk.centroids)
    state = objective.at(np.zeros(len(mesh.z), complex), problem.mobius)
    for _ in range(steps):
        state = objective.step(state, weights.gamma) or state
        passed = time.process_time() - start
        yield passed, exact_map(problem, bounded(to_faces @ state.nu))


def summary(rows):
    """Median and 90th percentile over problems of the ratio of losses, and of that of the landmark
    errors."""
    table = {}
    for name in rows[0]["ratio"]:
        ratios, errors = [row["ratio"][name] for row in rows], [row["error"][name] for row in rows]
        relative = np.divide(errors, [row["fit_error"] for row in rows])
        table[name] = {
            "median": float(np.median(ratios)),
            "p90": float(np.quantile(ratios, 0.9)),
            "worst": float(max(ratios)),
            "error_ratio": float(np.mean(errors) / np.mean([row["fit_error"] for row in rows])),
            "error_ratio_p90": float(np.quantile(relative, 0.9)),
            "error": float(np.mean(errors)),
            "folded": float(np.mean([row["flipped"][name] > 0 for row in rows])),
        }
    return {
        "problems": len(rows),
        "before": float(np.mean([row["before"] for row in rows])),
        "fit_error": float(np.mean([row["fit_error"] for row in rows])),
        "answers": table,
        "seconds": {name: float(np.median([row["seconds"][name] for row in rows])) for name in rows[0]["seconds"]},
    }


def bands(rows, edges=(0, 3, 5, 7, 11)):
    """CP-Net's median ratio by how stiff the problem is, log10(gamma / beta): list of (low, high,
    problems, ratios)."""
    stiff = np.array([np.log10(row["weights"][2] / row["weights"][1]) for row in rows])
    table = []
    for low, high in pairwise(edges):
        inside = [row["ratio"] for row, value in zip(rows, stiff) if low <= value < high]
        if inside:
            table.append(
                {
                    "from": low,
                    "to": high,
                    "problems": len(inside),
                    **{name: float(np.median([ratio[name] for ratio in inside])) for name in inside[0]},
                }
            )
    return table


def paper(subjects, quick):
    """The paper's preset, one control, against the fit: gamma -> `printed`."""
    found = {}
    for gamma in PAPER_GAMMAS[:1] if quick else PAPER_GAMMAS:
        found[f"{gamma:.0e}".replace("e+0", "e")] = printed(load("cpnet", "paper", gamma), subjects, quick)
    return found


def printed(net, subjects, quick):
    """Means over subjects (M,) of one of the paper's CP-Nets, corrected.

    "dbsnet_...": by the map of the paper's DBS-Net, which the paper's own table is about; "error",
    "loss_ratio" and |mu|: by the exact map of the same coefficient. "whole_ratio": of L_CP with
    beta `L_lost`. "seen", "lost": `L_grad_mu` and `L_lost` of the network's image.
    """
    rows, weights, pixels = ([], Weights(1.0, 1.0, net.config.gamma), Disk(*square_disk(net.config.size)))
    for moving in subjects[: 1 if quick else 12]:
        p, q = aligned(moving, net.targets.numpy().astype(complex))
        problem = Problem(MESH, p, q)
        fit = fit_problem(problem, weights)
        start = time.process_time()
        mu = net.predict(MESH.z, MESH.faces, p, q)
        passed = time.process_time() - start
        answer = exact_map(problem, mu)
        through = moved_map(problem, load("dbsnet", "paper").solve(MESH.z, MESH.faces, mu))
        losses = {name: measured(problem, weights, one)["L_CP"] for name, one in (("fit", fit), ("net", answer))}
        whole = {name: losses[name] + smoothness(MESH, one.mu)[1] for name, one in (("fit", fit), ("net", answer))}
        image = net(torch.from_numpy(net.in_order(p, q))[None].to(net.targets))[0].numpy()
        seen, lost = smoothness(pixels, np.tile(image.ravel(), 2))  # a pixel's two faces
        rows.append(
            {
                "before": abs(p - q).mean(),
                "fit_error": fit.landmark_error,
                "error": answer.landmark_error,
                "fit_mean_abs_mu": abs(fit.mu).mean(),
                "mean_abs_mu": abs(answer.mu).mean(),
                "folded": len(answer.flipped) > 0,
                "seconds": passed,
                "loss_ratio": losses["net"] / losses["fit"],
                "whole_ratio": whole["net"] / whole["fit"],
                "seen": seen,
                "lost": lost,
                "dbsnet_error": through.landmark_error,
            }
        )
    means = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    ratios = {f"{name}_ratio": means[name] / means["fit_error"] for name in ("error", "dbsnet_error")}
    return means | ratios | {"problems": len(rows)}


def smoothness(disk, mu):
    """`L_grad_mu` and `L_lost` of mu (F,), means over the area."""
    mesh, given = LossMesh(disk, torch.float64), torch.from_numpy(mu)[None].to(torch.complex128)
    return [term(mesh, given, mesh.areas / mesh.areas.sum()).item() for term in (L_grad_mu, L_lost)]


def latency(net, problems, repeats=10):
    """Milliseconds of one call on a mesh that is known from a call before, by looks, medians: some
    40 landmarks on the polar mesh, and "large" all of fsaverage5's on its own."""
    some = min(problems["other seeds"] + problems["scattered"], key=lambda problem: abs(len(problem.moving) - 40))
    large = problems["real"][0]
    clock = {"landmarks": len(some.moving), "vertices": len(some.disk.z)}
    clock |= {f"looks_{looks}": milliseconds(net, some, looks, repeats) for looks in range(TIMED + 1)}
    clock |= {"large_landmarks": len(large.moving), "large_vertices": len(large.disk.z)}
    clock["large"] = milliseconds(net, large, net.config.looks, repeats)
    solver, start = DiskSolver(some.disk), time.process_time()
    solver.solve(np.zeros(len(some.disk.faces), complex))
    return clock | {"median": clock[f"looks_{net.config.looks}"], "exact_map": 1e3 * (time.process_time() - start)}


def milliseconds(net, problem, looks, repeats):
    """The median time of a call, the first one apart."""
    passed, disk = [], problem.disk
    for _ in range(repeats + 1):
        start = time.process_time()
        net.predict(disk.z, disk.faces, problem.moving, problem.target, looks=looks)
        passed.append(1e3 * (time.process_time() - start))
    return float(np.median(passed[1:]))
