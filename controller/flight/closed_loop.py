"""Plant, policy and signals as one compiled loop, and what it flies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.flight.gusts import Gust
from controller.flight.integrator import integrate
from controller.flight.plants import Plant
from controller.flight.policies import Policy
from controller.flight.signals import TimeVector
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES

#: Steps whose outputs are computed in one go.
_BLOCK = 10_000


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """x' = plant(x, u, d(t), w(t)),  u = policy(t, x + n(t) - x_d(t)).

    reference x_d, disturbance d, noise n: (6,) signals of the states of the linear model. gust: w, none by default.
    """

    plant: Plant
    policy: Policy
    reference: TimeVector
    disturbance: TimeVector
    noise: TimeVector
    gust: Gust | None = None

    def __post_init__(self) -> None:
        """Every signal has six channels."""
        for name in ("reference", "disturbance", "noise"):
            size = getattr(self, name).size
            if size != len(LINEAR_STATES):
                raise BadInputError(f"the {name} has {size} channels; it must have {len(LINEAR_STATES)}")


@dataclass(frozen=True)
class Flight:
    """What was flown, one row a step.

    times: (N,), s. states: (N, n) of the plant, deviations. errors: (N, 6), z = x - x_d, without noise.
    inputs: (N, 5), deviations. disturbances: (N, 6). memory: (N, k), the policy's own states. updrafts: (N,), ft/s.
    """

    times: np.ndarray
    states: np.ndarray
    errors: np.ndarray
    inputs: np.ndarray
    disturbances: np.ndarray
    memory: np.ndarray
    updrafts: np.ndarray


class Expressions(NamedTuple):
    """A loop at (t, y, p): y' and what is seen of it; error z without noise, inputs u, disturbance d, updraft w."""

    rate: Any
    error: Any
    inputs: Any
    disturbance: Any
    updraft: Any


def expressions(loop: ClosedLoop, t: Any, y: Any, p: Any) -> Expressions:
    """The loop written out, y = [x; memory; gust filter], p = [policy's; gust's constants], as CasADi expressions."""
    n, k, m = len(loop.plant.states), loop.policy.memory_size, loop.policy.constants_size
    x, memory, own = y[:n], y[n : n + k], p[:m]
    error = loop.plant.seen(x) - loop.reference.at(t)
    measured = error + loop.noise.at(t)
    u = loop.policy.control(t, measured, memory, own)
    d = loop.disturbance.at(t)
    own_rate = loop.policy.memory_rate(t, measured, memory, own)
    if loop.gust is None:
        return Expressions(ca.vertcat(loop.plant.rate(x, u, d), own_rate), error, u, d, ca.SX(0))
    of_the_air = t, y[n + k :], p[m:]
    updraft = loop.gust.updraft(*of_the_air)
    rate = ca.vertcat(loop.plant.rate(x, u, d, updraft), own_rate, loop.gust.memory_rate(*of_the_air))
    return Expressions(rate, error, u, d, updraft)


class CompiledLoop:
    """The loop as CasADi Functions of (t, y, p), y = [x; memory; gust filter], p = [policy's; gust's constants].

    Compiled once, flown many times.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        self.loop = loop
        n, k, m = len(loop.plant.states), loop.policy.memory_size, loop.policy.constants_size
        filters, noises = (loop.gust.memory_size, loop.gust.constants_size) if loop.gust is not None else (0, 0)
        arguments = ca.SX.sym("t"), ca.SX.sym("y", n + k + filters), ca.SX.sym("p", m + noises)
        now = expressions(loop, *arguments)
        self.rate = ca.Function("loop_rate", [*arguments], [ca.densify(now.rate)], {"cse": True})
        seen = [ca.densify(part) for part in (now.error, now.inputs, now.disturbance, now.updraft)]
        self._seen = ca.Function("loop_seen", [*arguments], seen)

    def fly(
        self,
        initial: np.ndarray,
        constants: Callable[[int], np.ndarray],
        *,
        step: float,
        steps_per_tick: int,
        ticks: int,
        memory: np.ndarray | None = None,
        **options: Any,
    ) -> Flight:
        """Integrate from x(0) = `initial`, memory(0) = `memory`; arguments as in `integrator.integrate`.

        constants: of the policy; the gust's are its own, and so is the start of its filter.
        """
        plant_size, memory_size = len(self.loop.plant.states), self.loop.policy.memory_size
        start = np.concatenate([initial, np.zeros(memory_size) if memory is None else memory])
        if start.shape != (plant_size + memory_size,):
            raise BadInputError(
                f"the flight starts with {start.size} numbers; plant and policy have {plant_size} and {memory_size}"
            )
        gust = self.loop.gust
        if gust is not None:
            start = np.concatenate([start, gust.start()])
        every = constants if gust is None else lambda tick: np.concatenate([constants(tick), gust.constants(tick)])
        path = integrate(self.rate, start, every, step=step, steps_per_tick=steps_per_tick, ticks=ticks, **options)
        # Row i of a tick's constants belongs to the steps that begin in that tick; the last row to the last tick.
        last = (len(path.times) - 1) // steps_per_tick - 1
        rows = np.minimum(np.arange(len(path.times)) // steps_per_tick, last)
        table = np.array([every(tick) for tick in range(last + 1)]).reshape(last + 1, -1)[rows]
        errors, inputs, disturbances, updrafts = self._watched(path.times, path.states, table)
        states, own, _ = np.split(path.states, [plant_size, plant_size + memory_size], axis=1)
        return Flight(path.times, states, errors, inputs, disturbances, own, updrafts.ravel())

    def _watched(self, times: np.ndarray, states: np.ndarray, constants: np.ndarray) -> tuple[np.ndarray, ...]:
        """Errors, inputs, disturbances and updrafts, a row a step, in blocks: one map of all steps takes a gigabyte."""
        blocks = []
        for begin in range(0, len(times), _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            many = self._seen.map(len(times[rows]))
            blocks.append([np.array(part).T for part in many(times[None, rows], states[rows].T, constants[rows].T)])
        return tuple(np.vstack(parts) for parts in zip(*blocks, strict=True))
