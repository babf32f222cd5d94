"""DBS-Net on coefficients it has not seen, against the exact solver: accuracy, folds, each route,
time."""

import time
import warnings

import numpy as np
import torch

from data_synth.fields import KINDS, random_coefficient
from data_synth.training import SquareFields
from qclearn.nets import build, load
from qclearn.nets.gauges import gauge_errors
from qclearn.nets.polar import PolarSolver, two_steps
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.disk import Disk
from qclearn.plane.fourier import from_square
from qclearn.plane.grids import polar_disk, square_disk
from qclearn.plane.linear import Dirichlet
from qclearn.plane.solver import DiskSolver

MESH = 48, 144
MAPS = 16  # a seed
FIELDS, FIELDS_SEED = 48, 5203  # of the images on which both gauges are measured
SIZE, RINGS, SPOKES = (64, 40, 128)  # of the square in pixels, and of the polar mesh that they are resampled to
EXACT = 1e-6  # the tolerance of the maps that errors are measured against


def figures(seeds, quick=False):
    """Random mu with max|mu| uniform in [0.05, 0.6] on the 48 x 144 polar mesh, both kinds, `MAPS`
    for each seed."""
    solver = PolarSolver(*MESH)
    mu = draw(seeds[:2] if quick else seeds, solver.mesh, 2 if quick else MAPS)
    exact = in_batches(lambda part: solver.solve(part, EXACT), mu)
    nets = {preset: load("dbsnet", preset) for preset in ("best", "paper")}
    result = {
        "gauges": gauges(nets, 4 if quick else FIELDS),
        "maps": len(mu),
        "mean_displacement": float(displacement(exact, solver.mesh.z).mean()),
        "superlu": map_figures(superlu(solver, mu), exact, mu, solver),
    }
    for name, net in nets.items():
        maps = np.array([net.solve(solver.mesh.z, solver.mesh.faces, one) for one in mu])
        result[name] = map_figures(maps, exact, mu, solver) | {"latency_ms": latency(net, solver, mu[0], quick)}
        result[name]["samples"] = samples(maps, mu, solver)
    start = in_batches(lambda part: two_steps(solver, part)[0][1], mu)
    result["start"] = map_figures(start, exact, mu, solver)
    result["curves"] = {str(count): curves(nets["best"], mu, exact, count, quick) for count in (1, 16)}
    result["routes"] = routes(nets["paper"], seeds[:2] if quick else seeds, 2 if quick else 4)
    wide = build("dbsnet", {"preset": "paper", "size": 128})
    image = torch.zeros(1, 128, 128, dtype=torch.complex64)
    result["paper"]["latency_128_ms"] = 1e3 * timed(lambda: wide(image), quick)
    result["latency_ms"] = {
        "polar": 1e3 * timed(lambda: solver.solve(torch.from_numpy(mu[0]).to(torch.complex64)), quick),
        "superlu": 1e3 * timed(lambda: superlu(solver, mu[:1]), quick),
    }
    return result


def gauges(nets, count):
    """Every network's `gauge_errors` and share of maps with a fold, mesh by mesh, on images that
    none has seen."""
    images = [image.numpy() for (image,) in (SquareFields(count, FIELDS_SEED, SIZE)[k] for k in range(count))]
    square, polar = Disk(*square_disk(SIZE)), Disk(*polar_disk(RINGS, SPOKES))
    given = {
        "square": (square, [np.tile(image.ravel(), 2) for image in images]),  # a pixel's two faces
        "polar": (polar, [from_square(image, polar) for image in images]),
    }
    result = {"fields": count, "seed": FIELDS_SEED}
    for mesh, (disk, mu) in given.items():
        factored = DiskSolver(disk)
        exact = np.array([factored.solve(one) for one in mu])
        result[mesh] = {}
        for name, net in nets.items():
            maps = np.array([net.solve(disk.z, disk.faces, one) for one in mu])
            folded = np.mean([len(disk.certify(f).flipped) > 0 for f in maps])
            result[mesh][name] = gauge_errors(maps, exact, disk.z) | {"folded_share": float(folded)}
    return result


def draw(seeds, disk, count):
    """Coefficients (B, F), the kinds in turn, map k of a seed decided by the two alone."""
    return np.array(
        [
            random_coefficient(disk, np.random.default_rng([seed, 97, k]), kind=KINDS[k % 2])
            for seed in seeds
            for k in range(count)
        ]
    )


def in_batches(function, mu, size=16):
    """Maps (B, V) as NumPy, in float32 batches."""
    with torch.no_grad():
        parts = torch.from_numpy(mu).to(torch.complex64).split(size)
        return torch.cat([function(part) for part in parts]).numpy().astype(complex)


def superlu(solver, mu):
    """The factored exact solver's maps (B, V)."""
    factored = DiskSolver(solver.mesh)
    return np.array([factored.solve(one) for one in mu])


def displacement(exact, z):
    """Mean distance (B,) that a map moves the vertices, after the best rotation."""
    turn = exact @ z.conj()
    return abs(exact - (turn / abs(turn))[:, None] * z).mean(1)


