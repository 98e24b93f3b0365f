"""A trim with what its figures are computed from: outputs, slopes, pull-up, largest lift, modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Linearization
from hfa_aircraft.model import Model, recognized
from hfa_support.errors import BadInputError, NoSolutionError, NotFiniteError
from hfa_support.matrices import ROUNDING, balanced, spectral_abscissa
from hfa_support.reporting.rows import ByName
from hfa_support.reporting.text import digits_with_unit
from hfa_support.units import conversion_factor
from trim.linear.kinks import linearization_at
from trim.linear.modes import Mode, modes_of
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim
from trim.reports.search import Search, search_of

#: Outputs whose derivatives are figures.
_SLOPED = ("lift", "pitching_moment", "load_factor", "thrust_force", "thrust", "gamma")
#: Names of the output or input with the thrust; the first that a model declares is used.
_THRUST = ("thrust_force", "thrust")
#: Number of angles of attack at which the largest lift is searched, and its accuracy, rad.
_ANGLES = 200
_ACCURACY = 1e-7
#: Change of the speed between a trim and its neighbors, kt.
_KNOTS = 0.5


def value_text(model: Model, name: str, value: float) -> str:
    """Return a value of a signal with its unit as text, in five digits: "40,000 ft"."""
    return digits_with_unit(value, model.unit(name), 5, model.signal(name).nominal)


def named_value_text(point: OperatingPoint, name: str) -> str:
    """Return a signal with its value at a point as text: "beta 5 deg"."""
    return f"{name} {value_text(point.model, name, point[name])}"


class Slopes(NamedTuple):
    """Derivatives at a trim, by states (n,) and inputs (m,) named in order.

    states: names of the states
    A, B: derivatives of their rates, (n, n) and (n, m)
    outputs: name -> derivatives by the states and by the inputs
    """

    states: tuple[str, ...]
    A: np.ndarray
    B: np.ndarray
    outputs: dict[str, OutputSlopes]


class OutputSlopes(NamedTuple):
    """Derivatives of an output by the states, (n,), and by the inputs, (m,)."""

    by_states: np.ndarray
    by_inputs: np.ndarray


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
    passed: whether the trim is beyond this angle, where the lift falls with alpha
    """

    lift: float
    alpha: float = math.nan
    passed: bool = False


