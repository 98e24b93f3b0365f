"""Plant, policy and scenario as one loop y' = f(t, y, p). Only this module knows how the loop is laid out:

y = [x; actuators; memory of the policy; filter of the gust],
p = [the plant's; the actuators'; the policy's; noise samples; the gust's; the delay's].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.flight.plants import UPDRAFT, Plant
from controller.flight.scenario import Scenario
from controller.policy.policies import GainPolicy, Policy, Seen
from controller.policy.signals import zero
from hfa_support.errors import BadInputError

#: Tick -> constants that are held during the tick.
Constants = Callable[[int], np.ndarray]
_NOTHING = np.zeros(0)


class Expressions(NamedTuple):
    """A loop at (t, y, p): y', and what is observed: error z, inputs u, disturbance d, winds, alpha through the air as
    a deviation where it is not alpha, and the command of the policy."""

    rate: ca.SX
    error: ca.SX
    inputs: ca.SX
    disturbance: ca.SX
    winds: ca.SX
    angle: ca.SX
    command: ca.SX


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """x' = plant(x, a, d(t), w(t)),  a' = actuators(a, u),  u = policy(t, x + n(t) - x_d(t)); a = u without actuators.

    scenario: x_d, d and n (0 unless given), noise samples, gust, other disturbances, actuators and delay. trim: U0,
    (m,), 0 unless given. BadInputError when a signal or a gain has another size than the plant, or an actuator cannot
    hold the trim.
    """

    plant: Plant
    policy: Policy
    scenario: Scenario = field(default_factory=Scenario)
    trim: np.ndarray = field(default_factory=lambda: _NOTHING)

    def __post_init__(self) -> None:
        """Sizes fit, and the actuators hold the trim."""
        _, k, m = self.plant.sizes
        if not self.trim.size:
            object.__setattr__(self, "trim", np.zeros(m))
        if self.scenario.actuators is not None:
            self.scenario.actuators.refuse_trim(self.trim)
        policy, noise = self.policy, self.scenario.samples
        if isinstance(policy, GainPolicy) and (policy.inputs, policy.states) != (m, k):
            raise BadInputError(
                f"the gain has shape {policy.inputs, policy.states}; this aircraft takes {m} x {k}, inputs by states"
            )
        for name in ("reference", "disturbance", "noise"):
            signal = getattr(self.scenario, name)
            if signal is not None and signal.size != k:
                raise BadInputError(f"the {name} has {signal.size} channels; it must have {k}")
        moved, gust, late = self.scenario.actuators, self.scenario.gust, self.scenario.delayed_ticks
        y = (self.plant.sizes.states, moved.size if moved else 0, policy.memory_size, gust.memory_size if gust else 0)
        fixed = (self.plant.constants_size, moved.constants_size if moved else 0, policy.constants_size)
        p = (*fixed, 0 if noise is None else k, gust.constants_size if gust else 0, 1 + 2 * m if late else 0)
        for name, sizes in (("_y", y), ("_p", p)):
            object.__setattr__(self, name, [0, *np.cumsum(sizes).tolist()])

    _y: list[int] = field(init=False, repr=False)
    _p: list[int] = field(init=False, repr=False)

    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """t, y and p to write the loop out in."""
        return ca.SX.sym("t"), ca.SX.sym("y", self._y[-1]), ca.SX.sym("p", self._p[-1])

    def at(self, t: ca.SX, y: ca.SX, p: ca.SX) -> Expressions:
        """The loop written out at CasADi expressions."""
        scenario, plant, actuators = self.scenario, self.plant, self.scenario.actuators
        x, moved, memory, filtered = ca.vertsplit(y, self._y)
        of_plant, of_actuators, of_policy, sample, of_air, of_delay = ca.vertsplit(p, self._p)
        signals = (scenario.reference, scenario.disturbance, scenario.noise)
        reference, d, noise = ((each or zero(plant.sizes.seen)).at(t) for each in signals)
        error = plant.seen(x) - reference
        if sample.numel():
            noise = noise + sample
        position, speed, winds = ca.SX(0, 1), ca.SX(0, 1), {}
        if actuators is not None:
            position, speed = actuators.position(moved, self.trim), actuators.rates(moved)
        rates = []
        if scenario.gust is not None:
            winds[UPDRAFT] = ca.SX(scenario.gust.updraft(t, filtered, of_air))
            rates.append(scenario.gust.memory_rate(t, filtered, of_air))
        for name, signal in scenario.air.items():
            winds[name] = winds.get(name, 0.0) + signal.at(t)
        updraft = ca.SX(winds[UPDRAFT]) if UPDRAFT in winds else ca.SX(0, 1)
        seen = Seen(error + noise, plant.seen(x) + noise, position, speed, updraft)
        command = arriving = self.policy.control(t, seen, memory, of_policy)
        if of_delay.numel():
            begin, early, late = ca.vertsplit(of_delay, [0, 1, 1 + self.trim.size, 1 + 2 * self.trim.size])
            arriving = early + (late - early) * (t - begin) / scenario.tick
        reachable = arriving if actuators is None else actuators.reachable(arriving, self.trim)
        u = arriving if actuators is None else position
        rates.insert(0, self.policy.memory_rate(t, seen, memory, of_policy, reachable))
        if actuators is not None:
            rates.insert(0, actuators.states_rate(moved, reachable, of_actuators))
        rate = ca.vertcat(plant.rate(x, u, d, winds, of_plant), *rates)
        blown = ca.vertcat(ca.SX(0, 1), *winds.values())
        return Expressions(rate, error, u, d, blown, plant.through_air(x, winds), command)

    @property
    def wind_names(self) -> tuple[str, ...]:
        """Disturbances of the model that are not 0."""
        return tuple(dict.fromkeys((*((UPDRAFT,) if self.scenario.gust is not None else ()), *self.scenario.air)))

    def start(self, initial: np.ndarray, memory: np.ndarray | None = None) -> np.ndarray:
        """y(0) for x(0) = `initial`, actuators at trim; memory: of the policy at the start, 0 unless given."""
        n, k = self._y[1], self.policy.memory_size
        own = np.zeros(k) if memory is None else memory
        if (np.shape(initial), np.shape(own)) != ((n,), (k,)):
            raise BadInputError(
                f"the flight starts with {np.size(initial) + np.size(own)} numbers; plant and policy have {n} and {k}"
            )
        gust = self.scenario.gust
        return np.concatenate([initial, np.zeros(self._y[2] - n), own, _NOTHING if gust is None else gust.start()])

    def constants(self, of_policy: Constants, of_plant: np.ndarray = _NOTHING) -> Constants:
        """Tick -> p, in an array that the next call overwrites."""
        _, a, b, c, d, e, size = self._p
        p, scenario = np.zeros(size), self.scenario
        p[:a] = of_plant

        def every(tick: int) -> np.ndarray:
            if b > a:
                p[a:b] = scenario.actuators.constants(tick * scenario.tick)  # type: ignore[union-attr]
            p[b:c] = of_policy(tick)
            if scenario.samples is not None:
                p[c:d] = scenario.samples[tick]
            if e > d:
                p[d:e] = scenario.gust.constants(tick)  # type: ignore[union-attr]
            return p

        return every

    def parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and the memory of the policy in y (..., n)."""
        return y[..., : self._y[1]], y[..., self._y[2] : self._y[3]]
