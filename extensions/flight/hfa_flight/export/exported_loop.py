"""Loops for other tools, as data: the aircraft alone or with its policy, and linear
models between the points of a sweep.

The arguments of an exported loop are commands, references, disturbances and held inputs, which a
simulation would compute."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.actuators import ActuatorBank
from hfa_flight.closed_loop import ClosedLoop, NonlinearPlant
from hfa_flight.policies import Measurements, Policy
from hfa_flight.scenario import Scenario
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from hfa_flight.export.interpolated import InterpolatedModel

#: s: the longest step of a loop whose own modes are no faster than the aircraft's.
LONGEST_STEP = 1e-3


class Channel(NamedTuple):
    """A scalar signal of a loop.

    unit: its unit, or None if it depends on the controller
    start: its initial value
    size: nominal size
    rate_unit: unit of its rate, or None if not needed
    """

    name: str
    unit: str | None
    start: float = 0.0
    size: float = 1.0
    rate_unit: str | None = None


@dataclass(frozen=True)
class Argument:
    """A vector that is an input of the loop, instead of a known function of time or a
    measurement."""

    value: ca.SX

    @property
    def size(self) -> int:
        """Number of channels."""
        return int(self.value.numel())

    def at(self, _: Any) -> ca.SX:
        """Return the value, which does not depend on the argument."""
        return self.value


@dataclass(frozen=True, eq=False, repr=False)
class GivenInputs(Policy):
    """Policy u = v - U0 with the arguments v."""

    inputs: ca.SX

    def control(self, t: ca.SX, measurements: Measurements, memory: ca.SX, held: ca.SX) -> ca.SX:
        """Return the deviations of the inputs."""
        return self.inputs


class Steering(NamedTuple):
    """Source of the inputs of an exported loop, about a trim.

    policy: the policy; each state of its memory has a channel in `states`
    arguments: channels of v
    v: (k,), symbols of the inputs of the loop
    reference: x_d, in v
    states: channels of the memory and of the filter
    filtered: (f,), symbols of the states of a filter of the arguments
    filtered_rate: (f,), their rates
    sets_inputs: False if v are the inputs themselves
    longest_step: s, largest Runge-Kutta step
    """

    policy: Policy
    arguments: list[Channel]
    v: ca.SX
    reference: Argument | None = None
    states: tuple[Channel, ...] = ()
    filtered: ca.SX = ca.SX(0, 1)
    filtered_rate: ca.SX = ca.SX(0, 1)
    sets_inputs: bool = True
    longest_step: float = LONGEST_STEP


def given_inputs(model: Model, point: OperatingPoint) -> Steering:
    """Return a steering by the absolute inputs of the aircraft."""
    U = ca.SX.sym("U", len(model.inputs))
    policy = GivenInputs("none", U - ca.DM(np.array(point.inputs)))
    arguments = _channels(model, model.inputs, point.inputs)
    return Steering(policy, arguments, U, sets_inputs=False)


def following_a_reference(model: Model, policy: Policy) -> Steering:
    """Return a steering by a policy of z = x - v without memory.

    v is the reference of the linear model's states.
    """
    v = ca.SX.sym("reference", len(model.linear))
    arguments = [Channel(f"reference_{name}", model.unit(name)) for name in model.linear]
    return Steering(policy, arguments, v, Argument(v))


@dataclass(frozen=True, eq=False)
class ExportedLoop:
    """Loop y' = f(y, v) in absolute values, with inputs u = g(y, v) of the aircraft if a policy
    sets them.

    function: (y, v) -> (f, g), with g empty if u are part of v
    states, outputs, inputs: channels of y, u, v
    flown: number of aircraft states, which come first
    longest_step: s, largest Runge-Kutta step
    """

    function: ca.Function
    states: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    flown: int
    longest_step: float = LONGEST_STEP


def exported_loop(
    model: Model,
    point: OperatingPoint,
    steering: Steering | None = None,
    actuators: ActuatorBank | None = None,
) -> ExportedLoop:
    """Return the loop X' = f(X, U, w) with states [X; actuators; memory of the policy; filter].

    Its inputs are [w; v]. w are the disturbances of the model. The steering determines v and U.
    Without one v = U. Actuators and memory are deviations from trim.

    Raises BadInputError if an actuator cannot hold the trim, or the policy measures states that
    these actuators lack.
    """
    steering = steering or given_inputs(model, point)
    w = ca.SX.sym("w", len(model.disturbances))
    air: Any = {name: Argument(w[row]) for row, name in enumerate(model.disturbances)}
    reference: Any = steering.reference
    scenario = Scenario(air=air, reference=reference, actuators=actuators)
    loop = ClosedLoop(NonlinearPlant(model, point), steering.policy, scenario)
    t, Y, held = loop.symbols()
    values = np.zeros(held.numel())
    loop.hold(0, values)
    offsets = np.zeros(Y.numel())
    offsets[: len(point.states)] = point.states
    now = loop.at(t, Y - ca.DM(offsets), ca.SX(ca.DM(values)))
    U = ca.SX(0, 1)
    outputs: list[Channel] = []
    if steering.sets_inputs:
        U = ca.densify(now.inputs + ca.DM(np.array(point.inputs)))
        outputs = _channels(model, model.inputs, point.inputs)
    rates = ca.densify(ca.vertcat(now.rate, steering.filtered_rate))
    arguments = [ca.vertcat(Y, steering.filtered), ca.vertcat(w, steering.v)]
    states = _channels(model, model.states, point.states, rates=True)
    states += _actuator_channels(model, actuators) + list(steering.states)
    winds = [Channel(name, model.unit(name)) for name in model.disturbances]
    return ExportedLoop(
        function=ca.Function("loop", arguments, [rates, U], {"cse": True}),
        states=tuple(states),
        outputs=tuple(outputs),
        inputs=(*winds, *steering.arguments),
        flown=len(model.states),
        longest_step=steering.longest_step,
    )


def _actuator_channels(model: Model, actuators: ActuatorBank | None) -> list[Channel]:
    """Return channels of the positions, and of the rates for order 2."""
    channels = []
    order = 0 if actuators is None else actuators.order
    if order >= 1:
        for name, signal in model.inputs.items():
            channels.append(Channel(f"{name}_actuator", signal.unit, size=signal.nominal))
    if order == 2:
        for name, signal in model.inputs.items():
            channels.append(Channel(f"{name}_actuator_rate", None, size=signal.nominal))
    return channels


def interpolated_loop(between: InterpolatedModel) -> ExportedLoop:
    """Return the loop x' = A(s) (x - X0(s)) + B(s) (u - U0(s)) of a sweep, with inputs v = [u; s].

    s are the variables of the sweep as inputs `scheduled_NAME`, initially in the middle of the
    grid.
    """
    sweep = between.sweep
    model = sweep.model
    middle = {
        name: float(axis[0] + axis[-1]) / 2
        for name, axis in zip(sweep.variables, between.axes, strict=True)
    }
    trimmed = between.at(**middle)
    rows = [list(model.states).index(name) for name in model.linear]
    x = ca.SX.sym("x", len(rows))
    u = ca.SX.sym("u", len(model.inputs))
    s = ca.SX.sym("s", len(middle))
    X0, U0, A, B = between.to_casadi()(s)
    rate = ca.mtimes(A, x - X0[rows]) + ca.mtimes(B, u - U0)
    function = ca.Function("loop", [x, ca.vertcat(u, s)], [rate, ca.DM(0, 1)], {"cse": True})
    inputs = _channels(model, model.inputs, trimmed.inputs)
    for name, value in middle.items():
        inputs.append(Channel(f"scheduled_{name}", model.unit(name), value))
    states = _channels(model, model.linear, trimmed.states[rows], rates=True)
    return ExportedLoop(function, tuple(states), (), tuple(inputs), len(states))


def _channels(
    model: Model, names: Iterable[str], values: Iterable[float], *, rates: bool = False
) -> list[Channel]:
    """Return channels of the model's signals at these values.

    rates: whether their units are those of the rates
    """
    channels = []
    for name, value in zip(names, values, strict=True):
        rate_unit = model.rate_unit(name) if rates else None
        nominal = model.signals[name].nominal
        channels.append(Channel(name, model.unit(name), float(value), nominal, rate_unit))
    return channels
