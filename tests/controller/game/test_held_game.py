"""Games of samples with commands under way."""

import re

import numpy as np
import pytest
from cli import assert_refused, hfa as run, refused
from scipy.linalg import expm

import hfa
from controller.game.held_game import held
from hfa_aircraft.signals import PlantNames


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
