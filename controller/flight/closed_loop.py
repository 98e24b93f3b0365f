"""Plant, law and scenario as one loop y' = f(t, y, p). Only this module knows how the loop is laid
out:

y = [x; actuators; memory of the policy; filter of the gust],
p = [the plant's; the actuators'; the policy's; noise samples; the gust's; the delay's].
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.flight.envelope import ALPHA, ANGLE_OF_ATTACK, flown_through_air
from controller.flight.gusts import UPDRAFT
from controller.flight.policies import FlownLaw, GainPolicy, Seen
from controller.flight.scenario import Scenario
from controller.flight.signals import zero
from hfa_aircraft.model import Model, components
from hfa_support.errors import BadInputError
from trim.point.operating_point import OperatingPoint

#: Disturbance of the model -> its value; those that are not there are 0.
Winds = Mapping[str, Any]
#: Tick -> constants that are held during the tick.
Constants = Callable[[int], np.ndarray]
_NOTHING = np.zeros(0)


class Plant:
    """A plant in deviations x (n,) from its operating point, as CasADi expressions.

    constants_size: length of p, what differs from flight to flight (the parameters of the aircraft,
    say)."""

    constants_size = 0
    point: Any

    @property
    def chosen(self) -> np.ndarray:
        """(k, n): the states of the linear model among all."""
        model = self.point.model
        return np.array([[float(name == other) for other in model.states] for name in model.linear])

    @property
    def trim(self) -> np.ndarray:
        """U0, (m,)."""
        return np.array(self.point.inputs)

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds, p: ca.SX) -> ca.SX:
        """x', for an input deviation u (m,), a disturbance d (k,) that adds to the rates of the
        states of the linear model, and disturbances of the model."""
        raise NotImplementedError

    def through_air(self, x: ca.SX, winds: Winds) -> ca.SX:
        """The deviation of alpha through the air where it is not alpha, (1,); else (0,)."""
        return ca.SX(0, 1)


@dataclass(frozen=True, eq=False)
class LinearPlant(Plant):
    """x' = A x + B u + d + E w. A: (n, n), B: (n, m), E: disturbance -> (n,), none unless given.

    point: where it was linearized, unless its states are all and its trim 0.
    """

    A: np.ndarray
    B: np.ndarray
    E: Winds = field(default_factory=dict)
    point: OperatingPoint | None = None

    @classmethod
    def at(cls, aircraft: Model, point: OperatingPoint, winds: Sequence[str] = ()) -> LinearPlant:
        """All states of an aircraft, with the exact derivatives at an operating point, those by
        these disturbances among them: what `NonlinearPlant` is to first order."""
        found = aircraft.at(point.states, point.inputs, disturbances=winds)
        return cls(found.A, found.B, dict(zip(winds, found.E.T, strict=True)), point)

    @property
    def chosen(self) -> np.ndarray:
        """As of the model; all without a point."""
        return np.eye(len(self.A)) if self.point is None else super().chosen

    @property
    def trim(self) -> np.ndarray:
        """As of the point; 0 without one."""
        return np.zeros(self.B.shape[1]) if self.point is None else super().trim

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds, p: ca.SX) -> ca.SX:
        """A x + B u + d + E w."""
        rate = (
            ca.mtimes(ca.DM(self.A), x)
            + ca.mtimes(ca.DM(self.B), u)
            + ca.mtimes(ca.DM(self.chosen.T), d)
        )
        for name, w in winds.items():
            rate = rate + ca.DM(self.E[name]) * w
        return rate


@dataclass(frozen=True, eq=False)
class NonlinearPlant(Plant):
    """X' = f(X, U, p, w) + d with X = X0 + x, U = U0 + u: the equations of an aircraft about an
    operating point.

    uncertain: the parameters of the model are an input, p. BadInputError when the point was trimmed
    with another model."""

    aircraft: Model
    point: OperatingPoint
    uncertain: bool = False

    def __post_init__(self) -> None:
        """A trim of other dynamics is none of this aircraft."""
        self.point.refuse_other(self.model)

    @property
    def model(self) -> Model:
        """Whose equations these are."""
        return self.aircraft

    @property
    def constants_size(self) -> int:  # type: ignore[override]
        """The parameters, where they are an input."""
        return len(self.model.parameters) if self.uncertain else 0

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds, p: ca.SX) -> ca.SX:
        """f(X0 + x, U0 + u, p, w), disturbed."""
        parameters = components(p) if self.uncertain else self.model.p.tolist()
        given = self._absolute(x), components(ca.DM(self.trim) + u), parameters
        return self.model.layout.expressions(given, (), self._winds(winds))[0] + ca.mtimes(
            ca.DM(self.chosen.T), d
        )

    def through_air(self, x: ca.SX, winds: Winds) -> ca.SX:
        """The output `ANGLE_OF_ATTACK` in winds, of a model that has one beside alpha.

        BadInputError where it depends on an input: then it is no angle of the flow alone.
        """
        model = self.model
        if not winds or not flown_through_air(model):
            return ca.SX(0, 1)
        u = ca.SX.sym("u", len(model.inputs))
        given = self._absolute(x), components(u), model.p.tolist()
        angle = model.layout.expressions(given, (ANGLE_OF_ATTACK,), self._winds(winds))[1]
        if ca.depends_on(angle, u):
            raise BadInputError(
                f"{model.name}: {ANGLE_OF_ATTACK} depends on an input; rename that output"
            )
        return angle - getattr(self.point.states, ALPHA)

    def _absolute(self, x: ca.SX) -> list[ca.SX]:
        return components(ca.DM(np.array(self.point.states)) + x)

    def _winds(self, winds: Winds) -> list[Any]:
        return [winds.get(name, 0.0) for name in self.model.disturbances]


class Expressions(NamedTuple):
    """A loop at (t, y, p): y', and what is observed: error z, inputs u, winds, alpha through the
    air as a deviation where it is not alpha, and the command of the policy."""

    rate: ca.SX
    error: ca.SX
    inputs: ca.SX
    winds: ca.SX
    angle: ca.SX
    command: ca.SX


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """x' = plant(x, a, d(t), w(t)),  a' = actuators(a, u),  u = policy(t, x + n(t) - x_d(t)); a = u
    without actuators.

    scenario: the start x(0), x_d, d and n (0 unless given), noise samples, gust, other
    disturbances, actuators and delay. BadInputError when a signal or a gain has another size than
    the plant, or an actuator cannot hold the trim."""

    plant: Plant
    law: FlownLaw
    scenario: Scenario = field(default_factory=Scenario)

    def __post_init__(self) -> None:
        """Sizes fit, and the actuators hold the trim."""
        (k, n), m, scenario = self.plant.chosen.shape, self.plant.trim.size, self.scenario
        moved, gust, policy = scenario.actuators, scenario.gust, self.law.policy
        if moved is not None:
            moved.refuse_trim(self.plant.trim)
        if isinstance(policy, GainPolicy) and (policy.inputs, policy.states) != (m, k):
            raise BadInputError(
                f"the gain has shape {policy.inputs, policy.states}; this aircraft takes {m} x {k}, inputs by states"
            )
        for name in ("reference", "disturbance", "noise"):
            signal = getattr(scenario, name)
            if signal is not None and signal.size != k:
                raise BadInputError(f"the {name} has {signal.size} channels; it must have {k}")
        y = (n, moved.size if moved else 0, policy.memory_size, gust.memory_size if gust else 0)
        fixed = (
            self.plant.constants_size,
            moved.constants_size if moved else 0,
            policy.constants_size,
        )
        sampled = 0 if scenario.samples is None else k
        p = (
            *fixed,
            sampled,
            gust.constants_size if gust else 0,
            1 + 2 * m if scenario.delayed_ticks else 0,
        )
        for name, sizes in (("_y", y), ("_p", p)):
            object.__setattr__(self, name, [0, *np.cumsum(sizes).tolist()])

    _y: list[int] = field(init=False, repr=False)
    _p: list[int] = field(init=False, repr=False)

    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """t, y and p to write the loop out in."""
        return ca.SX.sym("t"), ca.SX.sym("y", self._y[-1]), ca.SX.sym("p", self._p[-1])

    def at(self, t: ca.SX, y: ca.SX, p: ca.SX) -> Expressions:
        """The loop written out at CasADi expressions."""
        scenario, plant, actuators, policy = (
            self.scenario,
            self.plant,
            self.scenario.actuators,
            self.law.policy,
        )
        chosen, trim = ca.DM(plant.chosen), plant.trim
        x, moved, memory, filtered = ca.vertsplit(y, self._y)
        of_plant, of_actuators, of_policy, sample, of_air, of_delay = ca.vertsplit(p, self._p)
        signals = (scenario.reference, scenario.disturbance, scenario.noise)
        reference, d, noise = ((each or zero(chosen.rows())).at(t) for each in signals)
        states = ca.mtimes(chosen, x)
        error = states - reference
        if sample.numel():
            noise = noise + sample
        position, speed, winds = ca.SX(0, 1), ca.SX(0, 1), {}
        if actuators is not None:
            position, speed = actuators.position(moved, trim), actuators.rates(moved)
        rates = []
        if scenario.gust is not None:
            winds[UPDRAFT] = ca.SX(scenario.gust.updraft(t, filtered, of_air))
            rates.append(scenario.gust.memory_rate(t, filtered, of_air))
        for name, signal in scenario.air.items():
            winds[name] = winds.get(name, 0.0) + signal.at(t)
        updraft = ca.SX(winds[UPDRAFT]) if UPDRAFT in winds else ca.SX(0, 1)
        seen = Seen(error + noise, states + noise, position, speed, updraft)
        command = arriving = policy.control(t, seen, memory, of_policy)
        if of_delay.numel():
            begin, early, late = ca.vertsplit(of_delay, [0, 1, 1 + trim.size, 1 + 2 * trim.size])
            arriving = early + (late - early) * (t - begin) / scenario.tick
        reachable = arriving if actuators is None else actuators.reachable(arriving, trim)
        u = arriving if actuators is None else position
        rates.insert(0, policy.memory_rate(t, seen, memory, of_policy, reachable))
        if actuators is not None:
            rates.insert(0, actuators.states_rate(moved, reachable, of_actuators))
        rate = ca.vertcat(plant.rate(x, u, d, winds, of_plant), *rates)
        blown = ca.vertcat(ca.SX(0, 1), *winds.values())
        return Expressions(rate, error, u, blown, plant.through_air(x, winds), command)

    @property
    def wind_names(self) -> tuple[str, ...]:
        """Disturbances of the model that are not 0."""
        return tuple(
            dict.fromkeys((*[UPDRAFT] * (self.scenario.gust is not None), *self.scenario.air))
        )

    def start(self) -> np.ndarray:
        """y(0): the start of the scenario, actuators at trim, the memory of the law at its
        start."""
        gust, actuators = self.scenario.gust, np.zeros(self._y[2] - self._y[1])
        filtered = _NOTHING if gust is None else gust.start()
        y = np.concatenate([self.scenario.initial, actuators, self.law.memory, filtered])
        if y.size != self._y[-1]:
            raise BadInputError(
                f"the flight starts with {y.size} numbers; this loop has {self._y[-1]} states"
            )
        return y

    def constants(self, of_plant: np.ndarray = _NOTHING) -> Constants:
        """Tick -> p, in an array that the next call overwrites."""
        _, a, b, c, d, e, size = self._p
        p, scenario = np.zeros(size), self.scenario
        p[:a] = of_plant

        def every(tick: int) -> np.ndarray:
            if b > a:
                p[a:b] = scenario.actuators.constants(tick * scenario.tick)  # type: ignore[union-attr]
            p[b:c] = self.law.constants(tick)
            if scenario.samples is not None:
                p[c:d] = scenario.samples[tick]
            if e > d:
                p[d:e] = scenario.gust.constants(tick)  # type: ignore[union-attr]
            return p

        return every

    def parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and the memory of the policy in y (..., n)."""
        return y[..., : self._y[1]], y[..., self._y[2] : self._y[3]]
