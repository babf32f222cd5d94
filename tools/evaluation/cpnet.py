"""CP-Net on pairs of subjects it has not seen, against `fit_landmarks`: every map measured on one polar mesh.

A coefficient's map is the exact solver's on that mesh, followed by the best Möbius map; `L_CP` is that of its measured
coefficient (`metrics.measured_losses`).
"""

import time
from itertools import pairwise

import numpy as np

import qclearn as qc
from data_synth.cohort import hemispheres
from qclearn.nets import WeightsError, load
from qclearn.nets.cpnet import BestCPNet
from qclearn.nets.networks import PAPER_GAMMAS
from qclearn.plane.disk import BeltramiDiskSolver
from qclearn.plane.diskmesh import polar_disk, square_disk
from qclearn.plane.fields import bounded
from qclearn.plane.mobius import best_mobius, mobius
from qclearn.registration.certified import exact_map, moved_map
from qclearn.registration.checked import predicted
from qclearn.registration.engine import GaussNewton
from qclearn.registration.fit import POWER, fit_problem, start_field
from qclearn.registration.landmarks import sample_curve
from qclearn.registration.metrics import measured_losses
from qclearn.registration.problem import Problem, Weights, distinct

MESH = polar_disk(32, 96, POWER)
POINTS = 10  # on each curve
NAMED = {"default": Weights(), **{name: Weights(1.0, 1.0, float(name)) for name in ("1e4", "1e5", "2e5")}}


def figures(seeds, quick=False):
    """Ratios to the fit at random and at named weights, the paper's preset, Gauss-Newton from CP-Net, and times.

    "without the U-Nets": Born step, one exact solve and a chord step, what is left of CP-Net with one look. Times are
    the processor's.
    """
    rng, size = np.random.default_rng(0), 2_500 if quick else 10_000
    landmarks = dict(zip(seeds[:2] if quick else seeds, curves_of(seeds[:2] if quick else seeds, size)))
    pairs = list(zip(landmarks, [*list(landmarks)[1:], next(iter(landmarks))]))
    net = load("cpnet")
    plain = BestCPNet(net.config).eval()  # its U-Nets say 0: the steps that surround them alone
    drawn = [(*pair, random_weights(net.config, rng)) for pair in pairs for _ in range(1 if quick else 2)]
    rows = [compare(net, plain, *aligned(landmarks[a], landmarks[b]), weights) for a, b, weights in drawn]
    named = {}
    for name, weights in list(NAMED.items())[: 1 if quick else None]:
        some = pairs[:1] if quick else pairs[:8]
        named[name] = summary([compare(net, plain, *aligned(landmarks[a], landmarks[b]), weights) for a, b in some])
    return {
        "random": summary(rows),
        "bands": bands(rows),
        "named": named,
        "paper": paper(list(landmarks.values()), quick),
        "ranges": {"beta / alpha": net.config.smooth, "gamma / alpha": net.config.match},
        "latency_ms": latency(net, *aligned(*list(landmarks.values())[:2])),
        "rows": [{key: value for key, value in row.items() if key != "seconds"} for row in rows],
    }


def curves_of(seeds, vertices):
    """Each subject's named curves as landmarks of its disk, POINTS a curve by arc length: list of (M,) complex."""
    found = []
    for subject in hemispheres(seeds, vertices):
        surface = subject.surface
        z = qc.disk_conformal_map(surface)
        found.append(np.concatenate([sample_curve(surface, path, POINTS) @ z for path in surface.curves.values()]))
    return found


def aligned(p, q):
    """The two sides' distinct landmarks (M,), the moving ones after the best Möbius map."""
    p = mobius(p, *best_mobius(p, q))
    once = distinct(p, q)
    return p[once], q[once]


def random_weights(config, rng):
    """Weights with alpha and both ratios over three decades each."""
    alpha = 10 ** rng.uniform(-1.5, 1.5)
    ratios = [10 ** rng.uniform(*config.smooth), 10 ** rng.uniform(*config.match)]
    return Weights(float(alpha), *(float(alpha * ratio) for ratio in ratios))


def compare(net, plain, p, q, weights):
    """One problem: the fit's loss and landmark error, and what each answer has, as ratios to them."""
    problem, start = Problem(*MESH, p, q), time.process_time()
    fit = fit_problem(problem, weights)
    seconds = {"fit": time.process_time() - start}
    reference = measured(problem, weights, fit)
    start = time.process_time()
    mu = predicted(net.predict, problem, weights)
    seconds["network"] = time.process_time() - start
    told = net.answers(problem, weights, looks=2)
    bare = plain.answers(problem, weights, looks=2)
    answers = {
        "Born step": told["Born step"],
        "without the U-Nets": bare["1 look"],
        "without the U-Nets, 2 looks": bare["2 looks"],
        "CP-Net": mu,
        "CP-Net, 1 look": told["1 look"],
        "CP-Net, 2 looks": told["2 looks"],
    }
    found = {name: exact_map(problem, mu) for name, mu in answers.items()}
    start = time.process_time()
    found |= polished(problem, mu, weights)
    seconds["two steps"] = time.process_time() - start
    return {
        "weights": [weights.alpha, weights.beta, weights.gamma],
        "before": float(abs(p - q).mean()),
        "fit": reference["L_CP"],
        "fit_error": fit.landmark_error,
        "fit_flipped": len(fit.flipped),
        "seconds": seconds,
        "ratio": {name: measured(problem, weights, one)["L_CP"] / reference["L_CP"] for name, one in found.items()},
        "error": {name: one.landmark_error for name, one in found.items()},
        "flipped": {name: len(one.flipped) for name, one in found.items()},
    }


