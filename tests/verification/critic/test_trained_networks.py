"""Networks fitted to the game at 15 deg by examples/train_a_network.py, right and with a mistake planted in each.

trained/: V, gradient and policy are 6-32-32-k; gamma_120, steps_of_0.1_s and at_8_deg are 6-16-16-5 policies of other
problems. All are tanh, float32, and take z / (7 ft/s, 0.1 rad, 0.1 rad/s).
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15, stored
from known_models import game_at
from network_files import torch_file
from planted_critics import gain, value

from controller import Game
from examples.train_a_network import fit
from hfa_cli.main import FAILED
from verification import check_critic, from_network, solve_game
from verification.critic.critic_check import LIMIT
from verification.critic.critic_errors import critic_errors, ordinary_box
from verification.critic.diagnosis import diagnose
from verification.critic.network_check import search

TRAINED = Path(__file__).parent / "trained"
BOX = np.array([7.0, *[0.1] * 5])
DEGREES = np.array([1.0, *[np.pi / 180.0] * 5])
ORDER = [0, 2, 1, 3, 5, 4]
SCALE = ",".join(map(str, 1.0 / BOX))
NETWORK = ("--set", "activation=tanh", "--set", f"scale={SCALE}")
pytestmark = pytest.mark.usefixtures("folder")


def layers(name: str, out: Any = 1.0, states: Any = slice(None), outputs: Any = slice(None)) -> dict[str, Any]:
    """The state dict with its outputs multiplied, its states and its outputs in another order."""
    with np.load(TRAINED / f"{name}.npz") as stored:
        found = dict(stored)
    first, *_, weight, bias = found
    found[first] = found[first][:, states]
    factors = np.broadcast_to(np.asarray(out, dtype="float32"), found[bias].shape)
    found[weight], found[bias] = (found[weight] * factors[:, None])[outputs], (found[bias] * factors)[outputs]
    return found


#: What was done to which network, how it is read, what must be named.
MISTAKES: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "outputs swapped": ({"name": "policy", "outputs": [0, 2, 1, 4, 3]}, {}, "inputs are in the order 1, 3, 2, 5, 4"),
    "slopes swapped": ({"name": "gradient", "outputs": [0, 2, 1, 4, 3, 5]}, {}, "slopes are in the order 1, 3, 2, 5"),
    "no input scaling": ({"name": "policy"}, {"scale": np.ones(6)}, "the states look scaled by 6.9"),
    "no input scaling, dV/dz": ({"name": "gradient"}, {"scale": np.ones(6)}, "the states look scaled by 6.9"),
    "ReLU for tanh": ({"name": "policy"}, {"activation": "relu"}, "the activation is tanh, not relu"),
    "ReLU for tanh, V": ({"name": "V"}, {"activation": "relu"}, "the activation is tanh, not relu"),
    "u = +K z": ({"name": "policy", "out": -1.0}, {}, "the gain has the wrong sign"),
    "gamma": ({"name": "gamma_120"}, {}, "this is the gain of another game, at delta = 1"),
    "degrees": ({"name": "policy"}, {"scale": DEGREES / BOX}, "states 2, 3, 4, 5 and 6 are in degrees"),
    "discrete time": ({"name": "steps_of_0.1_s"}, {}, "in discrete time, a step of 0.1"),
    "sign of V": ({"name": "V", "out": -1.0}, {}, "the value has the wrong sign"),
    "half cost": ({"name": "V", "out": 0.5}, {}, "the value is half the exact one"),
    "states permuted": ({"name": "policy", "states": ORDER}, {}, "the states are in the order 1, 3, 2, 4, 6, 5"),
    "no R": ({"name": "policy", "out": [10, 1000, 300, 400, 50]}, {}, "R⁻¹ is missing"),
    "another angle": ({"name": "at_8_deg"}, {}, "this is the gain of another game, at dihedral 8."),
}


@pytest.mark.parametrize(
    "mistake", [pytest.param(each, marks=[pytest.mark.slow] * (each == "ReLU for tanh, V")) for each in MISTAKES]
)
def test_a_planted_mistake_is_refused_and_named(game: Game, mistake: str) -> None:
    """`test_networks.py` turns what is refused and named into the verdict."""
    changes, how, words = MISTAKES[mistake]
    if mistake == "no R":
        changes = {**changes, "out": np.diag(game.R)}
    path = torch_file("critic.pt", layers(**changes))
    candidate = from_network(game, path, **({"activation": "tanh", "scale": 1.0 / BOX} | how))
    exact = solve_game(game)
    assert not all(check.ok for check in critic_errors(game, candidate, exact, LIMIT))
    assert words in diagnose(game, exact, candidate, LIMIT, game_at, BOX)


@pytest.mark.parametrize("name", ["policy", "V", pytest.param("gradient", marks=pytest.mark.slow)])
def test_the_right_networks_have_no_cause_but_what_v_hides(game: Game, name: str) -> None:
    candidate = from_network(game, torch_file("critic.pt", layers(name)), activation="tanh", scale=1.0 / BOX)
    found = diagnose(game, solve_game(game), candidate, LIMIT, None, BOX)
    assert found.startswith("V is near and its policy off by") if name == "V" else found == ""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["V", "policy", "gradient"])
def test_a_network_is_made_again_and_one_of_64_64_is_judged_within_5_seconds(game: Game, name: str) -> None:
    """The stored weights come from the example, but for what rounding makes of its steps."""
    again = fit(game, name, points=1500, steps=800)
    with np.load(TRAINED / f"{name}.npz") as kept:
        assert {key: each.shape for key, each in again.items()} == {key: each.shape for key, each in kept.items()}
    np.savez("again.npz", **again)
    errors = [
        check_critic(game, from_network(game, path, activation="tanh", scale=1.0 / BOX), flights=1).largest_error
        for path in ("again.npz", TRAINED / f"{name}.npz")
    ]
    assert errors[0] == pytest.approx(errors[1], rel=0.5)
    np.savez("wide.npz", **fit(game, name, hidden=(64, 64), points=200, steps=20))
    begin = time.process_time()
    found = answer("verify", *AT_15, "--weights", "wide.npz", *NETWORK, code=FAILED)
    assert time.process_time() - begin < 5.0
    assert (found["network"]["precision"], found["network"]["output"]) == ("float32", name)


@pytest.mark.parametrize("points", [4, pytest.param(8, marks=pytest.mark.slow)])
def test_the_search_finds_what_a_grid_finds(game: Game, points: int) -> None:
    """The errors of V and of the policy, at four or eight values of each state."""
    exact, b = solve_game(game), ordinary_box(game).half_widths
    z = np.array(np.meshgrid(*[np.linspace(-1.0, 1.0, points)] * 6)).reshape(6, -1) * b[:, None]
    largest = np.sqrt(game.R.diagonal()) * (np.abs(exact.K) @ b)
    u_size = np.maximum(largest, 1e-5 * largest.max()) / np.sqrt(game.R.diagonal())
    for name in ("V", "policy"):
        about = from_network(game, TRAINED / f"{name}.npz", activation="tanh", scale=1.0 / BOX).nonlinear
        assert about is not None
        errors = {"policy": (about.policy(game) + ca.DM(exact.K) @ about.z) / ca.DM(u_size)}
        if about.V is not None:
            exact_V = ca.bilin(ca.DM(exact.P), about.z, about.z)
            errors["value"] = (about.V - about.constant - exact_V) / (b @ np.abs(exact.P) @ b)
        found = {each.name: each.error for each in search(game, about, exact, b)[1]}
        for kind, error in errors.items():
            on_grid = np.array(ca.Function(kind, [about.z], [error])(z))
            assert found[kind] * (1.0 + 1e-9) >= np.abs(on_grid).max()


def test_several_critics_and_a_folder_of_checkpoints_are_in_one_table_and_a_learning_curve(game: Game) -> None:
    Path("runs").mkdir()
    for step, share in ((2, 3.0), (10, 1.5)):
        np.savez(f"runs/step_{step}.npz", **layers("gamma_120", out=share))
    right, twice = torch_file("right.pt", {"weight": -gain(game) * BOX}), stored("P.npz", P=2 * value(game))
    said = hfa("verify", *AT_15, "--weights", "runs", right, twice, *NETWORK, "-o", "a.json", "--picture", "curve.png")
    assert said.code == FAILED
    found = json.loads(Path("a.json").read_text(encoding="utf-8"))["critics"]
    names = ["runs/step_2.npz", "runs/step_10.npz", right, twice]
    assert list(found) == names
    assert [each["ok"] for each in found.values()] == [False, False, True, False]
    assert found[names[0]]["K_rel_error"] > found[names[1]]["K_rel_error"]
    assert said.out.startswith("1 of 4 critics on the aircraft at dihedral 15 deg")
    assert "\nP.npz: the value is twice the exact one" in said.out
    assert Path("curve.png").stat().st_size > 10_000
