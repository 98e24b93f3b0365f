"""Deployments on an aircraft, as CasADi functions of its state and input.

Each function of X also has the argument `trim` = (X0; U0; p). One compiled function thus serves
all trims.

    observe(X, U, trim) -> o        observations of a sample; U is the input just before the sample
    act(o) -> a                     action for the observations
    inputs(a, X, U, trim) -> U      inputs of the aircraft, within its limits
    command(X, U, trim) -> U        the three functions
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import casadi as ca
import numpy as np

from controller.critic.features import RESERVED, expressions, symbols_for
from hfa_aircraft.batch_simulation import saturated
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_flight.air.gust_equations import IN_AIR, in_gusts
from hfa_flight.air.sensors import Sensor, values_in_air
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_support.errors import BadInputError, prefix_errors, refuse_unknown, shortened, shown
from hfa_support.units import conversion_factor
from trim.linear.delays import in_samples
from trim.point.operating_point import OperatingPoint

_LONGEST = 500
#: A name in a formula, and not the exponent of a number.
_NAME = r"\b[A-Za-z_]\w*"


class Formula(NamedTuple):
    """Formula of numbers, names, + - * / ** and a few functions, never executed as Python code.

    names: variables of the formula.
    function: CasADi function of the variables.
    """

    names: tuple[str, ...]
    function: ca.Function

    def value(self, values: Mapping[str, Any]) -> ca.SX:
        """Return the expression of the formula.

        values: name -> value
        """
        return self.function.call([ca.SX(values[name]) for name in self.names])[0]


def read_formula(text: str, known: tuple[str, ...]) -> Formula:
    """Read a formula.

    known: permitted names

    Raises BadInputError for an unknown name, an unsupported operation, a text longer than
    `_LONGEST` characters, and for anything that is not a formula.
    """
    if len(text) > _LONGEST:
        raise BadInputError(
            f"{shown(text)} is too long for a formula; give at most {_LONGEST} characters"
        )
    names = [name for name in dict.fromkeys(re.findall(_NAME, text)) if name not in RESERVED]
    for name in names:
        refuse_unknown(f"the formula {shown(text)} contains the unknown name", name, (*known, "pi"))
    symbols = {name: ca.SX.sym(name) for name in names if name != "pi"}
    try:
        (value,) = expressions(text.strip(), symbols | {"pi": ca.SX(math.pi)}, "")
        function = ca.Function("formula", [*symbols.values()], [value])
    except Exception as error:  # each raises other exceptions: parser, floats, CasADi
        raise BadInputError(
            f"{shown(text)} is not a formula; use only numbers, names, + - * / ** and "
            f"{', '.join(RESERVED)}"
        ) from error
    return Formula(tuple(symbols), function)


#: Names in a map in addition to the names of the aircraft.
ACTION = "a"
TRIM = "trim"


@dataclass(frozen=True, eq=False)
class Deployed:
    """Deployment on an aircraft, as functions of the aircraft's states and inputs.

    deployment: the deployment.
    model: the aircraft.
    varies: whether p is that of a changed aircraft, whose trim values remain those of `model`.
    sensed: outputs that sensors measure. In the functions, their values follow the states in X.

    Raises a BadInputError that names the wrong entry of the deployment file and the known names.
    """

    deployment: Deployment
    model: Model
    varies: bool = False
    sensed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check every name of the deployment, its formulas and its cost."""
        with prefix_errors(self.deployment.origin):
            _ = self.observed  # reads and checks the formulas
            for name in self.deployment.action:
                refuse_unknown("action names the unknown input", name, tuple(self.model.inputs))
            for name in self.sensed:
                if name not in self.used:
                    raise BadInputError(
                        f"a sensor measures {name}, which no observation contains; observe it, "
                        "remove its sensor, or fly behind a filter (hfa fly --filter)"
                    )
            self._refuse_cost()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the names that formulas may contain: states, inputs and outputs, of a pitot tube
        and vanes too.
        """
        return (*self.model.states, *self.model.inputs, *in_gusts(self.model).outputs)

    @cached_property
    def used(self) -> set[str]:
        """Names that the formulas contain."""
        return {name for formula in (*self.observed, *self.maps) for name in formula.names}

    def sensors_in_air(self, sensors: Mapping[str, Sensor]) -> dict[str, Sensor]:
        """Return sensors, and those without errors of the airspeed and flow angles in formulas."""
        return {name: Sensor(0.0) for name in IN_AIR if name in self.used} | {**sensors}

    def sensing(self, sensors: Mapping[str, Sensor]) -> Self:
        """Return the deployment that sees what sensors measure.

        Raises BadInputError if it cannot see it without a filter.
        """
        for name, sensor in sensors.items():
            if in_samples(sensor.every, self.deployment.dt) not in ((0, 0.0), (1, 0.0)):
                raise BadInputError(
                    f"the sensor of {name} has a value only in some samples, which requires a "
                    "filter (hfa fly --filter)"
                )
        outputs = tuple(name for name in sensors if name not in self.model.states)
        return replace(self, sensed=outputs)

    @cached_property
    def observed(self) -> tuple[Formula, ...]:
        """Formula of each observation, in order.

        Raises BadInputError for a wrong formula.
        """
        formulas = []
        for name, entry in self.deployment.observation.items():
            with prefix_errors(f"observation.{shortened(name)}"):
                formulas.append(read_formula(entry.get("formula", name), self.names))
        return tuple(formulas)

    @cached_property
    def maps(self) -> tuple[Formula, ...]:
        """Formula of the input that each action moves, in the order of the actions.

        Raises BadInputError for a formula that is wrong or lacks the action.
        """
        formulas = []
        for name, entry in self.deployment.action.items():
            with prefix_errors(f"action.{name}.map"):
                text = entry.get("map", f"{TRIM} + {ACTION}")
                formula = read_formula(text, (ACTION, TRIM, *self.names))
                if ACTION not in formula.names:
                    raise BadInputError(
                        f"the formula does not contain the action; write {ACTION} for the action"
                    )
                formulas.append(formula)
        return tuple(formulas)

    @property
    def commanded(self) -> tuple[str, ...]:
        """Inputs that the policy moves, in the order of its actions."""
        return tuple(self.deployment.action)

    def _refuse_cost(self) -> None:
        """Raise BadInputError for weights of unknown signals, and for a missing weight in R."""
        cost = self.deployment.cost
        if cost is None:
            return
        for name in cost["Q"]:
            known = (*self.model.linear, *self.model.outputs)
            refuse_unknown("cost.Q names the unknown state or output", name, known)
        for name in cost["R"]:
            refuse_unknown("cost.R names the input that no action moves,", name, self.commanded)
        if missing := [name for name in self.commanded if name not in cost["R"]]:
            raise BadInputError(
                f"cost.R has no weight for {missing[0]}; give a weight for each input that an "
                "action moves"
            )

    def symbols(self, function: ca.Function | None = None) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return new symbols of X (n,), U (m,) and trim = (X0; U0; p).

        function: function of them or of their results. The symbols are MX for an MX function
        """
        kind: Any = ca.SX if function is None or function.is_a("SXFunction") else ca.MX
        n, m = len(self.model.states), len(self.model.inputs)
        count = n + m + len(self.model.parameters)
        return kind.sym("X", n + len(self.sensed)), kind.sym("U", m), kind.sym("trim", count)

    def trim_vector(self, point: OperatingPoint) -> np.ndarray:
        """Return the vector trim = (X0; U0; p) of an operating point."""
        return np.concatenate([point.states, point.inputs, point.model.p])

    def values(self, X: ca.SX, U: ca.SX, trim: ca.SX) -> dict[str, ca.SX]:
        """Return the expressions of states, inputs and outputs by name.

        An output is that of the states in still air, or the value of its sensor.
        """
        model = self.model
        n, m = len(model.states), len(model.inputs)
        at = X[:n], U, trim[n + m :]
        known = (*model.states, *model.inputs, *model.outputs)
        _, y = model.layout.expressions(at, tuple(model.outputs))  # the outputs alone
        values = dict(zip(known, ca.vertsplit(ca.vertcat(X[:n], U, y)), strict=True))
        if in_air := tuple(name for name in self.names if name in self.used - set(known)):
            y = values_in_air(model, in_air, at, {})
            values |= zip(in_air, ca.vertsplit(y), strict=True)
        return values | dict(zip(self.sensed, ca.vertsplit(X[n:]), strict=False))

    def at_trim(self, trim: ca.SX) -> dict[str, ca.SX]:
        """Return the expressions of all states, inputs and outputs at the trim, by name."""
        n, m = len(self.model.states), len(self.model.inputs)
        if self.varies:  # the trim values are those of the unchanged aircraft, with its p
            trim = ca.vertcat(trim[: n + m], self.model.p)
        return self.values(trim[:n], trim[n : n + m], trim)

    def refuse_undefined_at(
        self, points: Iterable[OperatingPoint], action: np.ndarray | None = None
    ) -> None:
        """Raise BadInputError if an observation, the policy or a map is not finite at a trim, or if
        the file of a gain has other units than the deployment.

        Observations must have finite derivatives with respect to X and U, and maps with respect to
        the action.

        action: (m,), replaces the action of a policy that is not trained yet
        """
        with prefix_errors(self.deployment.origin):
            for point in points:
                at_trim = (point.x, point.u, self.trim_vector(point))
                entries = self.deployment.observation
                by_X_and_U, by_action = (0, 1), (0,)
                o = _refuse_undefined("observation", entries, self.observe, at_trim, by_X_and_U)
                a = action
                if a is None:  # the policy's file is read only here
                    self._refuse_other_units()
                    a = np.array(self.act(o)).ravel()
                if not np.isfinite(a).all():
                    raise BadInputError(
                        "the output of policy.file is not finite at the trim; check the weights "
                        "and the normalizer of the policy"
                    )
                inputs = tuple(self.model.inputs)  # those without a map stay at the trim
                moved = self.unlimited_inputs
                _refuse_undefined("action", inputs, moved, (a, *at_trim), by_action)

    def _refuse_other_units(self) -> None:
        """Raise BadInputError if the file of a gain K has other units than the deployment.

        The unit of an observation is that of its signal times the scale. A unit that the file does
        not state is not checked.
        """
        deployment = self.deployment
        of_gain = deployment.actor.of_gain
        state_units, input_units = of_gain.get("state_units", ()), of_gain.get("input_units", ())
        # Only a state has a unit with which that of the gain is compared, and no formula has.
        for (name, entry), unit in zip(deployment.observation.items(), state_units, strict=False):
            signal = entry.get("formula", name)
            unit_of_model = self.model.unit(signal) if signal in self.model.states else ""
            expected = conversion_factor(unit, unit_of_model)
            scale = float(entry.get("scale", 1.0))
            if expected is not None and not math.isclose(scale, expected, rel_tol=1e-3):
                raise BadInputError(
                    f"K is a gain per {unit} of {signal}, but the deployment file divides {signal} "
                    f"in {unit_of_model} by {scale:g}; give scale = {expected:.6g}, or remove "
                    "state_units from the file"
                )
        for (name, entry), unit in zip(deployment.action.items(), input_units, strict=False):
            factor = conversion_factor(unit, self.model.unit(name))
            # a map may convert the unit
            if "map" not in entry and factor is not None and not math.isclose(factor, 1.0):
                raise BadInputError(
                    f"K is a gain of an action in {unit}, but {name} is in {self.model.unit(name)};"
                    f' give map = "trim + {factor:.6g} * a"'
                )

    @cached_property
    def observe(self) -> ca.Function:
        """Function (X, U, trim) -> o, the observations (k,) of one sample."""
        X, U, trim = self.symbols()
        values = self.values(X, U, trim)
        at_trim = self.at_trim(trim)
        entries = []
        observation = self.deployment.observation.values()
        for formula, entry in zip(self.observed, observation, strict=True):
            about: Any = entry.get("about", "trim")
            if about == "trim":
                about = formula.value(at_trim)
            value = _rounded(formula.value(values), entry)
            entries.append((value - about) / entry.get("scale", 1.0))
        return ca.Function("observe", [X, U, trim], [ca.densify(ca.vertcat(*entries))])

    @cached_property
    def normalized(self) -> ca.Function:
        """Function o -> (normalized observations without the clip, inputs of the network).

        Without a normalizer, both results are o.
        """
        normalizer = self.deployment.normalizer
        o = ca.SX.sym("o", len(self.deployment.observation))
        if normalizer is None:
            return ca.Function("normalized", [o], [o, o])
        parts = (normalizer.before_clip(o), normalizer.of(o))
        return ca.Function("normalized", [o], [ca.densify(part) for part in parts])

    @cached_property
    def action(self) -> ca.Function:
        """Function that clips or squashes the outputs of the network to the box of the actions.

        It maps the outputs (m,) to the action a (m,).
        """
        raw = ca.SX.sym("raw", len(self.commanded))
        return ca.Function(
            "action", [raw], [ca.densify(self.deployment.actor.declared.action.of(raw))]
        )

    @cached_property
    def stages(self) -> ca.Function:
        """Function o -> (normalized observations without the clip, network's output, action)."""
        network = self.deployment.actor.function
        o = symbols_for([network], len(self.deployment.observation))
        normal, seen = self.normalized(o)
        raw = ca.densify(ca.vec(network(seen)))
        return ca.Function("stages", [o], [normal, raw, self.action(raw)])

    @cached_property
    def act(self) -> ca.Function:
        """Function o -> a, the action (m,) in the units of the box, or nan if o contains nan."""
        o = symbols_for([self.stages], len(self.deployment.observation))
        _, _, action = self.stages(o)
        a = _unless_nan(ca.sum1(o), action)  # the sum is nan if an observation is
        return ca.Function("act", [o], [ca.densify(a)])

    @cached_property
    def unlimited_inputs(self) -> ca.Function:
        """Function (a, X, U, trim) -> all inputs of the aircraft.

        The inputs are not clipped to the control limits.
        """
        X, U, trim = self.symbols()
        a = ca.SX.sym("a", len(self.commanded))
        values = self.values(X, U, trim)
        inputs = tuple(self.model.inputs)
        n = len(self.model.states)
        entries = [trim[n + index] for index in range(len(inputs))]  # U0
        for number, (name, formula) in enumerate(zip(self.commanded, self.maps, strict=True)):
            index = inputs.index(name)
            a_and_trim = {ACTION: a[number], TRIM: trim[n + index]}
            moved = formula.value({**values, **a_and_trim})
            entries[index] = _rounded(moved, self.deployment.action[name])
        return ca.Function("unlimited_inputs", [a, X, U, trim], [ca.densify(ca.vertcat(*entries))])

    @cached_property
    def inputs(self) -> ca.Function:
        """Function (a, X, U, trim) -> all inputs of the aircraft.

        Commanded inputs are within their limits.
        """
        X, U, trim = self.symbols()
        a = ca.SX.sym("a", len(self.commanded))
        limits = Limits.of(self.model, tuple(self.model.inputs))
        unlimited = self.unlimited_inputs(a, X, U, trim)
        # An input that no action moves keeps its trim value, even outside its limits.
        moved = [name in self.commanded for name in limits.names]
        low = np.where(moved, limits.lowest, -np.inf)
        high = np.where(moved, limits.highest, np.inf)
        within = _unless_nan(unlimited, saturated(unlimited, ca.DM(low), ca.DM(high)))
        return ca.Function("inputs", [a, X, U, trim], [ca.densify(within)])

    @cached_property
    def command(self) -> ca.Function:
        """Function (X, U, trim) -> commanded U. The argument U is the input before the sample."""
        X, U, trim = self.symbols(self.act)
        a = self.act(self.observe(X, U, trim))
        return ca.Function("command", [X, U, trim], [ca.densify(self.inputs(a, X, U, trim))])


