"""Games of samples with commands under way, and of aircraft with servos."""

import math
import re

import numpy as np
import pytest
from cli import answer, assert_refused, hfa as run, refused
from scipy.linalg import eigh, expm

import hfa
from controller.game.held_game import held
from hfa_aircraft.signals import PlantNames

MODEL = hfa.with_servos(hfa.aircraft(), hfa.Servo(0.02))


def test_solve_prints_the_price_of_a_delay(folder):
    """Largest and mean ratio of z'Pz with and without the delay, by SciPy, without commands under way; and
    the further delay from which on the loop, by SciPy, is unstable.
    """
    words = ["solve", "--dihedral", "10", "--rate", "100", "--delay", "30ms"]
    said, data = run(*words).out, answer(*words, "-o", "late.json")
    linear = hfa.trim(hfa.aircraft(), dihedral=np.radians(10.0)).linearize()
    K, (n, m) = np.array(data["K"]), linear.B.shape

    def radius(further):
        """Return the spectral radius with a further delay of 2 samples and a part of the third."""
        x, *under_way = np.split(np.eye(n + 6 * m), range(n, n + 6 * m, m))  # the oldest first
        own = -K @ np.vstack([x, *under_way[3:]])
        for command, seconds in zip(under_way, (further - 0.02, 0.03 - further), strict=False):
            step = expm(np.block([[linear.A, linear.B], [np.zeros((m, n + m))]]) * seconds)[:n]
            x = step @ np.vstack([x, command])
        closed = np.vstack([x, *under_way[1:], own])
        return np.abs(np.linalg.eigvals(closed)).max()

    assert radius(0.999 * data["further_delay"]) < 1.0 < radius(1.001 * data["further_delay"])
    late, prompt = (hfa.solve(hfa.game(linear, rate=100.0, delay=late)).P for late in (0.03, 0.0))
    ratios = eigh(late[: len(prompt), : len(prompt)], prompt, eigvals_only=True)
    price = f"at most {ratios.max():.4g} times the optimum without, and {ratios.mean():.4g} times"
    assert price in " ".join(said.split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--delay 10ms", "requires a rate"),
        ("--delay 13ms --rate 100", "not a whole number of samples"),
        ("--delay 10mm --rate 100", "give a time in s"),
        ("--servo 0", "above 0"),
        ("--servo 20ms:-3", "above 0"),
        ("--rate 100 --order 2", "continuous time"),
    ],
)
def test_wrong_latencies_are_refused(words, said):
    """A delay without samples or between them, and a servo without a lag, are refused."""
    assert_refused(run("solve", "--dihedral", "10", *words.split()), 2, said)


def test_samples_in_which_doubles_lose_an_unstable_plant_are_refused_with_a_rate_that_they_keep():
    """The rate that the refusal gives is accepted, and its game has a value."""
    plant = hfa.Game([[2.0, 0.3], [0.1, -1.0]], [[1.0], [0.5]], Q=np.eye(2), R=[[1.0]])
    advised = re.search(r"at least (\S+) 1/s", refused(held, plant, 0.05))
    assert hfa.solve(held(plant, float(advised[1]))).P[0, 0] > 0.0


@pytest.mark.parametrize("count", [0, 2])
def test_the_held_game_costs_what_its_flight_costs(count):
    """A flight of a few samples, with held commands that act `count` samples late, has the states of
    the game, and the integral of the cost rate is the sum of the costs of its steps.
    """
    random = np.random.default_rng(3)
    A, B, E = (random.normal(size=(2, columns)) for columns in (2, 2, 1))
    names = PlantNames(("a", "b"), ("u", "v"), ("rad", "m"), ("N", "lbf"))
    weights = {"Q": np.diag([2.0, 1.0]), "R": np.diag([1.0, 3.0]), "N": np.full((2, 2), 0.2)}
    plant = hfa.Game(A, B, E=E, **weights, delta=5.0, names=names, half_widths=np.ones(2))
    game = held(plant, 10.0, 0.1 * count)
    assert (game.dt, game.delta) == (pytest.approx(0.1), pytest.approx(5.0 * 0.1**0.5))
    assert game.names.states == (
        "a",
        "b",
        *[f"{u}_{k}_before" for k in (2, 1)[2 - count :] for u in "uv"],
    )
    assert game.names.state_units == ("rad", "m", *["N", "lbf"] * count)
    assert (game.half_widths is None) == (count > 0)
    x, under_way = random.normal(size=2), [random.normal(size=2) for _ in range(count)]
    fine = 2000
    for _ in range(3):
        z, command = np.concatenate([x, *under_way]), random.normal(size=2)
        under_way.append(command)
        acting = under_way.pop(0)
        short = expm(np.block([[A, B], [np.zeros((2, 4))]]) * 0.1 / fine)
        path = [np.r_[x, acting]]
        for _ in range(fine):
            path.append(short @ path[-1])
        rates = np.einsum("ji,ik,jk->j", path, plant.weights, path)
        u = np.r_[z, command]
        assert u @ game.weights @ u == pytest.approx(np.trapezoid(rates, dx=0.1 / fine), rel=1e-6)
        x = path[-1][:2]
        np.testing.assert_allclose(game.A @ z + game.B @ command, np.concatenate([x, *under_way]))
    step = plant.sampled(0.1)
    np.testing.assert_allclose(game.E, np.pad(step.E, [(0, 2 * count), (0, 0)]))


def test_what_a_held_game_needs():
    """Without a rate, the game is the same; a delay needs a rate, and a whole number of samples."""
    plant = hfa.Game([[-1.0]], [[1.0]], Q=[1.0], R=[1.0])
    assert held(plant, None) is plant
    for given, said in (
        ((None, 0.1), "a delay of 0.1 s requires a rate"),
        ((0.0,), "rate is 0"),
        ((10.0, 0.25), "give 0.2 s, or another rate"),
        ((10.0, 0.04), "give 0.1 s, or another rate"),
        ((10.0, -0.1), "not a whole number of samples"),
        ((10.0, math.inf), "not a whole number of samples"),
    ):
        assert said in refused(held, plant, *given)
