"""Loops for export: an aircraft with or without a policy.

Signals that a simulation computes from time, such as references and disturbances, are inputs of an
exported loop.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.scenario import Scenario
from hfa_flight.export.c_text import filter_sample, sensed_values
from hfa_flight.policies.estimate import known_start, memory_size, memory_slices
from hfa_flight.policies.filtered_policy import FilteredPolicy
from hfa_flight.policies.policy import Measurements, Policy
from hfa_flight.simulate.closed_loop import FlightLoop, NonlinearPlant
from hfa_support.errors import BadInputError
from trim.linear.delays import in_samples
from trim.point.operating_point import OperatingPoint

#: Longest Runge-Kutta step of an exported loop, s.
LONGEST_STEP = 1e-3


class Channel(NamedTuple):
    """A scalar signal of a loop.

    start: initial value
    size: nominal size
    rate_unit: unit of the rate, or "" if not needed
    """

    name: str
    unit: str
    start: float = 0.0
    size: float = 1.0
    rate_unit: str = ""


@dataclass(frozen=True)
class Argument:
    """A vector signal that is an input of an exported loop, in place of a function of time.

    Examples are the reference of a policy and the disturbances of the aircraft.

    value: symbols of the signal
    """

    value: ca.SX

    @property
    def size(self) -> int:
        """Number of channels of the signal."""
        return int(self.value.numel())

    def at(self, _: Any) -> ca.SX:
        """Return the symbols of the signal. They do not depend on t."""
        return self.value


@dataclass(frozen=True, eq=False, repr=False)
class GivenInputs(Policy):
    """Policy that applies inputs v of the exported loop to the aircraft.

    inputs: u = v - U0, deviations of the aircraft's inputs from trim, as an expression of v, (m,)
    """

    inputs: ca.SX

    def control(self, t: ca.SX, measurements: Measurements, held: ca.SX) -> ca.SX:
        """Return the deviations of the inputs from trim, (m,)."""
        return self.inputs


class Sampled(NamedTuple):
    """Sampled policy of an exported loop, whose commands are held.

    function: (y, v, memory) -> (commands, memory), with the inputs of the loop in v
    dt: sample time, s
    starts: commands before the first sample, (m,)
    """

    function: ca.Function
    dt: float
    starts: tuple[float, ...]


class Steering(NamedTuple):
    """Policy and input signals v of an exported loop.

    policy: the policy
    arguments: channels of v
    v: (k,), symbols of the inputs of the loop, then of the held commands
    reference: x_d, as part of v, or None
    sets_inputs: False if v are the inputs of the aircraft
    filtered: policy behind a filter, whose commands are held, or None
    """

    policy: Policy
    arguments: list[Channel]
    v: ca.SX
    reference: Argument | None = None
    sets_inputs: bool = True
    filtered: FilteredPolicy | None = None


def filtered_steering(model: Model, policy: FilteredPolicy) -> Steering:
    """Return the steering by a policy behind a filter, with the noise of its sensors as inputs."""
    sensors = policy.sensors
    U = ca.SX.sym("U", len(model.inputs))  # commands of the last sample
    held = GivenInputs("held", U - ca.DM(policy.point.u))
    arguments = [Channel(f"noise_{name}", in_gusts(model).unit(name)) for name in sensors]
    v = ca.vertcat(ca.SX.sym("noise", len(sensors)), U)
    return Steering(held, arguments, v, filtered=policy)


def _sampled(policy: FilteredPolicy, y: ca.SX, w: ca.SX, v: ca.SX) -> Sampled:
    """Return a policy behind a filter as the sampled policy of a loop, in flight from known states.

    y: symbols of the states of the loop
    w: symbols of the winds
    v: symbols of the noise of the sensors, then of the held commands
    """
    kalman, model, count = policy.filter, policy.point.model, len(policy.sensors)
    X = y[: len(model.states)]
    values = sensed_values(policy)(X, w if w.numel() else 0.0) + v[:count]
    # An FMU begins with a memory of zeros, in place of that of its states, which are known.
    under_way = np.zeros(policy.under_way * len(model.inputs))
    start = ca.SX(ca.DM(np.append(known_start(kalman), under_way)))
    memory, places = ca.SX.sym("memory", start.numel()), memory_slices(kalman)
    start[: len(kalman.states)] = (X - ca.DM(policy.point.x))[model.state_places(kalman.states)]
    before = ca.if_else(memory[places.begun] == 0, start, memory)
    u, later = filter_sample(policy).call([before, values])
    if policy.delay:  # the command of some whole samples ago acts, of those under way
        if in_samples(policy.delay, policy.dt).rest:
            raise BadInputError(
                f"the delay is {policy.delay:g} s; give an FMU a multiple of the sample time, "
                f"{policy.dt:g} s"
            )
        m, first = len(model.inputs), memory_size(kalman)
        u = before[first + m : first + 2 * m] + ca.DM(policy.point.u)
    results = [u, later]
    function = ca.Function("sample", [y, ca.vertcat(w, v), memory], results)
    return Sampled(function, policy.dt, tuple(policy.point.u.tolist()))


def given_inputs(model: Model, point: OperatingPoint) -> Steering:
    """Return the steering in which the loop's inputs v are the absolute inputs of the aircraft."""
    U = ca.SX.sym("U", len(model.inputs))
    policy = GivenInputs("none", U - ca.DM(point.u))
    arguments = _channels(model, model.inputs, point.inputs)
    return Steering(policy, arguments, U, sets_inputs=False)