class Trimmed:
    """An operating point with the results that several figures need, each computed once.

    Values are in radians and coherent units, so that figures are those of any units.

    point: the point in the units of its condition
    coherent: the point in coherent units
    model: model in coherent units
    roles: role in the motion of a rigid body -> state ("speed", "alpha", "theta", ...)
    """

    def __init__(self, point: OperatingPoint) -> None:
        self.point = point
        self.coherent = point.in_coherent_units
        self.model: Model = self.coherent.model
        self.roles = recognized(self.model.states)

    @cached_property
    def values(self) -> dict[str, float]:
        """State, input or output -> value."""
        return dict(self.coherent)

    @cached_property
    def rates(self) -> dict[str, float]:
        """State -> its rate, in the units of the condition."""
        return self.point.model.rates_at(self.point.states, self.point.inputs)

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def unit(self, name: str) -> str:
        """Return the unit of a state, input or output."""
        return self.model.unit(name)

    def lacks(self, *names: str) -> str:
        """Return which of some outputs are not in the model, as a reason, or ""."""
        missing = [name for name in names if name not in self.model.outputs]
        return f"no output {', '.join(missing)}" if missing else ""

    def zero(self, *names: str) -> str:
        """Return which of some outputs is 0 or not a number, as a reason, or ""."""
        for name in names:
            if not self[name] or not math.isfinite(self[name]):
                return f"the {name.replace('_', ' ')} is {self[name]:g}"
        return ""

    @property
    def flight_path(self) -> float:
        """Flight-path angle, rad, or nan if it is unknown."""
        if "gamma" in self.model.outputs:
            return self["gamma"]
        if {"theta", "alpha"} <= {*self.roles}:
            return self[self.roles["theta"]] - self[self.roles["alpha"]]
        return math.nan

    # Derivatives.

    @cached_property
    def _linearization(self) -> Linearization | str:
        """The derivatives with mean slopes at kinks, or why they do not exist."""
        names = [name for name in _SLOPED if name in self.model.outputs]
        try:
            slopes, _ = linearization_at(self.model, self.coherent.x, self.coherent.u, names)
        except NotFiniteError as error:
            return str(error)
        return slopes

    @property
    def fault(self) -> str:
        """Reason why the trim has no derivatives and no modes, or ""."""
        found = self._linearization
        return found if isinstance(found, str) else ""

    @cached_property
    def slopes(self) -> Slopes:
        """Derivatives of all rates and of some outputs. The point must not have a `fault`."""
        found = self._linearization
        assert not isinstance(found, str)
        names = [name for name in _SLOPED if name in self.model.outputs]
        outputs = map(OutputSlopes, found.C, found.D)
        return Slopes(
            self.model.state_names, found.A, found.B, dict(zip(names, outputs, strict=True))
        )

    @cached_property
    def A(self) -> np.ndarray:
        """Derivatives of the rates of the model's linear states, (n, n)."""
        rows = self.model.state_places(self.model.linear)
        return self.slopes.A[np.ix_(rows, rows)]

    @cached_property
    def modes(self) -> ByName[Mode]:
        """Modes of the linear model, fastest first; none with a `fault`."""
        if self.fault:
            return ByName()
        return ByName(modes_of(self.A, self.model.linear, self.model.modes))

    @property
    def per_second(self) -> float:
        """Factor from the model's unit of time to seconds, of eigenvalues."""
        return conversion_factor(f"1/{self.model.time_unit}", "1/s") or 1.0

    @cached_property
    def quasi_steady(self) -> Slopes:
        """Derivatives by the states that are no lags, with the lags residualized:
        x2 = -A22⁻¹ (A21 x1 + B2 u) for the lags x2 and the other states x1.
        """
        slopes = self.slopes
        names = slopes.states
        lags = self._lags()
        kept = [i for i in range(len(names)) if i not in lags]
        A22 = slopes.A[np.ix_(lags, lags)]
        lags_by_states = -np.linalg.solve(A22, slopes.A[np.ix_(lags, kept)])
        lags_by_inputs = -np.linalg.solve(A22, slopes.B[lags])

        def with_lags(by_states: np.ndarray, by_inputs: np.ndarray) -> OutputSlopes:
            """Return the slopes by the kept states and by the inputs while the lags follow."""
            of_lags = by_states[..., lags]
            return OutputSlopes(
                by_states[..., kept] + of_lags @ lags_by_states,
                by_inputs + of_lags @ lags_by_inputs,
            )

        rates = with_lags(slopes.A[kept], slopes.B[kept])
        outputs = {name: with_lags(*each) for name, each in slopes.outputs.items()}
        return Slopes(tuple(names[i] for i in kept), rates.by_states, rates.by_inputs, outputs)

    def _lags(self) -> list[int]:
        """Return the indices of the linear states without a meaning in the motion of a body, or
        none if these have no stable steady state.

        They are no state that `recognized` names, no altitude, no position whose rate is a state,
        and no rate of a position.
        """
        slopes = self.slopes
        names = slopes.states
        of_motion = {*self.roles.values(), "altitude"}
        for position, row in enumerate(slopes.A):
            depends_on = np.flatnonzero(row)
            is_integral = len(depends_on) == 1 and depends_on[0] != position
            if is_integral and not slopes.B[position].any():
                of_motion |= {names[position], names[depends_on[0]]}
        linear = self.model.linear
        lags = [i for i, name in enumerate(names) if name in linear and name not in of_motion]
        if lags and spectral_abscissa(slopes.A[np.ix_(lags, lags)]) >= 0.0:
            return []
        return lags

    @cached_property
    def search(self) -> Search:
        """What is said on the search for the trim."""
        return search_of(self.point)

    # Maneuvers.

    @cached_property
    def pull_up(self) -> PullUp | None:
        """Steady changes of alpha and load factor after a step of the input that pitches the
        aircraft most. Lags follow, and all other states except alpha and pitch rate are held.

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
        if not {alpha, *others} <= {*steady.states}:
            return None
        places = [steady.states.index(name) for name in (alpha, *others)]
        A = steady.A[np.ix_(places, places)]
        B = steady.B[places]
        _, pitching = np.abs(B) * model.nominal(model.inputs)
        strongest = int(np.argmax(pitching))
        if not pitching[strongest] or np.linalg.matrix_rank(balanced(A)[0]) < len(A):
            return None
        at_rest = -np.linalg.solve(A, B[:, strongest])
        load = math.nan
        if "load_factor" in model.outputs:
            slopes = steady.outputs["load_factor"]
            load = float(slopes.by_states[places] @ at_rest + slopes.by_inputs[strongest])
        return PullUp(tuple(model.inputs)[strongest], float(at_rest[0]), load)

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
        for change in (-_KNOTS, _KNOTS):
            imposed = {**condition.imposed, speed: point[speed] + change * knot}
            try:
                values.append(trim(point.model, replace(condition, imposed=imposed), point)[name])
            except (BadInputError, NoSolutionError):  # beyond the limits
                return None
        slope = (values[1] - values[0]) / (2.0 * _KNOTS)
        return slope * (conversion_factor(point.model.unit(name), self.unit(name)) or 1.0)

    # Thrust and lift.

    @property
    def thrust_name(self) -> str:
        """Name of the output, input or state with the thrust, or ""."""
        known = (*self.model.inputs, *self.model.outputs, *self.model.states)
        return next((name for name in _THRUST if name in known), "")

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
        slopes = self.slopes.outputs[name]
        of_motion = {*self.roles.values(), "altitude"}
        for state, slope in zip(model.states, slopes.by_states, strict=True):
            if slope and state not in of_motion:
                return f"the thrust follows the state {state}"
        levers = [each for each, slope in zip(model.inputs, slopes.by_inputs, strict=True) if slope]
        full = self.coherent.inputs._replace(**{each: model.inputs[each].max for each in levers})
        thrust = math.inf
        if levers and np.isfinite(full).all():
            thrust = model.outputs_at(self.coherent.states, full, (name,))[name]
        if not math.isfinite(thrust):
            return "no upper limit of the inputs that change the thrust"
        return thrust

    @cached_property
    def largest_lift(self) -> LargestLift | None:
        """Largest lift at the speed and the inputs of the trim, or None if it is unknown.

        The lift is q S CL_max with a declared CL_max; its alpha is the first above the trim at
        which the output `lift` has this value. Otherwise it is the first maximum of the lift over
        alpha, above the trim, or the last one below a trim at which the lift falls.
        """
        model, alpha = self.model, self.roles["alpha"]
        lowest, highest = model.states[alpha].min, model.states[alpha].max
        if alpha in model.domain.range:
            valid_from, valid_to, _ = model.domain.range[alpha]
            lowest, highest = max(lowest, valid_from), min(highest, valid_to)
        is_limited = math.isfinite(lowest) and math.isfinite(highest)
        here = self[alpha]
        above = np.linspace(here, max(highest, here), _ANGLES) if is_limited else None
        lift = self._lift_over(alpha)
        if "largest_lift_coefficient" in model.outputs:
            force = self["dynamic_pressure"] * self["reference_area"]
            largest = force * self["largest_lift_coefficient"]
            reached_at = math.nan if above is None else _first_at(lift, above, largest)
            return LargestLift(largest, reached_at)
        if above is None:
            return None
        slopes = np.diff(lift(above))
        is_stalled = bool(slopes.size and slopes[0] < 0.0)
        below = np.linspace(here, min(lowest, here), _ANGLES)
        peak = _first_peak(lift, below if is_stalled else above)
        if peak is None:
            return None
        return LargestLift(float(lift(np.array([peak]))[0]), peak, is_stalled)

    def _lift_over(self, alpha: str) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function: angles of attack (N,) -> `lift` (N,), otherwise at the point."""
        model = self.model
        angle = ca.SX.sym(alpha)
        state = self.coherent.states._replace(**{alpha: angle})
        _, lift = model.layout.expressions((state, self.coherent.inputs, model.p), ("lift",))
        function = ca.Function("lift", [angle], [lift])
        return lambda angles: np.asarray(function(angles[None]).full()[0])


