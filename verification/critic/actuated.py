"""Actuators in a game, found in its matrices: between an input and the rest, of first or second order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError


class ActuatorPlaces(NamedTuple):
    """positions: the state that each of the driven inputs moves; inputs: which; states: all that belong to them."""

    positions: tuple[int, ...]
    inputs: tuple[int, ...]
    states: tuple[int, ...]


def actuators_in(game: Game) -> ActuatorPlaces:
    """x_i' = a (u_k - x_i), or x_i' = x_j, x_j' = w² (u_k - x_i) - c x_j, where u_k moves nothing else."""
    positions, inputs, states = [], [], []
    for k, column in enumerate(game.B.T):
        moved = np.flatnonzero(column)
        if len(moved) != 1:
            continue
        last = int(moved[0])
        seen = set(np.flatnonzero(game.A[last]).tolist())
        driven = [last] if seen == {last} else sorted(seen - {last})
        first = driven[0] if len(driven) == 1 else -1
        follows = first == last or set(np.flatnonzero(game.A[first]).tolist()) == {last}
        if first >= 0 and follows and np.isclose(game.A[last, first], -column[last], rtol=1e-9):
            positions.append(first)
            inputs.append(k)
            states += sorted({first, last})
    return ActuatorPlaces(tuple(positions), tuple(inputs), tuple(states))


def at_once(game: Game, actuators: ActuatorPlaces) -> Game:
    """The game whose inputs act without delay: the positions are the inputs. BadInputError where it is none."""
    if len(actuators.inputs) != game.B.shape[1]:
        raise BadInputError("an input has no actuator")
    rest = [i for i in range(len(game.A)) if i not in actuators.states]
    return Game(
        A=game.A[np.ix_(rest, rest)],
        B=game.A[np.ix_(rest, actuators.positions)],
        E=game.E[rest],
        Q=game.Q[np.ix_(rest, rest)],
        R=game.R,
        delta=game.delta,
    )


def with_actuators(game: Game, bandwidth: float | np.ndarray, damping: float | Sequence[float | None] | None) -> Game:
    """The game behind actuators, x' = ω (u - x) or, with a damping, of second order: for all inputs, or one for each.

    Their states come last: a position for each input, then the rates of those of second order.
    """
    n, m = game.B.shape
    bandwidths = np.broadcast_to(bandwidth, m)
    dampings = damping if isinstance(damping, Sequence) else [damping] * m
    rates = [k for k in range(m) if dampings[k] is not None]
    A = np.zeros((n + m + len(rates),) * 2)
    Q, B, E = np.zeros_like(A), np.zeros((len(A), m)), np.zeros((len(A), game.E.shape[1]))
    A[:n, :n], A[:n, n : n + m], Q[:n, :n], E[:n] = game.A, game.B, game.Q, game.E
    for k, (speed, damped) in enumerate(zip(bandwidths, dampings, strict=True)):
        position = last = n + k
        if damped is None:
            A[last, position] = -speed
        else:
            last = n + m + rates.index(k)
            A[position, last] = 1.0
            A[last, [position, last]] = -(speed**2), -2.0 * damped * speed
        B[last, k] = -A[last, position]
    return replace(game, A=A, B=B, E=E, Q=Q)


def with_speed(game: Game, actuators: ActuatorPlaces, factor: float) -> Game:
    """The game with actuators `factor` times as fast."""
    A, B = game.A.copy(), game.B.copy()
    for position, k in zip(actuators.positions, actuators.inputs, strict=True):
        last = int(np.flatnonzero(B[:, k])[0])
        second = last != position
        A[last, position] *= factor**2 if second else factor
        B[last, k] *= factor**2 if second else factor
        A[last, last] *= factor if second else 1.0
    return replace(game, A=A, B=B)