def map_figures(maps, exact, mu, solver):
    """What a set of maps (B, V) of one mesh is worth."""
    disk, z = solver.mesh, solver.mesh.z
    error, moved = abs(maps - exact).mean(1), displacement(exact, z)
    flipped = np.array([len(disk.certify(f).flipped) for f in maps])
    measured = np.array([abs(disk.coefficient(f) - one) for f, one in zip(maps, mu)])
    return gauge_errors(maps, exact, z) | {
        "relative_errors": (error / moved).round(5).tolist(),
        "largest_mu": abs(mu).max(1).round(4).tolist(),
        "off_circle": float(abs(abs(maps[:, -MESH[1] :]) - 1).max()),
        "folded_share": float((flipped > 0).mean()),
        "folded_share_after_fallback": fallback(maps, flipped, mu, solver),
        "mu_error": float(measured.mean()),
    }


def fallback(maps, flipped, mu, solver):
    """Share of maps with a fold once the exact solver has replaced those that had one."""
    factored, still = DiskSolver(solver.mesh), 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)
        for k in np.flatnonzero(flipped):
            still += not solver.mesh.certify(factored.solve(mu[k])).bijective
    return still / len(maps)


def samples(maps, mu, solver):
    """Histograms of |measured mu - mu| over the faces of three maps, as the paper shows: counts and
    edges."""
    edges = np.linspace(0, 0.2, 41)
    chosen = [0, len(mu) // 3, 2 * len(mu) // 3]
    errors = [abs(solver.mesh.coefficient(maps[k]) - mu[k]) for k in chosen]
    return {
        "edges": edges.tolist(),
        "counts": [np.histogram(e.clip(max=edges[-1]), edges)[0].tolist() for e in errors],
        "largest_mu": [float(abs(mu[k]).max()) for k in chosen],
    }


def timed(function, quick):
    """Median seconds of `function()`, after one call that does not count."""
    times = []
    with torch.no_grad():
        for _ in range(1 + (2 if quick else 15)):
            start = time.perf_counter()
            function()
            times.append(time.perf_counter() - start)
    return float(np.median(times[1:]))


def latency(net, solver, mu, quick):
    """Milliseconds of one `solve` on the network's own mesh, resampling included (its tables made
    before)."""
    if net.config.preset == "best":
        z, faces, given = solver.mesh.z, solver.mesh.faces, mu
    else:
        z, faces = net.mesh.z.numpy().astype(complex), net.mesh.faces.numpy()
        loop = net.mesh.loop.numpy()
        z[loop] /= abs(z[loop])
        given = np.full(len(faces), 0.3 + 0j)
    return 1e3 * timed(lambda: net.solve(z, faces, given), quick)


def curves(net, mu, exact, count, quick):
    """Error against milliseconds a map: plain CG stopped after k steps, the network, the network
    and j CG steps."""
    solver, parts = net.solver, torch.from_numpy(mu).to(torch.complex64).split(count)
    parts = parts[:2] if quick else parts[: max(1, 256 // count)]
    wanted = exact[: sum(len(part) for part in parts)]
    methods = {
        "cg": (lambda part, k: solver.solve(part, 0.0, k), range(1, 4 if quick else 11)),
        "network": (lambda part, k: net.refine(part, k), range(2 if quick else 7)),
    }
    result = {}
    for name, (method, steps) in methods.items():
        result[name] = []
        for k in steps:
            with torch.no_grad():
                maps = torch.cat([method(part, k) for part in parts]).numpy()
            relative = abs(maps - wanted).mean(1) / displacement(wanted, solver.mesh.z)
            times = [timed(lambda part=part, k=k, method=method: method(part, k), quick) for part in parts[:3]]
            result[name].append(
                {"steps": k, "ms": 1e3 * float(np.median(times)) / count, "error": float(relative.mean())}
            )
    return result


def routes(net, seeds, count):
    """Each route of the paper's network on its own mesh against its exact step.

    boundary: against the harmonic measure (steps 1 and 2 of the flux form); inner: against the
    Dirichlet solve with the network's own boundary (step 3); whole: against the exact map. Sums of
    distances over those of the identity from the exact map, on the circle or everywhere, as they
    come.
    """
    size = net.config.size
    disk = Disk(*square_disk(size))
    z, loop, factored = disk.z, net.loop.numpy(), DiskSolver(disk)
    rows = []
    for image in square_fields(seeds, count, size):
        mu = net.on_faces(torch.from_numpy(image)[None])[0].numpy()
        with torch.no_grad():
            f = net(torch.from_numpy(image).to(torch.complex64)[None])[0][0].numpy().astype(complex)
        exact = factored.solve(mu)
        inner = Dirichlet(disk.stiffness(mu), loop).solve(f[loop])
        distances = [abs(x).sum() for x in ((f - exact)[loop], f - inner, f - exact, (z - exact)[loop], z - exact)]
        rows.append([*distances, len(disk.certify(f).flipped) > 0])
    boundary, inside, whole, still_boundary, still, folded = np.mean(rows, axis=0).tolist()
    ratios = {"boundary": boundary / still_boundary, "inner": inside / still, "whole": whole / still}
    return ratios | {"folded_share": folded, "maps": len(rows)}


def square_fields(seeds, count, size):
    """Images of coefficients as the paper's network is trained on, from other seeds."""
    for seed in seeds:
        items = SquareFields(count, 900_000 + seed, size)
        for k in range(count):
            yield items[k][0].numpy().astype(complex)