def _first_peak(lift: Callable[[np.ndarray], np.ndarray], angles: np.ndarray) -> float | None:
    """Return the angle of the first maximum of the lift along some angles, or None.

    A lift that remains constant, as beyond the last breakpoint of a table, has no maximum.
    """
    lifts = lift(angles)
    falls = np.flatnonzero(np.diff(lifts) < -ROUNDING * np.abs(lifts).max())
    if not falls.size or falls[0] == 0:
        return None
    from scipy.optimize import minimize_scalar

    ends = sorted((angles[falls[0] - 1], angles[falls[0] + 1]))
    found = minimize_scalar(
        lambda angle: -float(lift(np.array([angle]))[0]),
        bounds=ends,
        method="bounded",
        options={"xatol": _ACCURACY},
    )
    return float(found.x)


def _first_at(
    lift: Callable[[np.ndarray], np.ndarray], angles: np.ndarray, largest: float
) -> float:
    """Return the first angle along some angles at which the lift reaches a value, or nan.

    It is nan if the lift has the value at the first angle already, or at none.
    """
    lifts = lift(angles)
    reached = np.flatnonzero(lifts >= largest)
    if not reached.size or reached[0] == 0:
        return math.nan
    from scipy.optimize import brentq

    low, high = angles[reached[0] - 1], angles[reached[0]]
    return float(brentq(lambda angle: float(lift(np.array([angle]))[0]) - largest, low, high))
