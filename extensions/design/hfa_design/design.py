"""Design of a controller: inputs with actuators, integrated outputs, and weights.

Designs are read from files and apply to any `Model`. The name of a state or signal implies the
unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.actuators import Actuator
from hfa_flight.signals import COMMAND_FILTER
from hfa_support.arguments import checks_arguments
from hfa_support.attributes import Advised
from hfa_support.errors import (
    BadInputError,
    prefix_errors,
    refuse_unknown,
    refuse_unless_positive,
    shortened,
)
from hfa_support.schema import NUMBER, POSITIVE, Number, checked, read_named

#: Shipped designs: name -> file.
NAMED = {"paper": "paper.toml", "servo": "servo.toml"}
#: Sources of the disturbance of the game, in addition to the disturbances of the model.
DISTURBANCES = ("states", "commands")


@checks_arguments
class OutputWeight(NamedTuple):
    """Weight gain (1 + corner/s) / (1 + lag s) of an output, with the Laplace variable s.

    gain: 1/unit of the output
    corner: rad/s
    lag: s
    """

    gain: float
    corner: float = 0.0
    lag: float = 0.0


@checks_arguments
class Following(NamedTuple):
    """Settings of model following: weights of squared errors, command filter, actuators.

    outputs: commanded output -> weight of its error
    rates: input -> weight of its rate
    states: state -> weight
    filter: bandwidth (rad/s) and damping of the command filter
    bandwidth: bandwidth of the first-order actuators of the reference model, rad/s
    """

    outputs: Mapping[str, float]
    rates: Mapping[str, float]
    states: Mapping[str, float] = MappingProxyType({})
    filter: Sequence[float] = COMMAND_FILTER
    bandwidth: float = 2.0


class Shaping(NamedTuple):
    """Settings of a loop-shaping design.

    inputs: input -> gain
    outputs: measured output -> weight
    breakpoints: increasing values of the scheduling variable, angles in rad, at which controllers
      are computed
    following: settings of model following
    factor: γ of the controller divided by the smallest γ of any controller
    schedule: output -> factor on the gain at each breakpoint
    """

    inputs: Mapping[str, float]
    outputs: Mapping[str, OutputWeight]
    breakpoints: tuple[float, ...]
    following: Following
    factor: float = 1.1
    schedule: Mapping[str, Sequence[float]] = MappingProxyType({})

    def outputs_at(self, scheduling_value: float) -> dict[str, OutputWeight]:
        """Return the weight of each output at a value of the scheduling variable.

        The factors on the gains in `schedule` are interpolated between the breakpoints.
        """
        factors = {
            name: float(np.interp(scheduling_value, self.breakpoints, row))
            for name, row in self.schedule.items()
        }
        return {
            name: weight._replace(gain=weight.gain * factors.get(name, 1.0))
            for name, weight in self.outputs.items()
        }


@checks_arguments
@dataclass(frozen=True)
class Design(Advised):
    """Settings of a design for a linear model with actuators and integrals e' = y of outputs y.

    name: name of a shipped design, or path of a user's file
    inputs: inputs that the controller uses; by default all of the model
    actuators: input -> actuator; an input that is not listed has no actuator dynamics
    integrals: outputs that are integrated
    disturbances: source -> intensity, which scales the squared columns of E. A source is "states"
      (the rates of the linear states, as in the paper), "commands" (the inputs), or a disturbance
      of the model.
    state_weights, input_weights: diagonals of Q and R, by the names in `states` and `inputs`; a
      state that is not listed has weight 0
    delta: delta of the game, inf for an LQR
    sensors: state or output -> intensity of its noise
    shaping: settings of a loop-shaping design, which has no game
    variants: name of a model's equations -> the design for these equations
    model: the model whose names are used

    Raises BadInputError if a name is unknown or given twice, a number is out of range, or an input
    has no weight.
    """

    name: str
    inputs: tuple[str, ...] = ()
    actuators: Mapping[str, Actuator] = field(default_factory=dict)
    integrals: tuple[str, ...] = ()
    disturbances: Mapping[str, float] = field(default_factory=lambda: {"states": 1.0})
    state_weights: Mapping[str, float] = field(default_factory=dict)
    input_weights: Mapping[str, float] = field(default_factory=dict)
    delta: float = math.inf
    sensors: Mapping[str, float] = field(default_factory=dict)
    shaping: Shaping | None = None
    variants: Mapping[str, Design] = field(default_factory=dict)
    model: Model = field(kw_only=True, compare=False)

    def of(self, model: Model) -> Design:
        """Return the design for a model.

        If the design has a variant for the model's equations, the variant is returned.
        """
        return replace(self.variants.get(model.name, self), model=model)

    def __post_init__(self) -> None:
        """Raise BadInputError if a name or number is wrong or a required entry is missing."""
        object.__setattr__(self, "inputs", tuple(self.inputs or self.model.inputs))
        where = f"design {self.name}:"
        measurable = (*self.plant_states, *self.integral_states, *self.model.measurable)
        disturbances = (*DISTURBANCES, *self.model.disturbances)
        _refuse_names(f"{where} unknown input", self.inputs, [*self.model.inputs])
        _refuse_names(f"{where} unknown integrated output", self.integrals, self.model.measurable)
        _refuse_names(f"{where} unknown actuator", [*self.actuators], self.inputs)
        _refuse_names(f"{where} unknown weighted state", [*self.state_weights], self.states)
        _refuse_names(f"{where} unknown weighted input", [*self.input_weights], self.inputs)
        _refuse_names(f"{where} unknown sensor", [*self.sensors], measurable)
        _refuse_names(f"{where} unknown disturbance", [*self.disturbances], disturbances)
        for name, value in self.sensors.items():
            refuse_unless_positive(f"{where} the noise of sensor {name}", value)
        for name, value in self.disturbances.items():
            refuse_unless_positive(f"{where} the intensity of disturbance {name}", value)
        self._require_for_every_input(where, "weight", self.input_weights)
        if self.shaping is not None:
            self._check_shaping(where, self.shaping)

    def _check_shaping(self, where: str, shaping: Shaping) -> None:
        """Raise BadInputError if the loop-shaping settings are incomplete or inconsistent."""
        following = shaping.following
        measured = [*shaping.outputs]
        _refuse_names(f"{where} unknown input with a rate", [*following.rates], self.inputs)
        _refuse_names(f"{where} unknown weighted state", [*following.states], self.model.linear)
        _refuse_names(f"{where} unknown scheduled output", [*shaping.schedule], measured)
        unmeasured = f"{where} unknown followed output, which must be measured"
        _refuse_names(unmeasured, [*following.outputs], measured)
        self._require_for_every_input(where, "actuator", self.actuators)
        rate_weight = "weight in shaping.following.rates"
        self._require_for_every_input(where, rate_weight, following.rates)
        variable = self.model.schedule
        for name, factors in shaping.schedule.items():
            if len(factors) != len(shaping.breakpoints):
                raise BadInputError(
                    f"{where} shaping.schedule.{name} has {len(factors)} factors; give "
                    f"{len(shaping.breakpoints)}, one for each {variable}"
                )
        if len(following.filter) != 2:
            raise BadInputError(
                f"{where} shaping.following.filter does not have two entries; give a bandwidth "
                "and a damping ratio"
            )
        if not shaping.breakpoints or np.any(np.diff(shaping.breakpoints) <= 0.0):
            raise BadInputError(
                f"{where} shaping.{variable}s is empty or does not increase; give an increasing "
                "list"
            )

    def _require_for_every_input(self, where: str, what: str, table: Mapping[str, Any]) -> None:
        """Raise BadInputError if a setting is missing for some input."""
        for name in self.inputs:
            if name not in table:
                raise BadInputError(f"{where} input {name} has no {what}; add one for every input")

    @property
    def plant_states(self) -> tuple[str, ...]:
        """Names of the states of the linear model, then of actuator positions, then of actuator
        rates.
        """
        moving = [name for name in self.inputs if name in self.actuators]
        second = [name for name in moving if self.actuators[name].order == 2]
        return (
            *self.model.linear,
            *(f"{name}_position" for name in moving),
            *(f"{name}_rate" for name in second),
        )

    @property
    def integral_states(self) -> tuple[str, ...]:
        """Names of the integrals."""
        return tuple(f"{name}_integral" for name in self.integrals)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the plant states, then of the integrals."""
        return (*self.plant_states, *self.integral_states)