def measured(problem, weights, found):
    return measured_losses(problem, weights, found.mu, problem.samples @ found.f)


def polished(problem, mu, weights, steps=2):
    """One and two Gauss-Newton steps of the fit from the network's mu, on the mesh: name -> map."""
    engine, found = GaussNewton(problem, MESH, weights), {}
    state = engine.at(start_field(*MESH, mu, engine.z), (0j, 0.0))
    state = engine.moved(state, best_mobius(state.points, problem.target))
    for number in range(1, steps + 1):
        state = engine.step(state, weights.gamma) or state
        found[f"CP-Net, then {number} Gauss-Newton"] = exact_map(problem, bounded(engine.to_faces @ state.nu))
    return found


def summary(rows):
    """Median and 90th percentile over problems of the ratio of losses, and of that of the landmark errors."""
    table = {}
    for name in rows[0]["ratio"]:
        ratios, errors = [row["ratio"][name] for row in rows], [row["error"][name] for row in rows]
        relative = np.divide(errors, [row["fit_error"] for row in rows])
        table[name] = {
            "median": float(np.median(ratios)),
            "p90": float(np.quantile(ratios, 0.9)),
            "worst": float(max(ratios)),
            "error_ratio": float(np.mean(errors) / np.mean([row["fit_error"] for row in rows])),
            "error_ratio_median": float(np.median(relative)),
            "error_ratio_p90": float(np.quantile(relative, 0.9)),
            "error": float(np.mean(errors)),
            "folded": float(np.mean([row["flipped"][name] > 0 for row in rows])),
        }
    return {
        "problems": len(rows),
        "before": float(np.mean([row["before"] for row in rows])),
        "fit_error": float(np.mean([row["fit_error"] for row in rows])),
        "fit_folded": float(np.mean([row["fit_flipped"] > 0 for row in rows])),
        "answers": table,
        "seconds": {name: float(np.median([row["seconds"][name] for row in rows])) for name in rows[0]["seconds"]},
    }


def bands(rows, edges=(0, 3, 4, 5, 8)):
    """CP-Net's median ratio by how stiff the problem is, log10(gamma / beta): list of (low, high, problems, ratios)."""
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
    """The paper's preset, one control, against the fit: gamma -> means over subjects (M,).

    "dbsnet_...": by the map of the paper's DBS-Net, through which it was trained and which the paper's own table is
    about; "error", "loss_ratio" and |mu|: by the exact map of the same coefficient.
    """
    found = {}
    for gamma in PAPER_GAMMAS[:1] if quick else PAPER_GAMMAS:
        try:
            net = load("cpnet", "paper", gamma)
        except WeightsError as error:
            print(f"without the paper's preset: {error}")
            continue
        rows, weights = [], Weights(1.0, 1.0, gamma)
        for moving in subjects[: 1 if quick else 12]:
            p, q = aligned(moving, net.targets.numpy().astype(complex))
            problem = Problem(*MESH, p, q)
            fit = fit_problem(problem, weights)
            start = time.process_time()
            mu = net.predict(*MESH, p, q)
            passed = time.process_time() - start
            answer = exact_map(problem, mu)
            through = moved_map(problem, load("dbsnet", "paper").solve(*MESH, mu))
            rows.append(
                [
                    abs(p - q).mean(),
                    fit.landmark_error,
                    answer.landmark_error,
                    abs(fit.mu).mean(),
                    abs(answer.mu).mean(),
                    len(answer.flipped) > 0,
                    passed,
                    measured(problem, weights, answer)["L_CP"] / measured(problem, weights, fit)["L_CP"],
                    through.landmark_error,
                    len(through.flipped) > 0,
                    abs(through.mu).mean(),
                ]
            )
        keys = (
            "before",
            "fit_error",
            "error",
            "fit_mean_abs_mu",
            "mean_abs_mu",
            "folded",
            "seconds",
            "loss_ratio",
            "dbsnet_error",
            "dbsnet_folded",
            "dbsnet_mean_abs_mu",
        )
        means = dict(zip(keys, np.mean(rows, axis=0).tolist()))
        name = f"{gamma:.0e}".replace("e+0", "e")
        found[name] = {
            **means,
            "problems": len(rows),
            "error_ratio": means["error"] / means["fit_error"],
            "dbsnet_error_ratio": means["dbsnet_error"] / means["fit_error"],
        }
    return found


def latency(net, p, q, repeats=20):
    """Milliseconds of one call on the square mesh of 128 x 128 cells, known from a call before, by looks;
    the medians."""
    mesh, clock = square_disk(128), {"landmarks": len(p)}
    for looks in range(4):
        passed = []
        for _ in range(repeats + 1):
            start = time.process_time()
            net.predict(*mesh, p, q, looks=looks)
            passed.append(1e3 * (time.process_time() - start))
        clock[f"looks_{looks}"] = float(np.median(passed[1:]))
    solver, start = BeltramiDiskSolver(*mesh), time.process_time()
    solver.solve(np.zeros(len(mesh[1]), complex))
    return clock | {"median": clock[f"looks_{net.config.looks}"], "exact_map": 1e3 * (time.process_time() - start)}
