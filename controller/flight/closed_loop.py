"""Plant, policy, actuators, signals, delay and air as one loop y' = f(t, y, p).

Only this module knows how the loop is laid out:

    y = [x; actuators; memory of the policy; filter of the gust],
    p = [the plant's; the actuators'; the policy's; noise samples; the gust's; the delay's].
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.flight.actuators import Actuators
from controller.flight.gusts import Gust
from controller.flight.integrator import Constants, Method
from controller.flight.plants import UPDRAFT, Plant, Winds
from controller.policy.policies import Policy, Seen
from controller.policy.signals import TimeVector, zero
from hfa_support.errors import BadInputError

_NOTHING = np.zeros(0)


class Expressions(NamedTuple):
    """A loop at (t, y, p): y' and its observed parts: error z, inputs u, disturbance d, winds, command."""

    rate: ca.SX
    error: ca.SX
    inputs: ca.SX
    disturbance: ca.SX
    winds: ca.SX
    command: ca.SX


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """x' = plant(x, a, d(t), w(t)),  a' = actuators(a, u),  u = policy(t, x + n(t) - x_d(t)); a = u without actuators.

    reference x_d, disturbance d, noise n: (k,) signals of the states of the linear model, 0 by default. gust: the
    updraft, none by default. air: other disturbances of the model, name -> signal (1,). samples: (ticks, k), noise
    besides n that is held in each tick, none by default. actuators: about the inputs U0 (m,) of the trim. tick: s, at
    which the actuators' faults are looked up. delay: ticks by which every command comes late.
    """

    plant: Plant
    policy: Policy
    reference: TimeVector | None = None
    disturbance: TimeVector | None = None
    noise: TimeVector | None = None
    gust: Gust | None = None
    samples: np.ndarray | None = None
    actuators: Actuators | None = None
    trim: np.ndarray = field(default_factory=lambda: _NOTHING)
    tick: float = 0.0
    air: Mapping[str, TimeVector] = field(default_factory=dict)
    delay: int = 0

    def __post_init__(self) -> None:
        """Every signal has a channel for each state that is seen, and the actuators hold the trim."""
        sizes = self.plant.sizes
        if not self.trim.size:
            object.__setattr__(self, "trim", np.zeros(sizes.inputs))
        if self.actuators is not None:
            self.actuators.refuse_trim(self.trim)
        for name, signal in zip(("reference", "disturbance", "noise"), self._signals, strict=True):
            if signal.size != sizes.seen:
                raise BadInputError(f"the {name} has {signal.size} channels; it must have {sizes.seen}")

    @property
    def _signals(self) -> tuple[TimeVector, ...]:
        calm = zero(self.plant.sizes.seen)
        return tuple(calm if each is None else each for each in (self.reference, self.disturbance, self.noise))

    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """t, y and p to write the loop out in."""
        return ca.SX.sym("t"), ca.SX.sym("y", sum(self._y_sizes)), ca.SX.sym("p", sum(self._p_sizes))

    def at(self, t: ca.SX, y: ca.SX, p: ca.SX) -> Expressions:
        """The loop written out at CasADi expressions."""
        x, moved, memory, air = ca.vertsplit(y, [0, *np.cumsum(self._y_sizes).tolist()])
        parts = ca.vertsplit(p, [0, *np.cumsum(self._p_sizes).tolist()])
        of_plant, of_actuators, of_policy, sample, of_air, of_delay = parts
        reference, d, noise = (each.at(t) for each in self._signals)
        error = self.plant.seen(x) - reference
        if self.samples is not None:
            noise = noise + sample
        actuators = self.actuators
        position, speed = ca.SX(0, 1), ca.SX(0, 1)
        if actuators is not None:
            position, speed = actuators.position(moved, self.trim), actuators.rates(moved)
        winds = self.winds(t, y, p)
        moving_air = ca.SX(winds[UPDRAFT]) if UPDRAFT in winds else ca.SX(0, 1)
        seen = Seen(error + noise, self.plant.seen(x) + noise, position, speed, moving_air)
        command = arriving = self.policy.control(t, seen, memory, of_policy)
        if self.delay:
            begin, early, late = ca.vertsplit(of_delay, [0, 1, 1 + self.trim.size, 1 + 2 * self.trim.size])
            arriving = early + (late - early) * (t - begin) / self.tick
        reachable = arriving if actuators is None else actuators.reachable(arriving, self.trim)
        u = arriving if actuators is None else position
        rates = [self.policy.memory_rate(t, seen, memory, of_policy, reachable)]
        if actuators is not None:
            rates.insert(0, actuators.states_rate(moved, reachable, of_actuators))
        if self.gust is not None:
            rates.append(self.gust.memory_rate(t, air, of_air))
        rate_of_plant = self.plant.rate(x, u, d, winds, of_plant)
        blown = ca.vertcat(ca.SX(0, 1), *(winds[name] for name in self.wind_names))
        return Expressions(ca.vertcat(rate_of_plant, *rates), error, u, d, blown, command)

    @property
    def wind_names(self) -> tuple[str, ...]:
        """Disturbances of the model that are not 0."""
        return tuple(dict.fromkeys((*((UPDRAFT,) if self.gust is not None else ()), *self.air)))

    def winds(self, t: ca.SX, y: ca.SX, p: ca.SX) -> Winds:
        """Each of `wind_names` at (t, y, p)."""
        found = {name: signal.at(t) for name, signal in self.air.items()}
        if self.gust is not None:
            begin, end = np.cumsum(self._p_sizes)[3:5].tolist()
            gust = ca.SX(self.gust.updraft(t, y[sum(self._y_sizes[:-1]) :], p[begin:end]))
            found[UPDRAFT] = gust + found[UPDRAFT] if UPDRAFT in found else gust
        return found

    def start(self, initial: np.ndarray, memory: np.ndarray | None = None) -> np.ndarray:
        """y(0) for x(0) = `initial`, actuators at trim; memory: of the policy at the start, 0 unless given."""
        n, moved, k, _ = self._y_sizes
        own = np.zeros(k) if memory is None else memory
        if (np.shape(initial), np.shape(own)) != ((n,), (k,)):
            raise BadInputError(
                f"the flight starts with {np.size(initial) + np.size(own)} numbers; plant and policy have {n} and {k}"
            )
        return np.concatenate([initial, np.zeros(moved), own, _NOTHING if self.gust is None else self.gust.start()])

    def constants(self, of_policy: Constants, of_plant: np.ndarray = _NOTHING) -> Constants:
        """Tick -> p, in an array that the next call overwrites."""
        a, b, c, d, e, size = np.cumsum(self._p_sizes).tolist()
        p = np.zeros(size)
        p[:a] = of_plant

        def every(tick: int) -> np.ndarray:
            if self.actuators is not None:
                p[a:b] = self.actuators.constants(tick * self.tick)
            p[b:c] = of_policy(tick)
            if self.samples is not None:
                p[c:d] = self.samples[tick]
            if self.gust is not None:
                p[d:e] = self.gust.constants(tick)
            return p

        return every

    def parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and the memory of the policy in y (..., n)."""
        n, moved, k, _ = self._y_sizes
        return y[..., :n], y[..., n + moved : n + moved + k]

    @property
    def _y_sizes(self) -> tuple[int, int, int, int]:
        moved = 0 if self.actuators is None else self.actuators.size
        air = 0 if self.gust is None else self.gust.memory_size
        return self.plant.sizes.states, moved, self.policy.memory_size, air

    @property
    def _p_sizes(self) -> tuple[int, int, int, int, int, int]:
        moved = 0 if self.actuators is None else self.actuators.constants_size
        noise = self.plant.sizes.seen if self.samples is not None else 0
        air = 0 if self.gust is None else self.gust.constants_size
        late = 1 + 2 * self.trim.size if self.delay else 0
        return self.plant.constants_size, moved, self.policy.constants_size, noise, air, late


class Delayed:
    """A method whose ticks begin by handing the loop the commands of `delay` ticks ago, between which it interpolates.

    command: (t, y, p) -> (m,), taken at the beginning of each tick; before the delay has passed it is 0, the trim.
    handed: the end of p by tick. For one flight.
    """

    stretch = 1

    def __init__(self, method: Method, delay: int, command: Callable[..., ca.DM], size: int) -> None:
        self._method, self._delay, self._command, self._n = method, delay, command, size
        self.step, self.steps_per_tick, self.rows_per_tick = method.step, method.steps_per_tick, method.rows_per_tick
        self._sent: list[np.ndarray] = []
        self.handed: list[np.ndarray] = []

    def rows(self, tick: int, count: int, now: np.ndarray, p: np.ndarray) -> np.ndarray | None:
        """Rows of one tick."""
        begin = tick * self.steps_per_tick * self.step
        self._sent.append(np.array(self._command(begin, now[: self._n], p)).ravel())
        calm, due = np.zeros(self._sent[0].size), tick - self._delay
        early, late = (self._sent[due], self._sent[due + 1]) if due >= 0 else (calm, calm)
        self.handed.append(np.concatenate([[begin], early, late]))
        p[-self.handed[-1].size :] = self.handed[-1]
        return self._method.rows(tick, count, now, p)