def _refuse_names(unknown: str, names: Sequence[str], choices: Sequence[str]) -> None:
    """Raise BadInputError if a name is not among the choices or occurs twice."""
    for name in names:
        refuse_unknown(unknown, name, choices)
        if names.count(name) > 1:
            what = unknown.replace(" unknown ", " ")
            raise BadInputError(f"{what} {name} is named twice; remove one {name}")


_WEIGHTS = {str: Number(0.0, 1e100)}
_POSITIVE = {str: POSITIVE}
_FILE = {
    "description": str,
    "source": str,
    "inputs": [str],
    "integrals": [str],
    "disturbance": None,
    "delta": Number(0.0, above=True, infinite=True),
    "actuators": {str: {each.name: NUMBER for each in fields(Actuator)}},
    "weights": {"states": _WEIGHTS, "inputs": _WEIGHTS},
    "sensors": _WEIGHTS,
    "shaping": {
        "factor": Number(1.0, above=True),
        "schedule": {str: [POSITIVE]},
        "inputs*": _POSITIVE,
        "outputs*": {str: {"gain*": POSITIVE, "corner": Number(0.0), "lag": Number(0.0)}},
        "following*": {
            "outputs*": _POSITIVE,
            "states": _WEIGHTS,
            "rates*": _POSITIVE,
            "filter": [POSITIVE],
            "bandwidth": POSITIVE,
        },
    },
}


