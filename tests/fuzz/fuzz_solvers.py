"""Random and extreme problems for the solvers, each claim of a bijection checked again in exact arithmetic.

    python tests/fuzz/fuzz_solvers.py {beltrami,conformal,fit,register} 1000 --seed 7

A case is (kind, seed, number) and is made again from them. Each runs in a forked process with 120 s and 6 GiB of
addresses. Verdicts: certified, folded (and said so), refused (one of the library's own errors), and the faults: false
(claimed bijective, fractions refute it), worse (a fit or a registration above the best Moebius map), silent (not
finite), raw (another exception), hang, crash.
"""

import argparse
import multiprocessing
import resource
import warnings
from collections import Counter
from fractions import Fraction
from unittest.mock import patch

import numpy as np
from scipy.spatial import Delaunay

import qclearn as qc
from qclearn.plane.disk import Disk
from qclearn.registration.fit import ROUNDING
from qclearn.registration.problem import Problem

SECONDS, ADDRESSES = 120, 6 << 30
FAULTS = {"false", "worse", "silent", "raw", "hang", "crash"}
OWN = (qc.SurfaceError, qc.LandmarkError, qc.BeltramiError, qc.BijectivityError)


def turns(a, b, c):
    """Exact signs of the turns a, b, c (complex arrays): floats where they are beyond doubt, fractions elsewhere."""
    left, right = (b - a).real * (c - a).imag, (b - a).imag * (c - a).real
    size = np.abs(np.stack([a, b, c])).max(axis=0)
    sides = np.maximum(abs(b - a), abs(c - a))
    sign = np.sign(left - right).astype(int)
    for k in np.flatnonzero(~(abs(left - right) > 1e-14 * sides * (size + sides))):
        (ax, ay), (bx, by), (cx, cy) = ((Fraction(float(p[k].real)), Fraction(float(p[k].imag))) for p in (a, b, c))
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        sign[k] = (area > 0) - (area < 0)
    return sign


def is_embedding(faces, f):
    """Exactly: every face keeps its orientation, and no two edges of the rim meet but neighbours."""
    if not (turns(*f[faces].T) > 0).all():
        return False
    w = f[Disk(f, faces).loop]
    i, j = np.triu_indices(len(w), 2)  # edges that are no neighbours
    apart = (i > 0) | (j < len(w) - 1)
    i, j, after = i[apart], j[apart], np.roll(w, -1)
    for part in (w.real, w.imag):  # whose boxes meet
        low, high = np.minimum(part, np.roll(part, -1)), np.maximum(part, np.roll(part, -1))
        meet = (low[i] <= high[j]) & (low[j] <= high[i])
        i, j = i[meet], j[meet]
    one = turns(w[i], after[i], w[j]) * turns(w[i], after[i], after[j])
    two = turns(w[j], after[j], w[i]) * turns(w[j], after[j], after[i])
    return not ((one <= 0) & (two <= 0)).any()


def disk(rng, low, high):
    """A triangulated disk (z, faces): rim even, random or in clusters, inside even, at the rim or in clumps."""
    while True:
        n = int(np.exp(rng.uniform(np.log(low), np.log(high))))
        on_rim = rng.choice([rng.uniform(size=n), rng.beta(0.4, 0.4, n), np.arange(n) / n])
        angles = np.sort(on_rim[:: max(1, int(np.sqrt(n) / 4))])
        inner = np.sqrt(rng.uniform(size=n)) if rng.random() < 0.6 else 1 - 10.0 ** rng.uniform(-5, -0.1, n)
        points = inner * np.exp(2j * np.pi * rng.uniform(size=n))
        if rng.random() < 0.3:
            points = 0.5 * points[rng.integers(0, 5, n)] + 10.0 ** rng.uniform(-5, -1, n) * points
        z = np.concatenate([np.exp(2j * np.pi * np.unique(angles)), points])
        faces = Delaunay(np.stack([z.real, z.imag], axis=1)).simplices
        signs = turns(*z[faces].T)
        faces = np.where((signs < 0)[:, None], faces[:, ::-1], faces)[signs != 0]
        used, corners = np.unique(faces, return_inverse=True)
        z, corners = z[used], corners.reshape(-1, 3)
        surface = qc.Surface(np.stack([z.real, z.imag, 0 * z.real], axis=1), corners)
        try:
            qc.require_disk(surface)
        except qc.SurfaceError:
            continue
        if np.abs(abs(z[surface.boundary]) - 1).max() < 1e-12 and is_embedding(corners, z):
            return z, corners


def beltrami_case(rng):
    z, faces = disk(rng, 30, 3000)
    size, centre, count = rng.choice([0.1, 0.5, 0.9, 0.99]), z[faces].mean(axis=1), len(faces)
    random = np.sqrt(rng.uniform(size=count)) * np.exp(2j * np.pi * rng.uniform(size=count))
    rim = abs(centre) ** 6 * np.exp(2j * np.angle(centre))
    mu = size * rng.choice([np.ones(count), np.exp(4j * centre.real), random, rim])
    f = qc.solve_beltrami_disk(z, faces, mu)
    return faces, f, qc.check_bijective(z, faces, f).bijective, False


