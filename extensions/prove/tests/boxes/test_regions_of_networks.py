"""Regions of networks by `hfa prove`: proved, checked and refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli import answer, assert_refused, hfa

from hfa import load_model, trim
from hfa_prove.problem import loop_at
from hfa_prove.search.region import proved_region
from hfa_prove.search.region_search import Region, RegionProblem
from hfa_prove.statements.loop import Gain

ROOT = Path(__file__).resolve().parents[4]
PENDULUM = f"{ROOT}/examples/pendulum.py:PENDULUM"
K = np.array([[1.97725, 0.97624]])
WEIGHTS = ("--aircraft", PENDULUM, "--Q", "1,1", "--R", "1")
CLOCK = """
import casadi as ca
from hfa import Model, Signal

def rates(x, u, p, w):
    return {"angle": x.rate, "rate": 0.4 * ca.fabs(x.rate) - 0.2 * x.rate - x.angle}, {}

CLOCK = Model("clock", {name: Signal("rad") for name in ("angle", "rate")}, {}, rates, trim={})
"""


def network(path: Path, scale: float = 0.1) -> tuple[str, ...]:
    """Write the network u = -tanh(scale K z) / scale, and return the options that give it."""
    np.savez(path, **{"0.weight": scale * K, "2.weight": [[-1.0 / scale]]})
    return "--weights", str(path), "--set", "activation=tanh", "--network", "policy="


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("boxes")
    words = (*WEIGHTS, *network(folder / "network.npz"), "--degree", "2", "--seconds", "3")
    assert hfa("prove", "region", *words, "-o", str(folder / "proved.json")).code == 0
    return folder / "proved.json"


@pytest.mark.slow
def test_a_region_of_a_network_is_verified(proved: Path, folder: Path) -> None:
    """The region is checked with its network, and refused with another one or without any."""
    check = ("prove", "--check", str(proved))
    own = network(folder / "network.npz")
    answer(*check, *WEIGHTS, *own)
    for words, said in (
        (network(folder / "other.npz", scale=0.2), "is about another policy"),
        (tuple(word.replace("=tanh", "=relu") for word in own), "is about another policy"),
        ((), "a policy in a file; give this file"),
    ):
        assert_refused(hfa(*check, *WEIGHTS, *words), 2, said)


def test_what_has_no_region_is_refused(folder: Path) -> None:
    """Recurrent networks, and a kink at the equilibrium, are named in one line."""
    names = ("weight_ih_l0", "weight_hh_l0", "bias_ih_l0", "bias_hh_l0")
    shapes = ((16, 2), (16, 4), (16,), (16,))
    arrays = {f"lstm.{name}": np.ones(shape) for name, shape in zip(names, shapes, strict=True)}
    np.savez("lstm.npz", **arrays, **{"out.weight": np.ones((1, 4)), "out.bias": np.zeros(1)})
    recurrent = ("--weights", "lstm.npz", "--set", "activation=tanh", "--network", "policy=")
    Path("clock.py").write_text(CLOCK)
    clock = ("--aircraft", "clock.py:CLOCK", "--degree", "2", "--seconds", "0.2")
    cases = [
        ((*WEIGHTS, *recurrent), 2, "lstm.weight_ih_l0"),
        (clock, 1, "kink in rate"),
        (("--dihedral", "10", "--limit", "speed=30:140"), 2, "34 ft/s to 136 ft/s"),
    ]
    for words, code, name in cases:
        found = hfa("prove", "region", *words, "-o", "no.json")
        assert (found.code, len(found.err.splitlines())) == (code, 1), found
        assert name in found.err
        assert not Path("no.json").exists()


def test_flights_from_the_edge_of_a_proved_region_converge() -> None:
    """Of a search that Ctrl-C ends, the region proved so far is returned: 200 flights from its edge
    stay in it and converge.
    """
    proved: list[Region] = []

    def interrupt(done: float, whole: float, text: str = "", /) -> None:
        if proved:
            raise KeyboardInterrupt

    linear = trim(load_model(PENDULUM)).linearize()
    problem = RegionProblem(loop_at(linear, Gain(K, {})))
    found = proved_region(problem, degree=2, seconds=60.0, progress=interrupt, save=proved.append)
    assert found.stopped == "interrupted"
    assert found.statement is proved[0].statement
    directions = np.random.default_rng(0).normal(size=(200, 2))
    edge = directions / np.sqrt(found.set.values(directions))[:, None]
    z = 0.999 * edge
    assert np.all(found.set.contains(z))
    assert not np.any(found.set.contains(1.001 * edge))
    for _ in range(2000):
        torque = np.clip(-z @ K[0], -0.7, 0.7)
        moment = torque + 0.15 * 9.81 * 0.5 * np.sin(z[:, 0]) - 0.1 * z[:, 1]
        rate = z[:, 1] + 0.005 * moment / (0.15 * 0.5**2)
        z = np.column_stack([z[:, 0] + 0.005 * rate, rate])
        assert np.all(found.set.values(z) < 1.01)
    assert np.all(np.abs(z) < 1e-3)
