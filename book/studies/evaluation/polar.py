"""The matrix-free solver on polar meshes: errors against closed forms, time against assembly and
SuperLU, growth."""

import time

import numpy as np
import torch

from qclearn.nets.polar import PolarSolver
from qclearn.plane.exactmaps import sliding, twist
from qclearn.plane.solver import DiskSolver

SIZES = ((32, 96), (64, 192), (128, 384), (256, 768), (512, 1536))
TOLERANCE = 1e-5


def random_coefficient(seed, z, largest=0.5):
    """Smooth random mu at points z: a polynomial in z and conj z, largest modulus as given."""
    rng = np.random.default_rng(seed)
    weights = rng.normal(size=16) + 1j * rng.normal(size=16)
    mu = sum(w * z ** (k // 4) * z.conj() ** (k % 4) for k, w in enumerate(weights))
    return largest * mu / abs(mu).max()


def figures(seeds, quick=False):
    """Errors, seconds a map in float64 on one thread, iterations, and the exponent of the cost in
    the vertices."""
    rows = [size_row(nr, nt, seeds[0], repeats=1 if quick else 5) for nr, nt in SIZES[: 2 if quick else None]]
    vertices, seconds = (np.log([row[key] for row in rows]) for key in ("vertices", "polar_seconds"))
    return {
        "sizes": rows,
        "exponent": float(np.polyfit(vertices, seconds, 1)[0]),
        "tolerance": TOLERANCE,
        "batches": batches(seeds[0], quick),
        "accelerator": accelerator(seeds[0], quick),
    }


def size_row(nr, nt, seed, repeats):
    """What one mesh shows; SuperLU up to 50,000 vertices."""
    solver = PolarSolver(nr, nt)
    z, centre = solver.mesh.z, solver.mesh.centroids
    row = {"nr": nr, "nt": nt, "vertices": len(z)}
    for name, closed in (("twist", twist(0.6)), ("sliding", sliding(0.5))):
        mu = torch.from_numpy(closed.mu(centre))
        points = np.where(z == 0, 1e-300, z)  # derivatives of `sliding` divide by |z|
        row[f"{name}_error"] = float(abs(solver.solve(mu, TOLERANCE).numpy() - closed(points)).max())
    mu = random_coefficient(seed, centre)
    row["polar_seconds"] = median_seconds(lambda: solver.solve(torch.from_numpy(mu), TOLERANCE), repeats)
    row["iterations"] = int(solver.iterations.max())
    if len(z) < 60_000:
        factored = DiskSolver(solver.mesh)
        _ = factored.calibration  # once a mesh
        row["superlu_seconds"] = median_seconds(lambda: factored.solve(mu), repeats)
        row["ratio"] = row["superlu_seconds"] / row["polar_seconds"]
        row["difference"] = float(abs(factored.f - solver.solve(torch.from_numpy(mu), TOLERANCE).numpy()).max())
    return row


def batches(seed, quick):
    """Milliseconds a map, float32, forward and backward, alone and in a batch, on the meshes of the
    networks."""
    rows = []
    for nr, nt in ((24, 72), (32, 96), (48, 144))[: 1 if quick else None]:
        solver = PolarSolver(nr, nt)
        centre = solver.mesh.centroids
        for count in (1, 8):
            fields = np.array([random_coefficient(seed + k, centre) for k in range(count)])
            mu = torch.from_numpy(fields).to(torch.complex64).requires_grad_()
            forward = median_seconds(lambda mu=mu, solver=solver: solver.solve(mu.detach(), TOLERANCE), 5)
            both = median_seconds(lambda mu=mu, solver=solver: solver.solve(mu, TOLERANCE).abs().sum().backward(), 5)
            rows.append(
                {
                    "nr": nr,
                    "nt": nt,
                    "batch": count,
                    "forward_ms": 1e3 * forward / count,
                    "backward_ms": 1e3 * (both - forward) / count,
                }
            )
    return rows


def accelerator(seed, quick):
    """Seconds for 1,000 maps of 12,289 vertices where there is an accelerator; None elsewhere."""
    if quick or not torch.accelerator.is_available():
        return None
    device, solver = torch.accelerator.current_accelerator(), PolarSolver(64, 192)
    centre = solver.mesh.centroids
    fields = np.array([random_coefficient(seed + k, centre) for k in range(50)])
    mu = torch.from_numpy(fields).to(device, torch.complex64)

    def run():
        for _ in range(20):
            solver.solve(mu, TOLERANCE)
        torch.accelerator.synchronize()

    return {"device": str(device), "maps": 1000, "vertices": len(solver.mesh.z), "seconds": median_seconds(run, 3)}


def median_seconds(function, repeats):
    """Median time of `function()`, after one call that does not count."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return float(np.median(times))
