"""The networks in the browser's modules against those in torch, both with the half-precision weights of the site."""

from dataclasses import replace

import numpy as np
import pytest
from reference import numbers, pairs, run_engine

from qcbook.examples import example_problems
from qcbook.livefiles import cpnet_file
from qclearn.nets.cpnet import BestCPNetConfig
from qclearn.nets.weights import load
from qclearn.plane.coefficients import bounded
from qclearn.registration.problem import Problem, Weights


def halved(network):
    """The network with weights as the browser has them."""
    network.load_state_dict({name: value.half().float() for name, value in network.state_dict().items()})
    return network


def problems():
    """Landmarks with weights inside the trained ranges: the live page's first two problems, and scattered points."""
    rng, made = np.random.default_rng(5), []
    turn = np.exp(0.01j)  # off the spokes, where a point belongs to either triangle and rounding decides
    points = [(turn * example.problem.moving, turn * example.problem.target) for example in example_problems()[:2]]
    for _ in range(4):
        count = int(rng.integers(4, 59))
        p = 0.9 * np.sqrt(rng.random(count)) * np.exp(2j * np.pi * rng.random(count))
        c = 0.15 * rng.normal(size=4)
        q = p * np.exp(4j * c[0] * (1 - abs(p) ** 2)) + (1 - abs(p) ** 2) * (c[1] * p + 1j * c[2] * p.conj() + c[3] / 2)
        points.append((p, q / np.maximum(1, 1.02 * abs(q))))
    for k, (p, q) in enumerate(points):
        beta, gamma = (float(10 ** rng.uniform(*powers)) for powers in ((-4, 1), (0, 6)))
        weights = {"alpha": 1.0, "beta": beta, "gamma": gamma}
        made.append({"moving": pairs(p), "target": pairs(q), "looks": k % 3, **weights})
    return made


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    network = halved(load("cpnet"))
    file = tmp_path_factory.mktemp("networks") / "cpnet.bin"
    file.write_bytes(cpnet_file(network))
    return network, file


def test_cpnet_is_the_librarys(found, one_thread):
    """Without a look, and after one and two at its own mesh."""
    network, file = found
    mesh, asked = network.carrier(network.config.rings)[0].mesh, problems()
    network.config = replace(network.config, close=0.0, stiff=np.inf)  # the browser has one mesh for nu, and one start
    for one, answer in zip(asked, run_engine("cpnet", file=str(file), problems=asked)):
        problem = Problem(mesh, numbers(one["moving"]), numbers(one["target"]))
        weights = Weights(*(one[name] for name in ("alpha", "beta", "gamma")))
        *_, mu = network.stages(problem, weights, one["looks"])
        there = bounded(mesh.to_faces @ numbers(answer))
        assert abs(there - mu).max() < 1e-3 * abs(mu).max()


def test_both_leave_the_network_out_at_the_same_weights(found):
    _, file = found
    asked = [Weights(1.0, beta, ratio * beta) for beta in (1e-4, 1e-2, 1.0) for ratio in (1e3, 9e5, 1.1e6, 1e7)]
    answer = run_engine("stiff", file=str(file), weights=[{"beta": w.beta, "gamma": w.gamma} for w in asked])
    limit = BestCPNetConfig().stiff
    assert answer == [w.gamma >= limit * w.beta for w in asked] and len(set(answer)) == 2