@checks_arguments
def load_design(name: str, model: Model) -> Design:
    """Return a shipped design by its name in `NAMED`, or the design in a user's file.

    The design uses the units that the model declares. A file contains:

    - inputs, integrals: lists of names
    - disturbance: "states", "commands" or a disturbance of the model
    - [disturbance]: several of these, with their intensities
    - delta: a number, inf for no disturbance
    - [actuators.INPUT]: order, bandwidth (rad/s), damping, effectiveness
    - [weights.states], [weights.inputs]: name = weight
    - [sensors]: output or state = intensity of the noise
    - [shaping], instead of a game: factor, and dihedrals in deg or, for a model scheduled over
      another variable, its name with s, such as speeds
    - [shaping.inputs]: input = gain
    - [shaping.outputs.NAME]: gain, corner, lag
    - [shaping.schedule]: output = factors
    - [shaping.following]: filter, bandwidth, and by name outputs, states, rates
    - [newton.TABLE]: entries that replace those above for the equations `newton`

    Raises BadInputError if the file cannot be read, or an entry is unknown, missing or invalid.
    """
    data = read_named("design", name, NAMED, "hfa_design", {...: None})
    return design_of(name, data, model.native)


def design_of(name: str, data: Mapping[str, Any], model: Model) -> Design:
    """Return the design that the entries of a file specify.

    name: name of the design
    data: the entries

    Raises BadInputError if an entry is unknown, missing or invalid.
    """
    breakpoints = f"{model.schedule}s"
    form: dict[str, Any] = {**_FILE}
    form["shaping"] = {**_FILE["shaping"], f"{breakpoints}*": [NUMBER]}  # type: ignore[dict-item]  # a table
    variants = {key: data[key] for key in model.about.variants if key in data}
    entries = {key: value for key, value in data.items() if key not in variants}
    entries = checked(name, entries, form)
    entering = entries.get("disturbance", "states")
    if not isinstance(entering, dict):
        entering = {checked(name, entering, str, "disturbance"): 1.0}
    weights = entries.get("weights", {})
    input_weights = weights.get("inputs", {})
    sensors = entries.get("sensors", {})
    shaping = _shaping_of(name, entries, breakpoints, model)
    if shaping is not None:
        input_weights = shaping.inputs
        sensors = dict.fromkeys(shaping.outputs, 1.0)
    changed = {}
    for key, changes in variants.items():
        merged = _merged(entries, checked(name, changes, {...: None}, key))
        changed[key] = design_of(name, merged, model)
    return Design(
        name=name,
        inputs=tuple(entries.get("inputs", ())),
        integrals=tuple(entries.get("integrals", ())),
        disturbances=checked(name, entering, _WEIGHTS, "disturbance"),
        delta=entries.get("delta", math.inf),
        actuators=actuators_of(name, entries),
        state_weights=weights.get("states", {}),
        input_weights=input_weights,
        sensors=sensors,
        shaping=shaping,
        variants=changed,
        model=model,
    )


def _shaping_of(
    name: str, entries: Mapping[str, Any], breakpoints: str, model: Model
) -> Shaping | None:
    """Return the settings in [shaping], or None if this table is missing."""
    if "shaping" not in entries:
        return None
    for game_entry in ("integrals", "disturbance", "delta", "weights", "sensors"):
        if game_entry in entries:
            raise BadInputError(
                f"{name}: the entry {game_entry} applies to a game and cannot be combined with"
                " [shaping]; remove one of the two"
            )
    table = dict(entries["shaping"])
    values = [float(value) for value in table.pop(breakpoints)]
    if model.is_typed_in_degrees:
        values = [math.radians(value) for value in values]
    table["breakpoints"] = tuple(values)
    table["outputs"] = {key: OutputWeight(**weight) for key, weight in table["outputs"].items()}
    table["following"] = Following(**table["following"])
    return Shaping(**table)


def actuators_of(name: str, entries: Mapping[str, Any]) -> dict[str, Actuator]:
    """Return the actuators in [actuators.INPUT], by input."""
    actuators = {}
    for key, numbers in entries.get("actuators", {}).items():
        if numbers.get("order") in (1, 2):
            numbers = numbers | {"order": int(numbers["order"])}
        with prefix_errors(f"{name}: actuators.{shortened(key)}"):
            actuators[key] = Actuator(**numbers)
    return actuators


def _merged(whole: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of `whole`, with entries replaced or added by `changes`."""
    merged = {**whole, **changes}
    for key, change in changes.items():
        if isinstance(whole.get(key), dict) and isinstance(change, dict):
            merged[key] = _merged(whole[key], change)
    return merged
