"""Plant, policy and scenario as one differential equation y' = f(t, y, held).

`held` contains the inputs of the loop that are constant during a tick. Only this module defines the
order of the parts of the held inputs (`HeldParts`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import Cost, saturated
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.servos import positions_of_servos
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.held_step import slices_of
from hfa_flight.air.scenario import Scenario
from hfa_flight.air.sensors import measured, names_with_errors, values_in_air
from hfa_flight.policies.policy import (
    GainPolicy,
    Measurements,
    OpenLoop,
    Policy,
    input_limits,
)
from hfa_flight.simulate.envelope import in_moving_air
from hfa_support.errors import BadInputError
from trim.linear.nonsmooth import linearization_at
from trim.point.operating_point import OperatingPoint

#: Disturbance of the model -> value. Disturbances that are not listed are 0.
Winds = Mapping[str, Any]


class Plant:
    """A plant in deviations x (n,) from its operating point, as CasADi expressions.

    uncertain: whether its parameters differ between flights
    point: the operating point
    """

    uncertain = False
    point: OperatingPoint

    def at(self, x: ca.SX, u: ca.SX, winds: Winds, parameters: ca.SX) -> ca.SX:
        """Return the time derivative x', (n,).

        x: (n,), deviations of the states
        u: (m,), deviations of the inputs
        winds: disturbance of the model -> value
        parameters: those of an uncertain plant, else (0,)
        """
        raise NotImplementedError

    def p(self, parameters: ca.SX) -> Any:
        """Return the parameters of the model; the argument is that of `at`."""
        return parameters if self.uncertain else getattr(self, "model", self.point.model).p


@dataclass(frozen=True, eq=False)
class LinearPlant(Plant):
    """Linear plant x' = A x + B u + E w.

    A: (n, n)
    B: (n, m)
    E: disturbance -> column (n,)
    point: operating point of the linearization
    """

    A: np.ndarray
    B: np.ndarray
    E: Winds
    point: OperatingPoint

    @classmethod
    def of(cls, model: Model, point: OperatingPoint, winds: Sequence[str]) -> LinearPlant:
        """Return the linearization of a model at an operating point, with all states of the model.

        winds: disturbances for which E is computed
        """
        slopes, _ = linearization_at(
            in_gusts(model), point.states, point.inputs, disturbances=winds
        )
        return cls(slopes.A, slopes.B, dict(zip(winds, slopes.E.T, strict=True)), point)

    def at(self, x: ca.SX, u: ca.SX, winds: Winds, parameters: ca.SX) -> ca.SX:
        """Return A x + B u + E w, (n,); the arguments are those of `Plant.at`."""
        rate = ca.mtimes(ca.DM(self.A), x) + ca.mtimes(ca.DM(self.B), u)
        for name, w in winds.items():
            rate = rate + ca.DM(self.E[name]) * w
        return rate


@dataclass(frozen=True, eq=False)
class NonlinearPlant(Plant):
    """Nonlinear plant about an operating point, X' = f(X, U, p, w) with X = X0 + x, U = U0 + u.

    p are the parameters of the model and w its disturbances.

    uncertain: whether p differs between flights

    Raises BadInputError if the operating point belongs to another model.
    """

    model: Model
    point: OperatingPoint
    uncertain: bool = False

    def __post_init__(self) -> None:
        """Raise BadInputError if the operating point belongs to another model."""
        self.point._refuse_other_model(self.model)

    def at(self, x: ca.SX, u: ca.SX, winds: Winds, parameters: ca.SX) -> ca.SX:
        """Return f(X0 + x, U0 + u, p, w), (n,). Disturbances that are not in `winds` are 0."""
        # A model without disturbances for the gusts gets them added to its equations.
        model = self.model if set(winds) <= set(self.model.disturbances) else in_gusts(self.model)
        w = [winds.get(name, 0.0) for name in model.disturbances]
        at = ca.DM(self.point.x) + x, ca.DM(self.point.u) + u, self.p(parameters)
        rates, _ = model.layout.expressions(at, (), w)
        return rates


class LoopSignals(NamedTuple):
    """Signals of a closed loop as CasADi expressions of t, y and the held inputs.

    rate: y'
    error: (k,), x - x_d
    inputs: (m,), inputs of the plant, as deviations from trim
    limited: absolute values of the variables of `FlightLoop.limits`
    winds: disturbance of the model that the scenario sets -> its value
    command: (m,), command of the policy
    measured: deviations of what the policy measures, with the errors of the sensors
    """

    rate: ca.SX
    error: ca.SX
    inputs: ca.SX
    limited: ca.SX
    winds: Winds
    command: ca.SX
    measured: ca.SX


class HeldParts(NamedTuple):
    """Parts of the held inputs, or their sizes, in the order of the vector `held`.

    Held inputs are constant during a tick. A part that the flight does not use has size 0.

    parameters: parameters of the plant that differ between flights
    policy: inputs that the policy holds, such as a gain
    noise: (k,), errors of the sensors `Scenario.sensors`
    gust: held inputs of the gust (`Gust.held_inputs`)
    delay: (2 + 2 m,), times between which the delayed commands are interpolated, and the commands
      at these times
    """

    parameters: Any
    policy: Any
    noise: Any
    gust: Any
    delay: Any


@dataclass(frozen=True, eq=False)
class FlightLoop:
    """Closed loop of a plant and a policy.

      x' = plant(x, u, w(t)) + d(t)
      u = policy(t, x + n - x_d(t))

    x and u are the deviations of states and inputs from trim. x_d is the
    reference, n the sensor noise of a tick, d a disturbance of the rates and w the motion of the
    air.

    scenario: initial x(0), x_d and d (default 0), errors of sensors, gust, other disturbances and
      delay
    cost: running cost of the errors z = x - x_d and of the inputs u, whose integral is a
      state of the loop, or None
    envelope: limits of the states first, and of outputs, absolute; None without limits

    Raises BadInputError if a signal or the policy does not have the size of the plant.
    """

    plant: Plant
    policy: Policy
    scenario: Scenario = field(default_factory=Scenario)
    cost: Cost | None = None
    envelope: Limits | None = None

    def __post_init__(self) -> None:
        """Raise BadInputError for wrong sizes."""
        k = len(self.plant.point.model.linear)
        self.policy.refuse_other_sizes(self.plant.point)
        signals = {name: getattr(self.scenario, name) for name in ("reference", "disturbance")}
        sizes = {name: signal.size for name, signal in signals.items() if signal is not None}
        if self.scenario.samples is not None:
            sizes["noise"] = np.shape(self.scenario.samples)[1] - len(self._sensed) + k
        for name, size in sizes.items():
            if size != k:
                raise BadInputError(f"the {name} has {size} channels; give {k}, one for each state")
        if isinstance(self.policy, GainPolicy) and self.policy.dt is not None:
            raise BadInputError(
                f"the {self.policy.name} is that of samples of {self.policy.dt:g} s; fly it behind "
                "a filter (--filter)"
            )
        seen = {*self.plant.point.model.linear, *self.policy.sensors}
        unseen = [name for name in self.scenario.sensors if name not in seen]
        if unseen and not isinstance(self.policy, OpenLoop):
            raise BadInputError(
                f"a sensor measures {unseen[0]}, which the policy does not see; fly it behind a "
                "filter (--filter), or remove the sensor"
            )
        if not self.policy.sensors and (
            self.scenario.samples is not None and np.isnan(self.scenario.samples).any()
        ):
            raise BadInputError(
                "a sensor has a value only in some samples, which requires a filter; add --filter"
            )

    @property
    def _sensed(self) -> tuple[str, ...]:
        """What has the errors `scenario.samples`."""
        return names_with_errors(self.plant.point.model, self.scenario.sensors)

    @cached_property
    def limits(self) -> Limits:
        """The envelope; in moving air, speed and flow angles are those relative to the air."""
        model = self.plant.point.model
        limits = self.envelope or Limits.of(model, tuple(model.states))
        return in_moving_air(limits) if self.scenario.moving_air else limits

    @cached_property
    def held_sizes(self) -> HeldParts:
        """Numbers of held inputs for the plant and the other parts."""
        scenario, model = self.scenario, self.plant.point.model
        return HeldParts(
            parameters=len(model.parameters) if self.plant.uncertain else 0,
            policy=self.policy.held.shape[1],
            noise=0 if scenario.samples is None else len(self._sensed),
            gust=0 if scenario.gust is None else scenario.gust.held_inputs(0).size,
            # Two times, and the commands of all inputs at both.
            delay=2 + 2 * len(model.inputs) if scenario.delayed_ticks else 0,
        )

    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return new symbols for t, y and the held inputs."""
        y = ca.SX.sym("y", len(self.plant.point.x) + (self.cost is not None))
        held = ca.SX.sym("held", sum(self.held_sizes))
        return ca.SX.sym("t"), y, held

    def at(self, t: ca.SX, y: ca.SX, held: ca.SX) -> LoopSignals:
        """Return the expressions of the loop at t, y and the held inputs."""
        scenario, plant, model = self.scenario, self.plant, self.plant.point.model
        rows = model.state_places(model.linear)
        x = y[: len(plant.point.x)]
        inputs = HeldParts(*(held[part] for part in slices_of(self.held_sizes)))
        winds = {} if scenario.gust is None else scenario.gust.winds(t, inputs.gust)
        for name, waveform in scenario.air.items():
            winds[name] = winds.get(name, 0.0) + waveform.at(t)
        reference = self._reference(t)

        # The states with the errors of their sensors, and the command that follows from them.
        states = x[rows]
        noise = ca.vertsplit(inputs.noise) if inputs.noise.numel() else ()
        errors = dict(zip(self._sensed, noise, strict=False))
        sensed = states + _by_name(errors, model.linear)
        measurements = Measurements(sensed - reference, sensed)
        command = self.policy.control(t, measurements, inputs.policy)

        u = _delayed_command(t, inputs.delay) if inputs.delay.numel() else command
        if positions_of_servos(model):  # what a servo receives
            u = saturated(u, *input_limits(plant.point))
        plant_rate = plant.at(x, u, winds, inputs.parameters)
        at = ca.DM(plant.point.x) + x, ca.DM(plant.point.u) + u, plant.p(inputs.parameters)
        limited = values_in_air(model, self.limits.names, at, winds)
        names = self.policy.sensors or tuple(model.states)
        values = measured(plant.point, names, x, u, at[2], winds) + _by_name(errors, names)
        if scenario.disturbance is not None:
            plant_rate[rows] += scenario.disturbance.at(t)
        error = states - reference
        cost_rate = ca.SX(0, 1) if self.cost is None else self.cost.rate(error, u)
        return LoopSignals(
            rate=ca.vertcat(plant_rate, cost_rate),
            error=error,
            inputs=u,
            limited=limited,
            winds=winds,
            command=command,
            measured=values,
        )

    def growing_modes(self) -> np.ndarray:
        """Return the eigenvalues with positive real parts of the loop linearized at the trim, 1/s.

        With samples of the policy or a delay, the modes are those that the policy knows of its
        sampled loop, or none.
        """
        if self.policy.sampler() is not None or self.scenario.delayed_ticks:
            sampled = self.policy.sampled_modes()
            modes = np.zeros(0) if sampled is None else sampled
        else:
            # A nonlinear plant has a model of its own, with errors of parameters.
            model = getattr(self.plant, "model", self.plant.point.model)
            linear = LinearPlant.of(model, self.plant.point, ())
            still = replace(self.scenario, gust=None, air={})  # winds do not change the modes
            loop = replace(self, plant=linear, cost=None, scenario=still)
            t, y, held = loop.symbols()
            slopes = ca.Function("slopes", [t, y, held], [ca.jacobian(loop.at(t, y, held).rate, y)])
            at_trim = slopes(0.0, np.zeros(y.numel()), loop.held_at_start())
            modes = np.linalg.eigvals(at_trim.full())
        return modes[modes.real > 0.0]

    @cached_property
    def breaks(self) -> np.ndarray:
        """Times at which a command, a reference or a fault steps, s, increasing."""
        sources = (self.policy, self.scenario.reference)
        times = [getattr(source, "breaks", ()) for source in sources]
        return np.unique(np.concatenate([np.zeros(0), *times]))

    @property
    def driven_until(self) -> float:
        """Time at which the last signal, gust, noise or step ends, s, or inf if one never ends."""
        return max([self.scenario.driven_until, *self.breaks.tolist()])

    def _reference(self, t: ca.SX) -> Any:
        """Return the reference x_d(t) of the states of the linear model, (k,)."""
        reference = self.scenario.reference
        count = len(self.plant.point.model.linear)
        return ca.SX.zeros(count) if reference is None else reference.at(t)

    def start(self) -> np.ndarray:
        """Return y at time 0: the initial condition of the scenario, and the cost."""
        return np.append(self.scenario.initial, [] if self.cost is None else [0.0])

    def hold(self, tick: int, held: HeldParts, time: float | None = None) -> None:
        """Write the held inputs of a tick into the parts of the vector of all held inputs.

        Those for parameters of the plant and for delayed commands are left unchanged.

        tick: number of the tick
        held: views of the parts of the vector
        time: time from which the inputs are held, s, or None for the start of the tick
        """
        scenario = self.scenario
        time = tick * scenario.tick if time is None else time
        held.policy[:] = self.policy.held_inputs(tick, time)
        sample = tick // scenario.ticks_per_sample
        if scenario.samples is not None:
            held.noise[:] = scenario.samples[sample]
        if scenario.gust is not None:
            held.gust[:] = scenario.gust.held_inputs(sample)

    def held_at_start(self) -> np.ndarray:
        """Return the vector of the inputs that are held in the first tick."""
        held = np.zeros(sum(self.held_sizes))
        self.hold(0, HeldParts(*(held[part] for part in slices_of(self.held_sizes))))
        return held


def _by_name(values: Mapping[str, ca.SX], names: tuple[str, ...]) -> ca.SX:
    """Return the values of some names, (k,), 0 for those without one."""
    return ca.vertcat(*(values.get(name, 0.0) for name in names))


def _delayed_command(t: ca.SX, delay: ca.SX) -> ca.SX:
    """Return the command, (m,), that arrives at t: interpolated between two earlier commands.

    delay: times and values of these commands (`HeldParts.delay`)
    """
    m = (delay.numel() - 2) // 2
    begin, end, early, late = ca.vertsplit(delay, [0, 1, 2, 2 + m, 2 + 2 * m])
    return early + (late - early) * (t - begin) / (end - begin)
