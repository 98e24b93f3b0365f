"""Answers of a plant whose actuators are not those of the game: critic and game are of different designs."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.gare_schur import quick_solution
from hfa_support.errors import BadInputError, NoSolutionError
from verification.critic.actuated import ActuatorPlaces, actuators_in, at_once, with_actuators
from verification.critic.other_games import difference_of, least, searched

#: rad/s; where the search for the bandwidth of actuators begins. The damping of those of second order.
BANDWIDTHS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
DAMPING = 0.7
#: What two actuators for all may leave of a difference that one for each is to explain, and what these may leave: five
#: bandwidths and orders come as near as 1e-4 to the gains of other ones.
_WORTH, _SURE = 0.3, 1e-7


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
    if P is None and len(K) > 1:
        yield from _one_for_each(game, K)


def _one_for_each(game: Game, K: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """The gain behind actuators that differ. Their orders: those of the best of both, then changed one by one."""
    difference = difference_of(game, None, K)

    def gain_at(logs: np.ndarray, dampings: tuple[float | None, ...]) -> np.ndarray:
        there = with_actuators(game, np.exp(logs), dampings)
        return there.gain(quick_solution(there))[:, : len(game.A)]

    def fitted(dampings: tuple[float | None, ...], starts: list[np.ndarray]) -> tuple[float, tuple, np.ndarray]:
        found = least(lambda logs: gain_at(logs, dampings), starts, difference)
        return (math.inf, dampings, starts[0]) if found is None else (found.left, dampings, found.at)

    m, far = len(K), float(np.linalg.norm(difference(game.gain(quick_solution(game)))))
    starts = [np.full(m, math.log(each)) for each in BANDWIDTHS]
    best = min((fitted((damping,) * m, starts) for damping in (None, DAMPING)), key=lambda fit: fit[0])
    if best[0] > _WORTH * far:
        return
    for k in (*range(m), *range(m)):
        if best[0] > _SURE:
            other = DAMPING if best[1][k] is None else None
            best = min(best, fitted((*best[1][:k], other, *best[1][k + 1 :]), [best[2]]), key=lambda fit: fit[0])
    if best[0] <= _SURE:
        each = zip(best[1], np.exp(best[2]), strict=True)
        orders = ", ".join(f"{'first' if damping is None else 'second'} {speed:.4g}" for damping, speed in each)
        said = f"actuators that differ: order and bandwidth in rad/s {orders}, damping {DAMPING:g} of the second"
        yield f"the plant behind {said}, without their states", gain_at(best[2], best[1])


def _without_them(game: Game, actuators: ActuatorPlaces, of_gain: bool) -> Iterator[tuple[str, np.ndarray]]:
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
