"""What a report needs of a trim beyond the point itself: how it was found, slopes, lift, thrust."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Linearization
from hfa_aircraft.model import Model
from hfa_aircraft.signals import airspeed_output, recognized
from hfa_support.errors import BadInputError, NoSolutionError, NotFiniteError
from hfa_support.matrices import ROUNDING, balanced, spectral_abscissa
from hfa_support.reporting.rows import ByName, Group, Row
from hfa_support.reporting.text import digits_with_unit, shown_value
from hfa_support.units import conversion_factor, si_factor, si_unit
from trim.linear.modes import Mode, modes_of
from trim.linear.nonsmooth import means_at_nonsmooth_points
from trim.linear.reduction import Matrices, reduced
from trim.point.operating_point import OperatingPoint
from trim.point.problem import STARTS, TrimProblem
from trim.point.solve import MINOR, trim
from trim.point.status import BALANCE, Status
from trim.point.system import declared_start

#: Smaller scaled residuals are printed as "<= 1e-14": they are about fifty roundings, and differ
#: between processors.
_ROUNDING_RESIDUAL = 1e-14


def equations_of(point: OperatingPoint) -> dict[str, dict[str, Any]]:
    """Return name -> data on each equation of a trim: the imposed value, the residual, its
    tolerance, the unit, and whether it balances. A state stands for the equation of its rate.
    """
    condition = point.trim_problem.asked
    imposed = {**condition.imposed, **condition.rates}
    equations = {}
    for name, residual in point.residuals.items():
        tolerance = BALANCE * point.scale(name)
        equations[name] = {
            "imposed": imposed[name],
            "residual": residual,
            "tolerance": tolerance,
            "unit": point.equation_unit(name),
            "ok": abs(residual) <= tolerance,
        }
    return equations


def equations_group(point: OperatingPoint) -> Group:
    """Return a row for each equation with its residual, those that do not balance first."""
    rows = []
    for name, entry in sorted(equations_of(point).items(), key=lambda item: item[1]["ok"]):
        row = Row(
            f"rate of {name}" if name in point.model.states else name,
            entry["residual"],
            entry["unit"],
            f"{'PASS' if entry['ok'] else 'FAIL'}, tolerance {entry['tolerance']:.2e}",
            digits=3,
            least=_ROUNDING_RESIDUAL * entry["tolerance"] / BALANCE,
            tone="good" if entry["ok"] else "bad",
            in_degrees=False,
        )
        rows.append(row)
    return Group("equations", tuple(rows))


def balance_row(point: OperatingPoint) -> Row:
    """Return the row of the largest residual of the equations, relative to their scales."""
    count = len(point.residuals)
    wrong = sum(abs(residual) > BALANCE for residual in point.scaled_residuals.values())
    verdict, tone = f"all {count} equations balance", ""
    if wrong:
        verdict, tone = f"{wrong} of {count} equations do not balance", "bad"
    note = f"of its scale, tolerance {BALANCE:.0e}: {verdict}"
    return Row("largest residual", point.residual, note=note, least=_ROUNDING_RESIDUAL, tone=tone)


def other_trims(problem: TrimProblem, point: OperatingPoint) -> list[OperatingPoint]:
    """Return further trims of a problem with as many equations as unknowns.

    These are the trims that Newton's method finds from the declared initial values and from
    `STARTS` points within the limits, for example on the back side of the power curve. More trims
    may exist. The list is empty if the numbers of equations and unknowns differ: the trims are then
    a continuum, or there are none.

    problem: the solved problem
    point: the trim
    """
    trim = problem.system.scaled(point.values)  # vector of the unknowns, (k,)
    equations, unknowns = problem.count
    starts = [*problem.starts(trim)]
    if not starts or equations != unknowns:
        return []
    starts.append(problem.system.scaled(declared_start(problem.model, problem.asked.imposed)))
    trims = [trim]
    for z in filter(problem.solved, problem.ends_within(starts)):
        # Two solutions are one trim up to rounding if the equations also balance between them.
        is_known = any(
            all(problem.balanced(z + share * (known - z)) for share in (0.25, 0.5, 0.75))
            for known in trims
        )
        if not is_known:
            trims.append(z)
    return [OperatingPoint._of(problem, z, Status.TRIMMED) for z in trims[1:]]


def _other_trim(problem: TrimProblem, point: OperatingPoint, other: OperatingPoint) -> str:
    """Return a sentence on another trim, with an initial point that leads to it."""
    model = problem.model
    # Differences of at most `MINOR` of the largest one are left out.
    differences = np.abs(problem.system.scaled(other.values) - problem.system.scaled(point.values))
    different = np.flatnonzero(differences > MINOR * differences.max())
    names = [problem.free[i] for i in different]
    values = ", ".join(f"{name} {model.describe(name, other.values[name])}" for name in names)
    # States decide which trim is found; the search chooses the inputs that balance them.
    begin = [name for name in names if name not in model.inputs] or names
    typed = ",".join(
        f"{name}={shown_value(other.values[name], model.unit(name))}" for name in begin
    )
    return f"Another trim exists: {values}; the initial point {typed} leads to it"


#: Output, input, entry of the configuration or parameter that balances need -> unit.
QUANTITIES = {
    **dict.fromkeys(("lift", "drag", "thrust", "weight"), "N"),
    **dict.fromkeys(("load_factor", "mach", "lift_coefficient", "drag_coefficient"), "1"),
    **{"gamma": "rad", "turn_rate": "rad/s", "climb_rate": "m/s", "kcas": "m/s", "keas": "m/s"},
    **{"dynamic_pressure": "N/m^2", "pitching_moment": "N m", "reference_area": "m^2"},
    **{"gravity": "m/s^2", "mass": "kg", "reference_chord": "m", "reference_span": "m"},
    **dict.fromkeys(("Izz", "Ixz"), "kg m^2"),
}
#: Role of a state, whose rate is ROLE_dot -> unit.
ROLES = {
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "yaw"), "rad"),
    **dict.fromkeys("pqr", "rad/s"),
    **dict.fromkeys(("speed", *"uvw"), "m/s"),
    "altitude": "m",
}
#: Outputs whose derivatives are computed, if the model has them.
OUTPUTS = (*QUANTITIES, "thrust_force")
#: Names of the output or input with the thrust; the first that a model declares is used.
_THRUST_NAMES = ("thrust_force", "thrust")
#: Number of angles of attack at which the largest lift is searched.
_ANGLE_COUNT = 200
#: Why a largest lift is unknown: neither is CL_max declared, nor has the lift a maximum over alpha.
_NO_MAXIMUM = "no CL_max, and lift without a maximum"
#: Change of the speed between a trim and its neighbors, kt.
_SPEED_CHANGE = 0.5


def value_text(model: Model, name: str, value: float) -> str:
    """Return a value of a signal with its unit as text, in five digits: "40,000 ft"."""
    return digits_with_unit(value, model.unit(name), 5, model.signal(name).nominal)


def named_value_text(point: OperatingPoint, name: str) -> str:
    """Return a signal with its value at a point as text: "beta 5 deg"."""
    return f"{name} {value_text(point.model, name, point[name])}"


#: Entry of the configuration, as models name signals or `About.configuration` -> name on the sheet.
ENTRIES = {
    "mass": "mass",
    "center_of_gravity": "c.g.",
    "center_of_gravity_x": "c.g. x",
    "center_of_gravity_y": "c.g. y",
    "center_of_gravity_z": "c.g. z",
    "Ixx": "Ixx",
    "Iyy": "Iyy",
    "Izz": "Izz",
    "Ixz": "Ixz",
    "reference_area": "S",
    "reference_span": "b",
    "reference_chord": "c",
    "flap": "flap",
    "gear": "gear",
}
#: Entry -> its parameter, where that has another name.
PARAMETER_OF_ENTRY = {"center_of_gravity": "cg"}


#: States that are 0 in a model that has none of them, as in longitudinal motion.
LATERAL = ("beta", "p", "r", "phi", "v")


class Quantity(NamedTuple):
    """Number with its unit, or a word, such as that on a gear, with the unit "".

    value: a number, or a word
    unit: unit of the number
    """

    value: Any
    unit: str


class Known(NamedTuple):
    """Quantity of a model in SI units.

    name: name in the model, "" of a constant
    unit: its unit there, "" of a rate
    value: its value
    slopes: derivatives by the states and inputs, (n + m,)
    """

    name: str
    unit: str
    value: float
    slopes: np.ndarray


class PullUp(NamedTuple):
    """Steady pull-up or push-over at constant speed, per unit of one input.

    name: input that pitches the aircraft most
    alpha: change of alpha, rad per unit of the input
    load_factor: change of the load factor per unit of the input; nan without this output
    """

    name: str
    alpha: float
    load_factor: float


class LargestLift(NamedTuple):
    """Largest lift at the speed and the inputs of a trim.

    lift: the lift, in the unit of the model
    alpha: angle of attack at which the lift has this value, rad; nan if it is unknown
    trim_is_beyond: whether the trim is at a larger alpha, where the lift falls with alpha
    """

    lift: float
    alpha: float = math.nan
    trim_is_beyond: bool = False

    @property
    def where(self) -> str:
        """The angle of attack as text, or ""."""
        return f"at alpha {math.degrees(self.alpha):.4g} deg" if math.isfinite(self.alpha) else ""


class Trimmed:
    """An operating point with the results that several figures need, each computed once.

    Values are in radians and coherent units, so that figures are those of any units.

    point: the point in the units of its condition
    coherent: the point in coherent units
    model: model in coherent units
    unit: function name of a state, input or output -> its unit
    roles: role in the motion of a rigid body -> state ("speed", "alpha", "theta", ...)
    airspeed_name: state or output that is the true airspeed, or ""
    known: names of the states, inputs and outputs, of which trimmed["lift"] is a value
    rates: state -> its rate, in the units of the condition
    per_second: factor from the model's unit of time to seconds, of eigenvalues
    imposed: variable -> value that the condition of the point imposes
    thrust_name: name of the output, input or state with the thrust, or ""
    """

    def __init__(self, point: OperatingPoint) -> None:
        """Compute what each report needs; all else is computed when it is read."""
        self.point = point
        self.coherent = point.in_coherent_units
        self.model: Model = self.coherent.model
        self.unit = self.model.unit
        self.roles = recognized(self.model.states)
        found = point.found_by
        self.imposed: Mapping[str, float] = {} if found is None else found.condition.imposed
        self.airspeed_name = self.roles.get("speed") or airspeed_output(self.model.outputs)
        self.known = {*self.model.inputs, *self.model.outputs, *self.model.states}
        self.rates = point.model.rates_at(point.states, point.inputs)
        self.thrust_name = next((name for name in _THRUST_NAMES if name in self.known), "")
        self.per_second = conversion_factor(f"1/{self.model.time_unit}", "1/s") or 1.0

    def __getitem__(self, name: str) -> float:
        """Return the value of a state, an input or an output, in coherent units."""
        return self.coherent[name]

    def lacks(self, *names: str, nonzero: Sequence[str] = ()) -> str:
        """Return why a figure cannot be computed from outputs, or "" if it can. A reason is that
        the model does not have all outputs, or that an output in `nonzero`, by which the figure
        divides, is 0 or not finite.
        """
        missing = [name for name in (*names, *nonzero) if name not in self.model.outputs]
        if missing:
            return f"no output {', '.join(dict.fromkeys(missing))}"
        for name in nonzero:
            if not self[name] or not math.isfinite(self[name]):
                return f"the {name.replace('_', ' ')} is {self[name]:g}"
        return ""

    @cached_property
    def configuration(self) -> dict[str, Quantity]:
        """Mass, center of gravity, inertias and sizes as far as known, by name, in the units of the
        condition.

        A value is that of `About.configuration`, else that of a parameter, an output or an input
        with the name of the entry. An unknown mass is the weight divided by the gravity.
        """
        point = self.point
        model = point.model
        native = model.native
        configuration: dict[str, Quantity] = {}
        in_si = native is not model

        # `About.configuration` takes and returns units of the aircraft's file.
        if native.about.configuration is not None:
            vectors = (
                model.native_values(tuple(names), vector)
                for names, vector in (
                    (model.states, point.states),
                    (model.inputs, point.inputs),
                    (model.parameters, model.p),
                )
            )
            for name, (value, unit) in native.about.configuration(*vectors).items():
                factor = si_factor(unit) if in_si else 1.0
                number = value if isinstance(value, str) else float(value) * factor
                configuration[name] = Quantity(number, si_unit(unit) if in_si else unit)

        parameters = dict(zip(model.parameters, model.p.tolist(), strict=True))
        for entry in ENTRIES:
            name = entry if entry in model.signals else PARAMETER_OF_ENTRY.get(entry, "")
            if entry not in configuration and name in (*parameters, *model.outputs, *model.inputs):
                value = parameters[name] if name in parameters else point[name]
                configuration[entry] = Quantity(value, model.unit(name))
        if "mass" not in configuration and "weight" in model.outputs and parameters.get("gravity"):
            unit = {"lbf": "slug", "N": "kg"}.get(model.unit("weight"), "")
            if unit:
                configuration["mass"] = Quantity(point["weight"] / parameters["gravity"], unit)
        return configuration

    def role(self, name: str) -> float:
        """Return the state with a role; nan without it, but 0 for beta, p, r, phi and v of a model
        that has none of these.
        """
        if name in self.roles:
            return self[self.roles[name]]
        return 0.0 if name in LATERAL and self.roles.keys().isdisjoint(LATERAL) else math.nan

    @cached_property
    def airspeed(self) -> Quantity | None:
        """True airspeed: a state or output that is recognized as one, or that of u, v and w in body
        axes; None for a model without them.
        """
        if self.airspeed_name:
            return Quantity(self[self.airspeed_name], self.unit(self.airspeed_name))
        speed = math.hypot(*map(self.role, "uvw"))
        return None if math.isnan(speed) else Quantity(speed, self.unit(self.roles["u"]))

    @property
    def in_wind(self) -> bool:
        """Whether the model has a steady wind, such as a parameter wind_north that is not 0."""
        parameters = self.model.parameters.items()
        return any(name.startswith("wind_") and signal.start for name, signal in parameters)

    @property
    def alpha(self) -> float:
        """Angle of attack, rad, nan if it is unknown."""
        if "alpha" in self.roles or "w" not in self.roles:
            return self.role("alpha")
        return math.atan2(self.role("w"), self.role("u"))

    @property
    def flight_path(self) -> float:
        """Flight-path angle, rad, or nan if it is unknown."""
        if "gamma" in self.model.outputs:
            return self["gamma"]
        if "w" not in self.roles:
            return self.role("theta") - self.role("alpha")
        u, v, w, theta, phi = map(self.role, ("u", "v", "w", "theta", "phi"))
        down = (v * math.sin(phi) + w * math.cos(phi)) * math.cos(theta) - u * math.sin(theta)
        return -math.asin(down / (math.hypot(u, v, w) or math.nan))

    # Derivatives.

    @cached_property
    def fault(self) -> str:
        """Why the trim has no derivatives and no modes, if one is not a number; otherwise ""."""
        try:
            _ = self.slopes
        except NotFiniteError as error:
            return str(error)
        return ""

    @cached_property
    def at(self) -> Linearization:
        """Rates, outputs of `OUTPUTS` that the model has, and their derivatives, at a nonsmooth
        point those of one side. Raises NotFiniteError at a point with a `fault`.
        """
        return self.model.at(self.coherent.states, self.coherent.inputs, self._outputs)

    @property
    def _outputs(self) -> list[str]:
        """The outputs of `OUTPUTS` that the model has."""
        return [name for name in OUTPUTS if name in self.model.outputs]

    @cached_property
    def slopes(self) -> Matrices:
        """Derivatives of all rates and of some outputs, with mean slopes at nonsmooth points.

        Raises NotFiniteError at a point with a `fault`.
        """
        at, model, point = self.at, self.model, self.coherent
        x, u, p = (np.array(each)[None] for each in (point.states, point.inputs, model.p))
        A, B, _ = means_at_nonsmooth_points(model, x, u, p, at.A[None], at.B[None])
        names = (*model.states,), (*model.inputs,), (*self._outputs,)
        return Matrices(A[0], B[0], at.C, at.D, at.E, at.F, at.y, *names)

    @cached_property
    def quantities(self) -> dict[str, Known]:
        """Role, ROLE_dot and name of `QUANTITIES` -> the quantity, as far as the model has it in a
        known unit. At a nonsmooth point, the slopes of all are those of one side.

        Raises NotFiniteError at a point with a `fault`.
        """
        at, model, roles = self.at, self.model, self.roles
        columns = (*model.states, *model.inputs)
        none = np.zeros(len(columns))
        by = dict(zip(columns, np.eye(len(columns)), strict=True))
        by |= zip(self._outputs, np.hstack([at.C, at.D]), strict=True)
        rates = dict(zip(model.states, at.f, strict=True))
        by_rates = dict(zip(model.states, np.hstack([at.A, at.B]), strict=True))
        parameters = self.point.model.parameters
        names = {symbol: symbol for symbol in QUANTITIES} | roles | {"thrust": self.thrust_name}
        if "yaw" in model.states:
            names["yaw"] = "yaw"
        known: dict[str, Known] = {}
        for symbol, unit in (ROLES | QUANTITIES).items():
            name = names.get(symbol, "")
            if name in self.known:
                value, of, slopes = self[name], self.unit(name), by.get(name, none)
            elif name in self.configuration:
                (value, of), slopes = self.configuration[name], none
            elif name in parameters:
                value, of, slopes = parameters[name].start, parameters[name].unit, none
            else:
                if symbol in LATERAL and roles.keys().isdisjoint(LATERAL):
                    known |= dict.fromkeys((symbol, f"{symbol}_dot"), Known("", "", 0.0, none))
                continue
            factor = conversion_factor(of, unit)
            if factor is not None:
                known[symbol] = Known(name, of, float(value) * factor, slopes * factor)
                if symbol in ROLES:
                    second = self.per_second * factor
                    rate, slopes = rates[name] * second, by_rates[name] * second
                    known[f"{symbol}_dot"] = Known(f"{name}_dot", "", float(rate), slopes)
        return known

    @cached_property
    def linear_A(self) -> np.ndarray:
        """Derivatives of the rates of the model's linear states by these states, (n, n)."""
        rows = self.model.state_places(self.model.linear)
        return self.slopes.A[np.ix_(rows, rows)]

    @cached_property
    def modes(self) -> ByName[Mode]:
        """Modes of the linear model, fastest first. A trim with a `fault` has none."""
        if self.fault:
            return ByName()
        return ByName(modes_of(self.linear_A, self.model.linear, self.model.modes))

    @cached_property
    def quasi_steady(self) -> Matrices:
        """Derivatives by the states that are no lags, while the lags have their steady values."""
        return reduced(self.slopes, None, None, self._lags())

    def _lags(self) -> list[str]:
        """Return the lags: linear states that are no states of motion, such as those of engines and
        unsteady lift. The list is empty if the lags have no steady state.
        """
        # States of motion are those that `recognized` names, and each position with its rate: a
        # state whose rate depends on one other state alone.
        slopes, names = self.slopes, self.slopes.states
        # An altitude is a role only beside speed and alpha, but lags nothing in any model.
        of_motion = {*self.roles.values(), "altitude"}
        for position, row in enumerate(slopes.A):
            depends_on = np.flatnonzero(row)
            is_integral = len(depends_on) == 1 and depends_on[0] != position
            if is_integral and not slopes.B[position].any():
                of_motion |= {names[position], names[depends_on[0]]}
        lags = [name for name in names if name in self.model.linear and name not in of_motion]
        places = self.model.state_places(lags)
        if lags and spectral_abscissa(slopes.A[np.ix_(places, places)]) >= 0.0:
            return []
        return lags

    @cached_property
    def search(self) -> list[str]:
        """Sentences on the search for the trim and its result."""
        point, problem = self.point, self.point.trim_problem
        equations, unknowns = problem.count
        sentences = []
        if point.status == Status.TRIMMED and unknowns > equations:
            sentences.append(
                f"Least effort: {unknowns} unknowns for {equations} equations, so this is the "
                "trim with the least Σ (input / scale)² near the initial point"
            )
        if point.initial_point:
            sentences.append(
                f"Found from initial point {point.initial_point} of {STARTS} between the limits"
            )
        others = other_trims(problem, point) if point.status == Status.TRIMMED else []
        return [*sentences, *(_other_trim(problem, point, other) for other in others)]

    # Maneuvers.

    @cached_property
    def pull_up(self) -> PullUp | None:
        """Steady changes of alpha and load factor after a step of the input that pitches the
        aircraft most, at constant speed and flight path. Lags follow, and all other states except
        alpha, pitch angle and pitch rate are held.

        The result is None if the short period does not consist of alpha and one other state, or if
        no input changes the rate of that state.
        """
        model = self.model
        declared = [name for name in model.modes.get("short period", ()) if name in model.linear]
        alpha = self.roles.get("alpha", "")
        others = [name for name in declared if name != alpha]
        if alpha not in declared or len(others) != 1 or not model.inputs:
            return None
        steady = self.quasi_steady
        if not {alpha, *others} <= {*steady.states}:  # the other state is a lag
            return None
        places = [steady.states.index(name) for name in (alpha, *others)]
        # Columns: changes of the states with alpha, the pitch angle at a held path, and with q.
        motion = np.eye(len(steady.states))[:, places]
        if "theta" in self.roles:
            pitch = steady.states.index(self.roles["theta"])
            motion[pitch, 0] = 1.0
            if "gamma" in steady.outputs:
                path = steady.C[steady.outputs.index("gamma")]
                motion[pitch, 0] = -path[places[0]] / path[pitch] if path[pitch] else 1.0
        A = steady.A[places] @ motion
        B = steady.B[places]
        # Rates of the other state, such as the pitch rate, that the nominal inputs cause.
        _, pitching = np.abs(B) * model.nominal(model.inputs)
        strongest = int(np.argmax(pitching))
        if not pitching[strongest] or np.linalg.matrix_rank(balanced(A)[0]) < len(A):
            return None  # no input pitches the aircraft, or no steady state exists
        steady_changes = -np.linalg.solve(A, B[:, strongest])
        load = math.nan
        if "load_factor" in model.outputs:
            row = steady.outputs.index("load_factor")
            load = float(steady.C[row] @ motion @ steady_changes + steady.D[row, strongest])
        return PullUp(tuple(model.inputs)[strongest], float(steady_changes[0]), load)

    def change_per_knot(self, name: str) -> float | None:
        """Return the change of an input per knot between trims 0.5 kt slower and faster.

        The result is None if the speed is free or the input is held, or if a trim does not exist.
        """
        point = self.point
        speed = self.roles["speed"]
        knot = conversion_factor("kt", point.model.unit(speed))
        condition = point.trim_problem.condition
        if knot is None or speed not in condition.imposed or name in condition.imposed:
            return None
        values = []
        for change in (-_SPEED_CHANGE, _SPEED_CHANGE):
            imposed = {**condition.imposed, speed: point[speed] + change * knot}
            try:
                values.append(trim(point.model, replace(condition, imposed=imposed), point)[name])
            except (BadInputError, NoSolutionError):  # beyond the limits
                return None
        slope = (values[1] - values[0]) / (2.0 * _SPEED_CHANGE)
        return slope * (conversion_factor(point.model.unit(name), self.unit(name)) or 1.0)

    # Thrust and lift.

    @cached_property
    def thrust_available(self) -> float | str:
        """Thrust at the highest values of its inputs, or why it is unknown."""
        model, name = self.model, self.thrust_name
        if not name:
            return "no output thrust"
        if name in model.inputs:
            highest = model.inputs[name].max
            return highest if math.isfinite(highest) else "no upper limit of the thrust"
        if name in model.states:
            return f"the thrust follows the state {name}"
        if self.fault:
            return "a derivative is not a number"
        row = self.slopes.outputs.index(name)
        by_states, by_inputs = self.slopes.C[row], self.slopes.D[row]
        # An altitude is a role only beside speed and alpha, but lags nothing in any model.
        of_motion = {*self.roles.values(), "altitude"}
        for state, slope in zip(model.states, by_states, strict=True):
            if slope and state not in of_motion:  # a state of the engine, which lags its lever
                return f"the thrust follows the state {state}"
        levers = [lever for lever, slope in zip(model.inputs, by_inputs, strict=True) if slope]
        full = self.coherent.inputs._replace(**{lever: model.inputs[lever].max for lever in levers})

        thrust = math.inf
        if levers and np.isfinite(full).all():
            thrust = model.outputs_at(self.coherent.states, full, (name,))[name]
        if not math.isfinite(thrust):
            return "no upper limit of the inputs that change the thrust"
        return thrust

    @cached_property
    def largest_lift(self) -> LargestLift | str:
        """Largest lift at the speed and the inputs of the trim, or why it is unknown.

        - with a declared CL_max: q S CL_max, at the first alpha above the trim at which the output
          `lift` has this value
        - if the lift rises with alpha at the trim: the first maximum above the trim
        - if the lift falls with alpha at the trim, which is stalled: the nearest maximum below it
        """
        if reason := self.lacks("lift", nonzero=("dynamic_pressure", "reference_area", "lift")):
            return reason
        model, alpha = self.model, self.roles.get("alpha", "")
        if not alpha:
            return "no state alpha"
        lowest, highest = model.states[alpha].min, model.states[alpha].max
        if alpha in model.domain.range:
            valid_from, valid_to, _ = model.domain.range[alpha]
            lowest, highest = max(lowest, valid_from), min(highest, valid_to)
        is_limited = math.isfinite(lowest) and math.isfinite(highest)

        here = self[alpha]
        # Angles from that of the trim, which may itself exceed the limit.
        above = np.linspace(here, max(highest, here), _ANGLE_COUNT) if is_limited else None
        lift = self._lift_over(alpha)
        if "largest_lift_coefficient" in model.outputs:
            force = self["dynamic_pressure"] * self["reference_area"]
            largest = force * self["largest_lift_coefficient"]
            reached_at = math.nan
            if above is not None:
                below_rounding = largest - ROUNDING * abs(largest)
                reached_at = _first_below_zero(lambda at: below_rounding - lift(at)[0], above)
            return LargestLift(largest, reached_at)

        if above is None:
            return _NO_MAXIMUM
        (_, slope), sign = lift(here)[:, 0], 1.0
        is_stalled = bool(slope < 0.0)
        if is_stalled:  # downward from the trim, so that the first peak is the nearest one
            above, sign = np.linspace(here, min(lowest, here), _ANGLE_COUNT), -1.0
        peak = _first_below_zero(lambda at: sign * lift(at)[1], above)
        if math.isnan(peak):
            return _NO_MAXIMUM
        return LargestLift(float(lift(peak)[0, 0]), peak, is_stalled)

    def _lift_over(self, alpha: str) -> Callable[[Any], np.ndarray]:
        """Return the function angles of attack (N,) -> output `lift` and its slope by alpha (2, N),
        with all other variables as at the trim.
        """
        model = self.model
        angle = ca.SX.sym(alpha)
        state = self.coherent.states._replace(**{alpha: angle})
        _, lift = model.layout.expressions((state, self.coherent.inputs, model.p), ("lift",))
        function = ca.Function("lift", [angle], [ca.vertcat(lift, ca.jacobian(lift, angle))])
        return lambda angles: np.asarray(function(np.atleast_1d(angles)[None]).full())


def _first_below_zero(function: Callable[[Any], np.ndarray], angles: np.ndarray) -> float:
    """Return the first angle in a range, (N,), at which a function passes 0 downward; nan if it is
    below 0 at the first angle already, or at none, up to rounding.
    """
    values = function(angles)
    below = np.flatnonzero(values < -ROUNDING * np.abs(values).max())
    if not below.size or below[0] == 0:
        return math.nan
    from scipy.optimize import brentq

    ends = angles[below[0] - 1], angles[below[0]]
    return float(brentq(lambda angle: function(angle).item(), *ends))