def following_a_reference(model: Model, policy: Policy) -> Steering:
    """Return the steering in which a policy receives x - v.

    v is the reference of the states x of the linear model.
    """
    v = ca.SX.sym("reference", len(model.linear))
    arguments = [Channel(f"reference_{name}", model.unit(name)) for name in model.linear]
    return Steering(policy, arguments, v, Argument(v))


@dataclass(frozen=True, eq=False)
class ExportedLoop:
    """Loop y' = f(y, v) in absolute values, with the outputs h(y, v).

    function: (y, v) -> (f, h), with the held commands of a sampled policy after v
    states, outputs, inputs: channels of y, h and v. The outputs are the inputs of the aircraft that
        a policy sets, then the outputs of the model
    sampled: sampled policy, or None
    """

    function: ca.Function
    states: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    sampled: Sampled | None = None


def exported_loop(
    model: Model,
    point: OperatingPoint,
    steering: Steering | None,
) -> ExportedLoop:
    """Return the loop X' = f(X, U, w) with the inputs [w; v], w the disturbances of the model.

    steering: policy and input signals v, or None for v = U
    """
    steering = steering or given_inputs(model, point)

    # Rates and inputs of the closed loop, from its states Y in absolute values.
    w = ca.SX.sym("w", len(model.disturbances))
    air: Any = {name: Argument(w[row]) for row, name in enumerate(model.disturbances)}
    reference: Any = steering.reference
    scenario = Scenario(air=air, reference=reference)
    loop = FlightLoop(NonlinearPlant(model, point), steering.policy, scenario)
    t, Y, _ = loop.symbols()
    held = ca.SX(ca.DM(loop.held_at_start()))
    now = loop.at(t, Y - ca.DM(point.x), held)
    U = now.inputs + ca.DM(point.u)

    # Outputs h of the loop.
    vectors = Y, U, model.p
    _, h = model.layout.expressions(vectors, tuple(model.outputs), w)  # the outputs alone
    outputs = [Channel(name, signal.unit) for name, signal in model.outputs.items()]
    if steering.sets_inputs:
        h = ca.vertcat(U, h)
        outputs = [*_channels(model, model.inputs, point.inputs), *outputs]

    arguments = [Y, ca.vertcat(w, steering.v)]
    states = _channels(model, model.states, point.states, rates=True)
    winds = [Channel(name, model.unit(name)) for name in model.disturbances]
    filtered = steering.filtered
    return ExportedLoop(
        function=ca.Function(
            "loop", arguments, [ca.densify(now.rate), ca.densify(h)], {"cse": True}
        ),
        states=tuple(states),
        outputs=tuple(outputs),
        inputs=(*winds, *steering.arguments),
        sampled=None if filtered is None else _sampled(filtered, Y, w, steering.v),
    )


def _channels(
    model: Model, names: Iterable[str], values: Iterable[float], *, rates: bool = False
) -> list[Channel]:
    """Return the channels of signals of a model.

    values: value of each signal at the start
    rates: whether the channels also have the units of the signals' rates
    """
    channels = []
    for name, value in zip(names, values, strict=True):
        rate_unit = model.rate_unit(name) if rates else ""
        nominal = model.signals[name].nominal
        channels.append(Channel(name, model.unit(name), float(value), nominal, rate_unit))
    return channels
