"""Plant, policy and signals as one loop y' = f(t, y, p), compiled, and the flight that it makes.

Nobody else knows how the loop is laid out:

    y = [x; memory of the policy; filter of the gust],   p = [the plant's; the policy's; noise samples; the gust's].
"""

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

#: Tick -> constants that are held during the tick.
Constants = Callable[[int], np.ndarray]

_NOTHING = np.zeros(0)
_Z = len(LINEAR_STATES)
#: Steps whose outputs are computed in one go.
_BLOCK = 10_000


class Expressions(NamedTuple):
    """A loop at (t, y, p): y' and what is seen of it; error z without noise, inputs u, disturbance d, updraft w."""

    rate: Any
    error: Any
    inputs: Any
    disturbance: Any
    updraft: Any


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """x' = plant(x, u, d(t), w(t)),  u = policy(t, x + n(t) - x_d(t)).

    reference x_d, disturbance d, noise n: (6,) signals of the states of the linear model. gust: w, none by default.
    samples: (ticks, 6), noise besides n that is held in each tick, none by default.
    """

    plant: Plant
    policy: Policy
    reference: TimeVector
    disturbance: TimeVector
    noise: TimeVector
    gust: Gust | None = None
    samples: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Every signal has six channels."""
        for name in ("reference", "disturbance", "noise"):
            size = getattr(self, name).size
            if size != _Z:
                raise BadInputError(f"the {name} has {size} channels; it must have {_Z}")

    def symbols(self) -> tuple[Any, Any, Any]:
        """t, y and p to write the loop out in."""
        return ca.SX.sym("t"), ca.SX.sym("y", self._y_ends[-1]), ca.SX.sym("p", self._p_ends[-1])

    def at(self, t: Any, y: Any, p: Any) -> Expressions:
        """The loop written out at CasADi expressions."""
        n, k, _ = self._y_ends
        a, b, c, _ = self._p_ends
        x, memory = y[:n], y[n:k]
        error = self.plant.seen(x) - self.reference.at(t)
        measured = error + self.noise.at(t)
        if self.samples is not None:
            measured += p[b:c]
        u = self.policy.control(t, measured, memory, p[a:b])
        d = self.disturbance.at(t)
        own_rate = self.policy.memory_rate(t, measured, memory, p[a:b])
        updraft = self.updraft(t, y, p)
        rates = [self.plant.rate(x, u, d, updraft, p[:a]), own_rate]
        if self.gust is not None:
            rates.append(self.gust.memory_rate(t, y[k:], p[c:]))
        return Expressions(ca.vertcat(*rates), error, u, d, ca.SX(updraft))

    def updraft(self, t: Any, y: Any, p: Any) -> Any:
        """w, ft/s; the number 0.0 in still air."""
        if self.gust is None:
            return 0.0
        return self.gust.updraft(t, y[self._y_ends[1] :], p[self._p_ends[2] :])

    def start(self, initial: np.ndarray, memory: np.ndarray | None = None) -> np.ndarray:
        """y(0) for x(0) = `initial`; memory: of the policy at the start, 0 unless given."""
        n, k, _ = self._y_ends
        own = np.zeros(k - n) if memory is None else memory
        if (len(initial), len(own)) != (n, k - n):
            raise BadInputError(
                f"the flight starts with {len(initial) + len(own)} numbers; plant and policy have {n} and {k - n}"
            )
        return np.concatenate([initial, own, _NOTHING if self.gust is None else self.gust.start()])

    def constants(self, of_policy: Constants, of_plant: np.ndarray = _NOTHING) -> Constants:
        """Tick -> p, in an array that the next call overwrites."""
        a, b, c, size = self._p_ends
        p = np.zeros(size)
        p[:a] = of_plant

        def every(tick: int) -> np.ndarray:
            p[a:b] = of_policy(tick)
            if self.samples is not None:
                p[b:c] = self.samples[tick]
            if self.gust is not None:
                p[c:] = self.gust.constants(tick)
            return p

        return every

    def parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and the memory of the policy in y (..., n)."""
        n, k, _ = self._y_ends
        return y[..., :n], y[..., n:k]

    @property
    def _y_ends(self) -> tuple[int, int, int]:
        sizes = len(self.plant.states), self.policy.memory_size, self.gust.memory_size if self.gust is not None else 0
        return sizes[0], sizes[0] + sizes[1], sum(sizes)

    @property
    def _p_ends(self) -> tuple[int, int, int, int]:
        noise = _Z if self.samples is not None else 0
        air = self.gust.constants_size if self.gust is not None else 0
        a, b, c, d = np.cumsum([self.plant.constants_size, self.policy.constants_size, noise, air]).tolist()
        return a, b, c, d


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


class CompiledLoop:
    """The loop as CasADi Functions of (t, y, p), compiled once, flown many times."""

    def __init__(self, loop: ClosedLoop) -> None:
        self.loop = loop
        arguments = loop.symbols()
        now = loop.at(*arguments)
        self.rate = ca.Function("loop_rate", [*arguments], [ca.densify(now.rate)], {"cse": True})
        seen = [ca.densify(part) for part in (now.error, now.inputs, now.disturbance, now.updraft)]
        self._seen = ca.Function("loop_seen", [*arguments], seen)
        self._updraft = ca.Function("loop_updraft", [*arguments], [now.updraft])

    def fly(
        self,
        initial: np.ndarray,
        constants: Constants,
        *,
        step: float,
        steps_per_tick: int,
        ticks: int,
        memory: np.ndarray | None = None,
        **options: Any,
    ) -> Flight:
        """Integrate from x(0) = `initial`, memory(0) = `memory`; constants: of the policy.

        The other arguments as in `integrator.integrate`.
        """
        start, every = self.loop.start(initial, memory), self.loop.constants(constants)
        path = integrate(self.rate, start, every, step=step, steps_per_tick=steps_per_tick, ticks=ticks, **options)
        # Row i of a tick's constants belongs to the steps that begin in that tick; the last row to the last tick.
        last = (len(path.times) - 1) // steps_per_tick - 1
        rows = np.minimum(np.arange(len(path.times)) // steps_per_tick, last)
        table = np.array([every(tick).copy() for tick in range(last + 1)]).reshape(last + 1, -1)[rows]
        errors, inputs, disturbances, updrafts = self._watched(path.times, path.states, table)
        states, own = self.loop.parts(path.states)
        return Flight(path.times, states, errors, inputs, disturbances, own, updrafts.ravel())

    def updrafts(self, times: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray | None:
        """w at times (N,) and rows y (N, n) under the constants p of one tick, (N,), ft/s; None in still air."""
        if self.loop.gust is None:
            return None
        return np.array(self._updraft.map(len(times))(times[None], y.T, np.tile(p[:, None], len(times)))).ravel()

    def _watched(self, times: np.ndarray, states: np.ndarray, constants: np.ndarray) -> tuple[np.ndarray, ...]:
        """Errors, inputs, disturbances and updrafts, a row a step, in blocks: one map of all steps takes a gigabyte."""
        blocks = []
        for begin in range(0, len(times), _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            many = self._seen.map(len(times[rows]))
            blocks.append([np.array(part).T for part in many(times[None, rows], states[rows].T, constants[rows].T)])
        return tuple(np.vstack(parts) for parts in zip(*blocks, strict=True))