def cap(z, angle):
    """Points of the unit sphere over a disk (complex), the rim at an angle from the pole."""
    q = abs(z) * angle
    return np.stack([np.sin(q) * np.cos(np.angle(z)), np.sin(q) * np.sin(np.angle(z)), np.cos(q)], 1)


def lifted(rng, z):
    """Points in space over a disk: hills, a roll, a tongue, a bulb, noise, tiny, huge or far away."""
    x, y, kind = z.real, z.imag, rng.integers(8)
    hills = sum(rng.normal() * np.sin(rng.normal() * 6 * x + rng.normal() * 6 * y) for _ in range(5))
    t, bulb = rng.uniform(2, 20) * (x + 1.5), cap(z, np.pi * rng.uniform(0.5, 0.999))
    plain, roll = np.stack([x, y, hills], 1), np.stack([t * np.cos(t), t * np.sin(t), 3 * y], 1)
    tongue, noisy = plain * [10.0 ** rng.uniform(1, 4), 1, 0.1], plain + rng.normal(size=plain.shape) * 0.3
    tiny, huge, far = 10.0 ** -rng.uniform(3, 150), 10.0 ** rng.uniform(3, 150), 10.0 ** rng.uniform(2, 12)
    return [plain, roll, tongue, bulb, noisy, plain * tiny, plain * huge, plain + far][kind]


def conformal_case(rng):
    z, faces = disk(rng, 50, 5000)
    return faces, qc.disk_conformal_map(qc.Surface(lifted(rng, z), faces)), True, False


def fit_case(rng):
    z, faces = disk(rng, 150, 2000)
    m, kind = int(rng.integers(1, 30)), rng.integers(6)
    p, far = 0.9 * np.sqrt(rng.uniform(size=(2, m))) * np.exp(2j * np.pi * rng.uniform(size=(2, m)))
    twist = p * np.exp(2j * (1 - abs(p)) * rng.uniform(0.5, 4))
    q = [p + 0.03 * np.exp(3j * p.real), twist, rng.permutation(p), -p, 0.01 * p, far][kind]
    fit = qc.fit_landmarks(z, faces, p, q, gamma=10.0 ** rng.uniform(2, 8))
    return faces, fit.f, fit.bijective, above(Problem(Disk(z, faces), p, q), fit.f)


def above(problem, f):
    """Whether the mean squared landmark distance exceeds that of the best Moebius map, where that is a bijection."""
    plain = qc.mobius(problem.disk.z, *problem.mobius)
    best, found = ((abs(problem.samples @ w - problem.target) ** 2).mean() for w in (plain, f))
    return bool(found > best * (1 + ROUNDING) + 1e-24) and is_embedding(problem.disk.faces, plain)


def register_case(rng):
    sides = []
    for _ in range(2):
        z, faces = disk(rng, 200, 1200)
        points = 50 * (1 + 0.1 * np.sin(5 * rng.normal() * z.real))[:, None] * cap(z, 2.2)
        surface = qc.Surface(points, faces)
        sides.append(surface if surface.volume > 0 else qc.Surface(points * [1, 1, -1], faces[:, ::-1]))
    curves, rims = [], rng.random() < 0.2
    for k in range(int(rng.integers(1, 6))):
        choices = [side.boundary if rims else len(side.vertices) for side in sides]
        moving, control = (rng.choice(choice, 2, replace=False).tolist() for choice in choices)
        curves.append({"name": f"c{k}", "moving": moving, "control": control})
    problems = []  # of landmarks, as they are stated
    with patch("qclearn.registration.start.Problem", lambda *a, **k: problems.append(Problem(*a, **k)) or problems[-1]):
        result = qc.register(*sides, {"curves": curves}, features=None, accept_suspect=True)
    return (sides[0].faces, result.disk_map, result.report["bijective"], above(problems[-1], result.disk_map))


CASES = {"beltrami": beltrami_case, "conformal": conformal_case, "fit": fit_case, "register": register_case}


def verdict(kind, seed, number):
    """(verdict, text) of one case in this process."""
    rng = np.random.default_rng([list(CASES).index(kind), seed, number])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            faces, f, claim, worse = CASES[kind](rng)
    except OWN as error:
        return "refused", f"{type(error).__name__}: {error}"
    except Exception as error:
        return "raw", repr(error)
    if not np.isfinite(f).all():
        return "silent", "not finite"
    if claim and not is_embedding(faces, np.asarray(f, complex)):
        return "false", "claimed bijective"
    return ("worse" if worse else "certified" if claim else "folded"), ""


def limited(send, *case):
    """Send the verdict of a case within the limit of addresses."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    send.send(verdict(*case))


def forked(*case):
    """`verdict` in a process with limits; ("hang", "") or ("crash", "") without it."""
    receive, send = multiprocessing.get_context("fork").Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=limited, args=(send, *case))
    child.start()
    send.close()
    try:
        return receive.recv() if receive.poll(SECONDS) else ("hang", "")
    except EOFError:
        return "crash", ""
    finally:
        child.kill()
        child.join()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=CASES)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    options, count = parser.parse_args(), Counter()
    for number in range(options.count):
        found, text = forked(options.kind, options.seed, number)
        count[found] += 1
        if found in FAULTS:
            print(number, found, text[:300], flush=True)
    print(dict(count))
    raise SystemExit(bool(FAULTS & set(count)))


if __name__ == "__main__":
    main()
