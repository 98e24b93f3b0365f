"""Arrays of pandas and xarray as arguments: rows and columns are aligned by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pandas
import pytest
import xarray

import hfa
from hfa import BadInputError, Game, OperatingPoint, Solution


@cache
def _point() -> OperatingPoint:
    model = hfa.aircraft()
    return hfa.trim(model, hfa.paper.level_flight(0.2))


@cache
def _solution() -> Solution:
    return hfa.solve(hfa.paper.published_game(_point().linearize()))


def _gain() -> pandas.DataFrame:
    """Return the exact gain with inputs and states in reverse order."""
    linear = _point().linearize()
    gain = pandas.DataFrame(np.array(_solution().K), linear.inputs, linear.states)
    return gain.iloc[::-1, ::-1]


def _data_array(table: pandas.DataFrame) -> xarray.DataArray:
    return xarray.DataArray(table, dims=("input", "state"))


@pytest.mark.parametrize("form", [pandas.DataFrame, _data_array])
def test_gains_are_aligned_by_name(form: Callable[..., Any]) -> None:
    """A gain with labels in another order is checked and flown like the gain in the plant's order.

    Read by position, the same numbers fail.
    """
    game = _solution().game
    gain = form(_gain())
    assert hfa.verify(game, gain).ok
    assert hfa.verify(game, K=gain).ok
    assert np.array_equal(hfa.from_gain(game, gain).K, _solution().K)
    assert not hfa.verify(game, gain.to_numpy()).ok
    linear = _point().linearize()
    assert linear.margins(gain) == linear.margins(_solution().K)
    assert np.array_equal(linear.closed_loop(gain).A, linear.closed_loop(_solution().K).A)
    flights = [
        hfa.fly(_point(), each, initial={"alpha": 0.01}, duration=0.5, predict=False)
        for each in (gain, _solution().K)
    ]
    assert np.array_equal(*(flight.states for flight in flights))


def test_weights_and_initial_states_are_aligned_by_name() -> None:
    """Labeled weights and initial states are aligned with the states by name.

    A state without a weight has the weight 0.
    """
    linear = _point().linearize()
    weights = pandas.Series({name: 1.0 + i for i, name in enumerate(reversed(linear.states))})
    expected = np.arange(6.0, 0.0, -1.0)
    table = pandas.DataFrame(np.diag(weights), weights.index, weights.index)
    for Q in (weights, table):
        for game in (hfa.Game(linear, Q=Q, R=np.ones(5)), hfa.game(linear, Q, np.ones(5))):
            assert np.array_equal(game.Q.diagonal(), expected)
    assert hfa.game(linear, weights[:2], np.ones(5)).Q.diagonal().tolist() == [0, 0, 0, 0, 2, 1]
    initial = pandas.Series({"alpha": 0.01})
    flight = hfa.fly(_point(), _gain(), initial=initial, duration=0.1, predict=False)
    assert flight["alpha"][0] == pytest.approx(_point()["alpha"] + 0.01)


def test_labels_of_a_plant_name_its_states() -> None:
    """The labels of A and B are the names of the game, in the order of the rows of A."""
    linear = _point().linearize()
    A = pandas.DataFrame(np.array(linear.A), linear.states, linear.states).iloc[:, ::-1]
    B = pandas.DataFrame(np.array(linear.B), linear.states, linear.inputs).iloc[::-1]
    weights = _solution().game
    game = Game(A, B, Q=weights.Q, R=weights.R, delta=200.0)
    assert np.array_equal(game.A, linear.A)
    assert np.array_equal(game.B, linear.B)
    assert game.names.states == linear.states
    assert hfa.verify(game, _gain()).ok
    for made in (hfa.LinearModel(A, B), hfa.LinearModel(A, B, states=linear.states)):
        assert np.array_equal(made.A, linear.A)
        assert made.states == linear.states
    Q, R = pandas.DataFrame(weights.Q, A.index, A.index), weights.R
    assert np.array_equal(hfa.lqr(A, B, Q.iloc[::-1], R).K, hfa.lqr(linear, weights.Q, R).K)


def test_default_labels_are_read_by_position() -> None:
    """Arrays with default labels are read by position, and inputs with names in any order."""
    linear = _point().linearize()
    gain = pandas.DataFrame(np.array(_solution().K))
    assert hfa.verify(_solution().game, gain).ok
    times = np.linspace(0.0, 1.0, 11)
    steps = pandas.DataFrame(np.eye(5)[[0] * 11], times, linear.inputs)
    expected = linear.simulate({"throttle": np.ones(11)}, times).outputs
    for u in (steps, steps.iloc[:, ::-1]):
        assert linear.simulate(u, times).outputs == pytest.approx(expected)


def test_wrong_labels_are_refused_by_name() -> None:
    """Unknown, missing and repeated labels and transposed arrays are refused."""
    game = _solution().game
    gain = _gain()
    unnamed = Game(np.eye(2), np.eye(2), Q=np.eye(2), R=np.eye(2))
    for wrong, said in (
        (lambda: hfa.verify(game, gain.rename(columns={"alpha": "alfa"})), "unknown label 'alfa'"),
        (lambda: hfa.verify(game, K=gain.drop(columns="alpha")), "K has no label 'alpha'"),
        (lambda: hfa.verify(game, gain.iloc[:, [0, 0, 1, 2, 3, 4]]), "no label 'speed'"),
        (lambda: hfa.verify(game, gain.T), "such as the transpose of K"),
        (lambda: hfa.verify(game, pandas.DataFrame(gain.to_numpy(), [4, 3, 2, 1, 0])), "by name"),
        (lambda: hfa.verify(unnamed, gain), "unknown label"),
        (lambda: Game(np.eye(1), np.eye(1), Q=pandas.Series({"a": 1.0}), R=[1.0]), "no argument"),
    ):
        with pytest.raises(BadInputError, match=said):
            wrong()