def _rounded(value: ca.SX, entry: Mapping[str, Any]) -> ca.SX:
    """Return a value rounded to multiples of the quantizer of an entry, if it has one."""
    step = entry.get("quantizer")
    return value if step is None else step * ca.floor(value / step + 0.5)


def _unless_nan(seen: ca.SX, value: ca.SX) -> ca.SX:
    """Return an expression that equals `value`, but is NaN where `seen` is NaN."""
    # It is needed because a ReLU or a clip removes a NaN of its argument.
    is_number = ca.logic_or(seen <= 0.0, seen > 0.0)
    return ca.if_else(is_number, value, ca.DM.nan())


def _refuse_undefined(
    table: str,
    entries: Iterable[str],
    function: ca.Function,
    arguments: tuple[Any, ...],
    varied: tuple[int, ...],
) -> np.ndarray:
    """Return the values (k,) of a function, one for each entry of a table of the deployment file.

    varied: places of the arguments by which the derivatives must be finite

    Raises BadInputError that names an entry whose value or derivative is not finite.
    """
    values = np.array(function(*arguments)).ravel()
    slopes = function.jacobian()(*arguments, function(*arguments))  # also of the results (CasADi)
    by_varied = np.hstack([np.array(slopes[index]) for index in varied])
    is_defined = np.isfinite(values) & np.isfinite(by_varied).all(axis=1)
    for name, defined in zip(entries, is_defined.tolist(), strict=True):
        if not defined:
            raise BadInputError(
                f"{table}.{name}: the formula or the derivative is not finite at the trim; write "
                "a formula that is smooth at the trim"
            )
    return values
