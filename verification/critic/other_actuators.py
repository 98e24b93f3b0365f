"""Answers of a plant whose actuators are not those of the game: critic and game are of different designs."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.errors import BadInputError, NoSolutionError
from verification.critic.actuated import Actuators, actuators_in, at_once, with_actuators
from verification.critic.other_games import difference_of, searched
from verification.riccati.gare_schur import quick_solution

#: rad/s; where the search for the bandwidth of actuators begins. The damping of those of second order.
BANDWIDTHS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
DAMPING = 0.7


def answers_with_other_actuators(game: Game, P: np.ndarray | None, K: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """What P, (n, n), or without one K, (m, n), may be, and the answer that this is."""
    actuators = actuators_in(game)
    if actuators.inputs:
        yield from _without_them(game, actuators, P is None)
        return
    n = len(game.A)
    for order, damping in (("first", None), ("second", DAMPING)):

        def answer_at(log_bandwidth: float, damping: float | None = damping) -> np.ndarray:
            there = with_actuators(game, math.exp(log_bandwidth), damping)
            found = quick_solution(there)
            return there.gain(found)[:, :n] if P is None else found[:n, :n]

        found = searched(answer_at, [math.log(each) for each in BANDWIDTHS], difference_of(game, P, K))
        if found is not None:
            damped = "" if damping is None else f", damping {damping:g}"
            said = f"the plant behind actuators of {order} order, bandwidth {math.exp(found):.4g} rad/s{damped}"
            yield f"{said}, without their states", answer_at(found)


def _without_them(game: Game, actuators: Actuators, of_gain: bool) -> Iterator[tuple[str, np.ndarray]]:
    """The answer of the plant whose inputs act at once, 0 for the states of the actuators."""
    try:
        simple = at_once(game, actuators)
        P = quick_solution(simple)
    except (BadInputError, NoSolutionError):
        return
    rest = [i for i in range(len(game.A)) if i not in actuators.states]
    padded = np.zeros(game.B.T.shape if of_gain else game.A.shape)
    if of_gain:
        padded[:, rest] = simple.gain(P)
    else:
        padded[np.ix_(rest, rest)] = P
    yield f"the plant without its actuators (states {_listed(actuators.states)})", padded


def without_positions(game: Game, K: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """The mistake, and K with the position of each input's actuator taken out of it."""
    actuators = actuators_in(game)
    positions = np.zeros_like(K)
    positions[actuators.inputs, actuators.positions] = 1.0
    if actuators.inputs:
        for sign, word in ((1.0, "u - position"), (-1.0, "u + position")):
            where = _listed(actuators.positions)
            yield (
                f"the columns of the actuators' positions (states {where}) are {sign:+g} off: the gain gives {word}",
                K - sign * positions,
            )


def _listed(states: tuple[int, ...]) -> str:
    return ", ".join(str(state + 1) for state in sorted(states))
