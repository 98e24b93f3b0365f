"""Plant, policy and signals as one compiled loop, and what it flies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from controller.integrator import integrate
from controller.plants import Plant
from controller.policies import Policy
from controller.signals import Signal
from hfa_model.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """x' = plant(x, u, d(t)),  u = policy(t, x + n(t) - x_d(t)).

    reference x_d, disturbance d, noise n: (6,) signals of the states of the linear model.
    """

    plant: Plant
    policy: Policy
    reference: Signal
    disturbance: Signal
    noise: Signal

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
    inputs: (N, 5), deviations. disturbances: (N, 6). memory: (N, k), the policy's own states.
    """

    times: np.ndarray
    states: np.ndarray
    errors: np.ndarray
    inputs: np.ndarray
    disturbances: np.ndarray
    memory: np.ndarray


class CompiledLoop:
    """The loop as CasADi Functions of (t, y, p), y = [x; memory]; compiled once, flown many times."""

    def __init__(self, loop: ClosedLoop) -> None:
        self.loop = loop
        n, k, m = len(loop.plant.states), loop.policy.memory_size, loop.policy.constants_size
        t, y, p = ca.SX.sym("t"), ca.SX.sym("y", n + k), ca.SX.sym("p", m)
        x, memory = y[:n], y[n:]
        error = loop.plant.seen(x) - loop.reference.at(t)
        measured = error + loop.noise.at(t)
        u = loop.policy.control(t, measured, memory, p)
        d = loop.disturbance.at(t)
        rate = ca.vertcat(loop.plant.rate(x, u, d), loop.policy.memory_rate(t, measured, memory, p))
        self.rate = ca.Function("loop_rate", [t, y, p], [ca.densify(rate)], {"cse": True})
        self._seen = ca.Function("loop_seen", [t, y, p], [ca.densify(error), ca.densify(u), ca.densify(d)])

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
        """Integrate from x(0) = `initial`, memory(0) = `memory`; arguments as in `integrator.integrate`."""
        plant_size, memory_size = len(self.loop.plant.states), self.loop.policy.memory_size
        start = np.concatenate([initial, np.zeros(memory_size) if memory is None else memory])
        if start.shape != (plant_size + memory_size,):
            raise BadInputError(
                f"the flight starts with {start.size} numbers; plant and policy have {plant_size} and {memory_size}"
            )
        path = integrate(self.rate, start, constants, step=step, steps_per_tick=steps_per_tick, ticks=ticks, **options)
        # Row i of a tick's constants belongs to the steps that begin in that tick; the last row to the last tick.
        rows = np.minimum(np.arange(len(path.times)) // steps_per_tick, ticks - 1)
        table = np.array([constants(tick) for tick in range(ticks)]).reshape(ticks, -1)[rows]
        seen = self._seen.map(len(path.times))(path.times[None, :], path.states.T, table.T)
        errors, inputs, disturbances = (np.array(part).T for part in seen)
        states, own = path.states[:, :plant_size], path.states[:, plant_size:]
        return Flight(path.times, states, errors, inputs, disturbances, own)
