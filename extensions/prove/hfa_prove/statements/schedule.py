"""Statements of certificates about schedules and games.

The checker interprets or refuses every field. The digest covers all fields, and reports show them.
Data for the proof are separate (`witness.py`) and cannot change a claim. Scheduling values are
stored as a user types them, with angles in degrees, because their doubles are then exact. All other
numbers are in the units of the model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat

from hfa_aircraft.model import Model
from hfa_prove.fields import Fields, require
from hfa_prove.statements.plant import Subject, model_of
from verification.enclosure.balls import lowest_sign
from verification.enclosure.series import TaylorModel


class Run(NamedTuple):
    """Bounds on the number of unstable modes over a range of scheduling values.

    An unstable mode is an eigenvalue with positive real part. If `least` equals `most`, no
    eigenvalue is on the imaginary axis.

    low, high: ends of the range
    least, most: lowest and highest number at every scheduling value of the range
    """

    low: float
    high: float
    least: int
    most: int


class StatedTrim(NamedTuple):
    """Approximate values of the unknowns of a trim at one scheduling value.

    The proved trim is the only trim within `SAME_TRIM` nominal values of each unknown.

    breakpoint: scheduling value
    unknowns: unknown -> approximate value
    """

    breakpoint: float
    unknowns: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Flight:
    """Trims of an aircraft at every scheduling value from `low` to `high`, within its limits.

    model: the equations. The statement contains their name, units and source hash.
    parameters: every parameter of the model -> value
    spread: parameter -> half-width of the values that the claim covers
    imposed: imposed variable -> value, the same for every trim
    limits: state, input or output -> (lowest, highest)
    low: lowest scheduling value
    high: highest scheduling value
    trims: one stated trim for each branch of trims that the claim covers, in ascending order
    """

    model: Model
    parameters: Mapping[str, float]
    spread: Mapping[str, float]
    imposed: Mapping[str, float]
    limits: Mapping[str, tuple[float, float]]
    low: float
    high: float
    trims: tuple[StatedTrim, ...]

    def value(self, scheduling_value: Any) -> Any:
        """Return a scheduling value in the unit of the model, as a ball or a double.

        An angle is converted from degrees to rad. For a ball, π is enclosed.
        """
        return in_model_unit(self.model, scheduling_value)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns of a trim."""
        imposed = (self.model.schedule, *self.imposed)
        return tuple(name for name in self.model.variables if name not in imposed)

    @classmethod
    def read(cls, entries: Fields, model: Model, *, point: bool) -> Flight:
        """Return the trims that a certificate claims.

        entries: reader of the entry that describes the aircraft and its trims
        point: whether `low` and `high` must be equal

        Raises Malformed for the first wrong entry.
        """
        for name, fact in facts_of(model).items():
            entries.same(name, fact)
        scheduled = model.schedule
        holdable = [name for name in model.holdable if name != scheduled]
        low, high = entries.pair("range")
        require((low == high) == point, "range", [low, high])
        parameters = entries.all_numbers("parameters", tuple(model.parameters))
        spread = entries.numbers("spread", [] if point else model.parameters)
        require(all(width > 0.0 for width in spread.values()), "spread")
        require(scheduled not in spread, "spread", scheduled)
        imposed = entries.numbers("imposed", holdable)
        flight = cls(
            model, parameters, spread, imposed, _read_limits(entries, model), low, high, ()
        )
        require(bool(flight.unknowns), "imposed", imposed)
        flight._check_imposed()
        trims = []
        for trim in entries.items("trims"):
            breakpoint = trim.number("breakpoint")
            require(low <= breakpoint <= high, "trims", breakpoint)
            unknowns = trim.all_numbers("unknowns", flight.unknowns)
            trim.close()
            trims.append(StatedTrim(breakpoint, unknowns))
        breakpoints = [trim.breakpoint for trim in trims]
        require(sorted(set(breakpoints)) == breakpoints, "trims", breakpoints)
        entries.close()
        return cls(model, parameters, spread, imposed, flight.limits, low, high, tuple(trims))

    def _check_imposed(self) -> None:
        """Raise Malformed if an imposed value or a scheduling value exceeds a limit."""
        ends = {name: (value, value) for name, value in self.imposed.items()}
        ends[self.model.schedule] = tuple(
            in_model_unit(self.model, end) for end in (self.low, self.high)
        )
        for name, (lowest, highest) in ends.items():
            if name in self.limits:
                least, most = self.limits[name]
                require(least <= lowest and highest <= most, f"{name} beyond its limits", lowest)


@dataclass(frozen=True, eq=False)
class Plant:
    """Plant x' = A x + B u + E w, given by its matrices.

    A: (n, n)
    B: (n, m)
    """

    A: np.ndarray
    B: np.ndarray

    @classmethod
    def read(cls, entries: Fields) -> Plant:
        """Return the plant stored in a certificate.

        Raises Malformed for the first wrong entry.
        """
        A = entries.array("A", None, None)
        B = entries.array("B", len(A), None)
        require(A.shape == (len(A), len(A)) and B.size > 0, "A", A.shape)
        entries.close()
        return cls(A, B)


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of the game with the cost ∫ x'Q x + u'R u - delta² w'w dt.

    Q: (n, n), symmetric, positive semidefinite
    R: (m, m), symmetric, positive definite
    E: (n, q), disturbance matrix
    delta: disturbance weight, inf without a disturbance

    The definiteness of Q and R is decided exactly.
    """

    Q: np.ndarray
    R: np.ndarray
    E: np.ndarray
    delta: float

    @classmethod
    def read(cls, entries: Fields, n: int, m: int) -> Weights:
        """Return the weights of a game with n states and m inputs from a certificate.

        Raises Malformed for the first wrong entry.
        """
        Q = entries.symmetric("Q", n)
        R = entries.symmetric("R", m)
        E = entries.array("E", n, None)
        delta = entries.positive("delta")
        require(lowest_sign(Q) >= 0, f"{entries.where}: Q is not positive semidefinite")
        require(lowest_sign(R) > 0, f"{entries.where}: R is not positive definite")
        entries.close()
        return cls(Q, R, E, delta)


@dataclass(frozen=True, eq=False)
class Controller:
    """Controller x_c' = A x_c + B y, u = C x_c + D y.

    The matrices are linear in the scheduling value between breakpoints. A gain u = -K x is a
    controller without states and with D = -K.

    breakpoints: scheduling values, (g,), increasing
    A: (g, k, k)
    B: (g, k, p)
    C: (g, a, k)
    D: (g, a, p)
    measurements: (p,), names of linear states, outputs, parts of outputs, and INPUT_position of
        actuators
    inputs: (a,), names of the inputs that u commands
    """

    breakpoints: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    measurements: tuple[str, ...]
    inputs: tuple[str, ...]

    @classmethod
    def read(cls, entries: Fields, model: Model) -> Controller:
        """Return the controller stored in a certificate.

        Raises Malformed for the first wrong entry, such as a name that the model does not have.
        """
        breakpoints = entries.increasing("breakpoints")
        inputs = entries.texts("inputs", model.inputs)
        positions = [f"{name}_position" for name in inputs]
        measurements = entries.texts("measurements", (*measurable(model), *positions))
        require(len(set(inputs)) == len(inputs) > 0, "inputs", inputs)
        require(bool(measurements), "measurements")
        g = len(breakpoints)
        a = len(inputs)
        p = len(measurements)
        k = entries.count("states", 10**4)
        controller = cls(
            breakpoints,
            entries.array("A", g, k, k),
            entries.array("B", g, k, p),
            entries.array("C", g, a, k),
            entries.array("D", g, a, p),
            measurements,
            inputs,
        )
        entries.close()
        return controller

    def outputs(self, model: Model) -> tuple[str, ...]:
        """Return the names of the outputs that the controller measures, as a whole or in part."""
        names = (model.part(name)[0] for name in self.measurements)
        return tuple(dict.fromkeys(name for name in names if name in model.outputs))


@dataclass(frozen=True, eq=False)
class FixedActuators:
    """Actuators with known parameters, one for each input of the controller.

    First order: a' = ω (λ u - a). Second order: a'' = ω² (λ u - a) - 2 d ω a'.

    order: 1 or 2, (a,)
    damping: d, used only for order 2, (a,)
    bandwidth: ω, rad/s, (a,)
    effectiveness: λ, (a,)
    """

    order: tuple[int, ...]
    damping: np.ndarray
    bandwidth: np.ndarray
    effectiveness: np.ndarray

    @classmethod
    def read(cls, entries: Fields, count: int) -> FixedActuators:
        """Return the actuators of `count` inputs stored in a certificate.

        Raises Malformed for the first wrong entry.
        """
        order = _read_orders(entries, count)
        numbers = [entries.array(name, count) for name in ("damping", "bandwidth", "effectiveness")]
        require(all(bool(np.all(values > 0.0)) for values in numbers), entries.where)
        entries.close()
        return cls(order, *numbers)


@dataclass(frozen=True, eq=False)
class UncertainActuators:
    """Actuators whose bandwidth ω, effectiveness λ(t) and delay τ(t) are uncertain.

    order: 1 or 2, (a,)
    damping: d, used only for order 2, (a,)
    bandwidth: lowest and highest ω, rad/s, constant and equal for all inputs
    effectiveness: lowest and highest λ, which varies independently for each input
    delay: largest τ, s, which varies independently for each input
    """

    order: tuple[int, ...]
    damping: np.ndarray
    bandwidth: tuple[float, float]
    effectiveness: tuple[float, float]
    delay: float

    @classmethod
    def read(cls, entries: Fields, count: int) -> UncertainActuators:
        """Return the uncertain actuators of `count` inputs stored in a certificate.

        Raises Malformed for the first wrong entry.
        """
        order = _read_orders(entries, count)
        damping = entries.array("damping", count)
        bandwidth = entries.pair("bandwidth", least=0.0)
        effectiveness = entries.pair("effectiveness", least=0.0)
        delay = entries.number("delay", least=0.0)
        require(bandwidth[0] > 0.0 and bool(np.all(damping > 0.0)), entries.where)
        entries.close()
        return cls(order, damping, bandwidth, effectiveness, delay)


Actuators = FixedActuators | UncertainActuators


@dataclass(frozen=True, eq=False)
class ScheduleStatement:
    """Claim about the loop of an aircraft, a controller and optional actuators.

    The claim covers every scheduling value of the aircraft's trims.

    flight: aircraft and its trims
    controller: the controller
    actuators: the actuators, or None
    loop: numbers of unstable modes of the loop, for consecutive ranges of the scheduling value. A
        range with bounds from 0 to the number of all modes claims nothing.
    modes: numbers of unstable modes of the aircraft alone, in the same form
    decay_rate: bound, 1/s, with Re λ < -decay_rate for every eigenvalue λ of the loop in ranges
        without unstable modes. 0 if there is no such range or the actuators are uncertain.
    scheduled_rate: largest rate of the scheduling value, per s, at which the loop is stable, or
        None
    """

    flight: Flight
    controller: Controller
    actuators: Actuators | None
    loop: tuple[Run, ...]
    modes: tuple[Run, ...]
    decay_rate: float
    scheduled_rate: float | None = None

    @classmethod
    def read(cls, content: Any, subject: Subject) -> ScheduleStatement:
        """Return the statement of a certificate.

        content: the certificate's entry `statement`
        subject: the user's aircraft

        Raises Malformed for the first wrong entry, and BadInputError if the statement concerns
        another model.
        """
        entries = Fields("statement", content)
        model = _model_of(content, subject)
        flight = Flight.read(entries.fields("flight"), model, point=False)
        controller = Controller.read(entries.fields("controller"), model)
        actuators: Actuators | None = None
        if entries.has("fixed_actuators"):
            actuators = FixedActuators.read(
                entries.fields("fixed_actuators"), len(controller.inputs)
            )
        elif entries.has("uncertain_actuators"):
            actuators = UncertainActuators.read(
                entries.fields("uncertain_actuators"), len(controller.inputs)
            )
        size = loop_size(model, controller, actuators)
        loop = _read_runs(entries, "loop", flight, size)
        modes = _read_runs(entries, "modes", flight, len(model.linear))
        decay_rate = entries.number("decay_rate", least=0.0)
        hurwitz = any(run.most == 0 for run in loop)
        require(hurwitz or decay_rate == 0.0, "decay_rate", decay_rate)
        scheduled_rate = None
        if entries.has("scheduled_rate"):
            scheduled_rate = entries.number("scheduled_rate", above=0.0)
        if isinstance(actuators, UncertainActuators):
            require(scheduled_rate is None and decay_rate == 0.0, "decay_rate", decay_rate)
        entries.close()
        return cls(flight, controller, actuators, loop, modes, decay_rate, scheduled_rate)

    def content(self) -> dict[str, Any]:
        """Return the certificate's entry `statement`, in the form that `read` accepts."""
        return {name: _content(value) for name, value in _named_parts(self).items()}


@dataclass(frozen=True, eq=False)
class GameStatement:
    """Claim about the exact solution of a game and the distance of a critic from this solution.

    plant: aircraft at one scheduling value, of which the linear model is used, or matrices
    weights: weights of the game
    decimals: whether `distances` and `loop` are claimed for every decimal number that rounds to the
        stored doubles. `delta_min` and `modes` are claimed for the doubles only.
    critic: K (m, n), and P (n, n) and W (weights, 1) if the critic defines them
    gain_of_value: whether K is claimed to equal R⁻¹ B' P within `SAME_GAIN`, for the critic's P and
        for the P of its W
    distances: part X of the critic -> lower and upper bound of |X - X*| / |X*| (Frobenius norm)
    loop: lower and upper bound of the number of unstable modes of A - B K with the critic's K
    delta_min: a delta for which the game has no value and a delta for which it has a value, or None
    modes: lower and upper bound of the number of unstable modes of A, or None if `delta_min` is
        None
    """

    plant: Flight | Plant
    weights: Weights
    decimals: bool
    critic: Mapping[str, np.ndarray]
    gain_of_value: bool
    distances: Mapping[str, tuple[float, float]]
    loop: tuple[int, int]
    delta_min: tuple[float, float] | None = None
    modes: tuple[int, int] | None = None

    @property
    def hurwitz(self) -> bool | None:
        """True if A - B K is proved Hurwitz, False if proved not Hurwitz, otherwise None."""
        least, most = self.loop
        if most == 0:
            return True
        return False if least > 0 else None

    @classmethod
    def read(cls, content: Any, subject: Subject) -> GameStatement:
        """Return the statement of a certificate.

        content: the certificate's entry `statement`
        subject: the user's aircraft

        Raises Malformed for the first wrong entry, and BadInputError if the statement concerns
        another model.
        """
        entries = Fields("statement", content)
        model = None if entries.has("plant") else _model_of(content, subject)
        plant: Flight | Plant
        if model is None:
            plant = Plant.read(entries.fields("plant"))
            n, m = plant.B.shape
        else:
            plant = Flight.read(entries.fields("flight"), model, point=True)
            n = len(model.linear)
            m = len(model.inputs)
        weights = Weights.read(entries.fields("weights"), n, m)
        decimals = entries.flag("decimals")
        require(model is not None or not decimals, "decimals", decimals)
        critic = _read_critic(entries.fields("critic"), n, m)
        gain_of_value = entries.flag("gain_of_value")
        require(len(critic) > 1 or not gain_of_value, "gain_of_value", gain_of_value)
        stated = entries.fields("distances")
        distances = {name: stated.pair(name, least=0.0) for name in critic}
        stated.close()
        loop = _read_bounds(entries, "loop", n)
        delta_min = None
        modes = None
        if entries.has("delta_min"):
            delta_min = entries.pair("delta_min")
            require(0.0 < delta_min[0] < delta_min[1], "delta_min", list(delta_min))
            modes = _read_bounds(entries, "modes", n)
        entries.close()
        return cls(
            plant, weights, decimals, critic, gain_of_value, distances, loop, delta_min, modes
        )

    def content(self) -> dict[str, Any]:
        """Return the certificate's entry `statement`, in the form that `read` accepts."""
        return {name: _content(value) for name, value in _named_parts(self).items()}


Statement = ScheduleStatement | GameStatement


def _model_of(content: Any, subject: Subject) -> Model:
    """Return the aircraft of the entry `flight` of a statement, as `model_of` does."""
    require(isinstance(content.get("flight"), dict), "flight", content.get("flight"))
    flight = content["flight"]
    return model_of(flight.get("dynamics"), flight.get("source"), subject.model)


def flight_content(flight: Flight) -> dict[str, Any]:
    """Return an aircraft and its trims in the form that is stored in a certificate."""
    content: dict[str, Any] = _content(flight)
    return content


def _named_parts(statement: Statement) -> dict[str, Any]:
    parts = {entry.name: getattr(statement, entry.name) for entry in fields(statement)}
    actuators = parts.pop("actuators", None)
    plant = parts.pop("plant", None)
    if isinstance(actuators, FixedActuators):
        parts["fixed_actuators"] = actuators
    elif isinstance(actuators, UncertainActuators):
        parts["uncertain_actuators"] = actuators
    if isinstance(plant, Flight):
        parts["flight"] = plant
    elif isinstance(plant, Plant):
        parts["plant"] = plant
    return {name: value for name, value in parts.items() if value is not None}


def _content(value: Any) -> Any:
    if isinstance(value, Flight):
        trims = [_content(trim._asdict()) for trim in value.trims]
        numbers = {name: dict(getattr(value, name)) for name in ("parameters", "spread", "imposed")}
        limits = {name: list(ends) for name, ends in value.limits.items()}
        ends = [value.low, value.high]
        return facts_of(value.model) | numbers | {"limits": limits, "range": ends, "trims": trims}
    if is_dataclass(value):
        content = {entry.name: _content(getattr(value, entry.name)) for entry in fields(value)}
        if isinstance(value, Controller):
            content["states"] = value.A.shape[1]
        if isinstance(value, Weights) and value.delta == math.inf:
            content["delta"] = "inf"
        return content
    if isinstance(value, Mapping):
        return {name: _content(entry) for name, entry in value.items()}
    if isinstance(value, np.ndarray):
        return value.astype(float).tolist()
    if isinstance(value, (tuple, list)):
        return [_content(entry) for entry in value]
    return value


def facts_of(model: Model) -> dict[str, Any]:
    """Return entries that identify a model.

    The entries are the name, the hash of the source, the scheduling variable, the units and the
    nominal values of the inputs.
    """
    return {
        "dynamics": model.name,
        "source": model.source.digest,
        "over": model.schedule,
        "unit": model.schedule_unit,
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
        "input_scales": [model.signals[name].nominal for name in model.inputs],
    }


def in_model_unit(model: Model, scheduling_value: Any) -> Any:
    """Return a scheduling value of a certificate in the unit of the model.

    An angle is converted from degrees to rad.
    """
    if model.schedule_unit != "deg":
        return scheduling_value
    if isinstance(scheduling_value, arb):
        return scheduling_value * arb.pi() / 180
    return math.radians(scheduling_value)


def measurable(model: Model) -> tuple[str, ...]:
    """Return the names of signals of the model that a controller may measure.

    These are the linear states, the outputs and the parts of outputs.
    """
    return tuple(name for name in model.measurable if name in model.linear or _output(model, name))


def _output(model: Model, name: str) -> bool:
    return model.part(name)[0] in model.outputs


def loop_size(model: Model, controller: Controller, actuators: Actuators | None) -> int:
    """Return the number of states of the closed loop: aircraft, actuators and controller."""
    size = len(model.linear) + controller.A.shape[1]
    return size if actuators is None else size + sum(actuators.order)


def _read_limits(entries: Fields, model: Model) -> dict[str, tuple[float, float]]:
    """Return signal -> (lowest, highest) from the entry `limits` of a certificate.

    Limits of disturbances, and of signals that have no limits in the model, may be omitted.

    Raises Malformed in these cases:
    - A limit is wider than the model's limit.
    - A signal with limits in the model has no limits in the certificate.
    """
    stated = entries.fields("limits")
    limits = {}
    for name, (least, most) in model.limits.items():
        needed = bool(np.isfinite((least, most)).any()) and name not in model.disturbances
        if needed or stated.has(name):
            low, high = stated.pair(name)
            where = f"limits: {name} beyond the model's"
            require(least <= low and high <= most, where, [low, high])
            limits[name] = (low, high)
    stated.close()
    return limits


def _read_orders(entries: Fields, count: int) -> tuple[int, ...]:
    orders = entries.array("order", count).tolist()
    require(all(order in (1.0, 2.0) for order in orders), f"{entries.where}: order", orders)
    return tuple(int(order) for order in orders)


def _read_runs(entries: Fields, name: str, flight: Flight, size: int) -> tuple[Run, ...]:
    """Return the ranges of an entry with rows [low, high, least, most], in ascending order.

    entries: reader of the object that contains the entry
    name: name of the entry
    flight: aircraft and its trims
    size: number of eigenvalues

    Raises Malformed unless the ranges cover all scheduling values of the trims without a gap.
    """
    runs: list[Run] = []
    for row in entries.array(name, None, 4).tolist():
        low, high, least, most = row
        run = Run(low, high, int(least), int(most))
        require(row == list(run) and low < high, name, row)
        require(0 <= run.least <= run.most <= size, name, row)
        runs.append(run)
    require(bool(runs), name)
    require(runs[0].low == flight.low and runs[-1].high == flight.high, name)
    for first, second in pairwise(runs):
        require(first.high == second.low, name)
    return tuple(runs)


def _read_bounds(entries: Fields, name: str, size: int) -> tuple[int, int]:
    low, high = entries.pair(name, least=0)
    require(low == int(low) and high == int(high) <= size, name, [low, high])
    return int(low), int(high)


def _read_critic(entries: Fields, n: int, m: int) -> dict[str, np.ndarray]:
    critic = {"K": entries.array("K", m, n)}
    if entries.has("P"):
        critic["P"] = entries.array("P", n, n)
    if entries.has("W"):
        critic["W"] = entries.array("W", None, 1)
        require(len(critic["W"]) >= n * (n + 1) // 2, "W", len(critic["W"]))
    entries.close()
    return critic


@dataclass(frozen=True, eq=False)
class TrimBox:
    """Enclosure of the trims at all scheduling values from `low` to `high`.

    Each unknown differs from c0 + c1 s + c2 s² + Σ z_k t_k by at most its radius. t_k are the
    errors of the parameters in units of their half-widths, |t_k| <= 1.

    low, high: ends of the box of scheduling values
    polynomials: unknown -> (c0, c1, c2, z_1, ...)
    radii: unknown -> radius
    """

    low: float
    high: float
    polynomials: dict[str, list[arb]]
    radii: dict[str, arb]

    @classmethod
    def read(cls, entries: Fields, flight: Flight) -> TrimBox:
        """Return the enclosure stored in the entries `range` and `trim` of a certificate.

        Raises Malformed for the first wrong entry.
        """
        low, high = entries.pair("range")
        require(flight.low <= low < high <= flight.high, "range", [low, high])
        trims = entries.fields("trim")
        polynomials = {}
        radii = {}
        for name in flight.unknowns:
            radii[name], *polynomials[name] = trims.balls(name, 4 + len(flight.spread))
            require(bool(radii[name] > 0), trims.where, name)
        trims.close()
        return cls(low, high, polynomials, radii)


@dataclass(frozen=True, eq=False)
class Line:
    """Matrix H that counts the eigenvalues of a matrix A on each side of the line Re λ = -rate.

    A has as many eigenvalues with Re λ > -rate as H has negative eigenvalues.

    H: symmetric matrix, (n, n)
    turn: coordinates in which the signs of the eigenvalues of H are decided, (n, n)
    rate: 1/s
    """

    H: np.ndarray
    turn: np.ndarray
    rate: float = 0.0

    @classmethod
    def read(cls, entries: Fields, n: int, *, rated: bool = True) -> Line:
        """Return the matrix H and the line stored in a certificate.

        n: number of states
        rated: whether to read the entry `rate`. Otherwise the rate is 0.

        Raises Malformed for the first wrong entry.
        """
        rate = entries.number("rate") if rated else 0.0
        return cls(entries.symmetric("H", n), entries.array("turn", n, n), rate)


@dataclass(frozen=True, eq=False)
class Piece:
    """Lyapunov function V = ζ'H ζ for actuators with a bandwidth in an interval.

    bandwidth: lowest and highest bandwidth, rad/s
    H: symmetric matrix, (n, n)
    X: multipliers of the delays, then of the effectiveness, (2 a,)
    turn: coordinates of (ζ, d, e) in which the condition is tested, (n + 2 a, n + 2 a)
    """

    bandwidth: tuple[float, float]
    H: np.ndarray
    X: np.ndarray
    turn: np.ndarray

    @classmethod
    def read(cls, entries: Fields, n: int, a: int) -> Piece:
        """Return the Lyapunov function stored in a certificate.

        n: number of states of the loop
        a: number of actuators

        Raises Malformed for the first wrong entry.
        """
        bandwidth = entries.pair("bandwidth", least=0.0)
        H = entries.symmetric("H", n)
        piece = cls(
            bandwidth, H, entries.array("X", 2 * a), entries.array("turn", *[n + 2 * a] * 2)
        )
        entries.close()
        return piece


@dataclass(frozen=True, eq=False)
class ModesBox:
    """Data for the proof of the number of unstable modes on a box.

    trim: enclosure of the trims on the box
    proof: a matrix that counts eigenvalues, or Lyapunov functions that together cover the
        bandwidths of uncertain actuators
    """

    trim: TrimBox
    proof: Line | list[Piece]


@dataclass(frozen=True, eq=False)
class Motion:
    """Lyapunov function V = ζ'P ζ for a moving scheduling value, with P linear between breakpoints.

    breakpoints: scheduling values, (l,)
    P: symmetric matrices, (l, n, n)
    boxes: pairs of an enclosure of trims and coordinates (n, n) in which the condition is tested
    """

    breakpoints: np.ndarray
    P: np.ndarray
    boxes: list[tuple[TrimBox, np.ndarray]]

    @classmethod
    def read(cls, entries: Fields, flight: Flight, n: int) -> Motion:
        """Return the Lyapunov function stored in a certificate.

        entries: reader of the entry `motion`
        flight: aircraft whose trims the boxes enclose
        n: number of states of the loop

        Raises Malformed for the first wrong entry.
        """
        breakpoints = entries.increasing("breakpoints")
        P = entries.array("P", len(breakpoints), n, n)
        require(np.array_equal(P, P.transpose(0, 2, 1)), f"{entries.where}: P: not symmetric")
        boxes = []
        for box in entries.items("boxes"):
            trim = TrimBox.read(box, flight)
            boxes.append((trim, box.array("turn", n, n)))
            box.close()
        entries.close()
        return cls(breakpoints, P, boxes)


@dataclass(frozen=True, eq=False)
class ScheduleWitness:
    """Data for the proof of a statement about a schedule.

    loop: boxes that together prove the numbers of unstable modes of the loop
    modes: boxes that together prove the numbers of unstable modes of the aircraft
    motion: Lyapunov function for a moving scheduling value, or None
    """

    loop: list[ModesBox]
    modes: list[ModesBox]
    motion: Motion | None = None

    @classmethod
    def read(cls, entries: Fields, statement: ScheduleStatement) -> ScheduleWitness:
        """Return the witness of a statement about a schedule, stored in a certificate.

        statement: the statement, which determines the sizes of the matrices

        Raises Malformed for the first wrong entry.
        """
        flight = statement.flight
        actuators = statement.actuators
        n = len(flight.model.linear)
        size = loop_size(flight.model, statement.controller, actuators)
        loop = []
        for box in entries.items("loop"):
            trim = TrimBox.read(box, flight)
            proof: Line | list[Piece]
            if isinstance(actuators, UncertainActuators):
                count = len(actuators.order)
                proof = [Piece.read(piece, size, count) for piece in box.items("pieces")]
            else:
                proof = Line.read(box, size)
            box.close()
            loop.append(ModesBox(trim, proof))
        modes = []
        for box in entries.items("modes"):
            modes.append(ModesBox(TrimBox.read(box, flight), Line.read(box, n)))
            box.close()
        motion = None
        if statement.scheduled_rate is not None:
            motion = Motion.read(entries.fields("motion"), flight, size)
        entries.close()
        return cls(loop, modes, motion)


@dataclass(frozen=True, eq=False)
class SolutionBox:
    """Enclosure of the solution of the Riccati equation on a box, with states measured in `units`.

    Every entry of the solution differs from the same entry of P(s) by at most `reach`.

    units: units of the states, (n,), positive
    P: P(s), Taylor model of a symmetric matrix (n, n)
    reach: radius, a ball
    line: matrix H for the proof that A - S P is Hurwitz
    """

    units: np.ndarray
    P: TaylorModel
    reach: arb
    line: Line

    @classmethod
    def read(cls, entries: Fields, n: int) -> SolutionBox:
        """Return the enclosure stored in a certificate.

        n: number of states

        Raises Malformed for the first wrong entry.
        """
        units = entries.array("units", n)
        require(bool(np.all(units > 0.0)), "units")
        (rows,) = entries.balls("P", 1, n, n)
        for i in range(n):
            for j in range(i):
                same = bool(rows[i][j].mid() == rows[j][i].mid())
                require(same, f"{entries.where}: P: not symmetric")
                rows[j][i] = rows[i][j]
        reach = entries.balls("reach")
        require(bool(reach > 0), "reach")
        return cls(units, TaylorModel(arb_mat(rows)), reach, Line.read(entries, n, rated=False))


@dataclass(frozen=True, eq=False)
class PointTrim:
    """Enclosure of the trim at one scheduling value.

    center: unknown -> (c0, 0, 0) with the center c0
    radii: unknown -> radius about c0 that contains the trim of the stored doubles
    wide_radii: unknown -> radius about c0 that contains the trims of all decimal numbers that round
        to these doubles
    """

    center: dict[str, list[arb]]
    radii: dict[str, arb]
    wide_radii: dict[str, arb]

    @classmethod
    def read(cls, entries: Fields, flight: Flight) -> PointTrim:
        """Return the trim stored in a certificate.

        The entry of each unknown is a list (center, radius, wide radius).

        Raises Malformed for the first wrong entry.
        """
        center = {}
        radii = {}
        wide_radii = {}
        for name in flight.unknowns:
            middle, radii[name], wide_radii[name] = entries.balls(name, 3)
            center[name] = [middle, arb(0), arb(0)]
            require(bool(radii[name] > 0) and bool(radii[name] <= wide_radii[name]), entries.where)
        entries.close()
        return cls(center, radii, wide_radii)


@dataclass(frozen=True, eq=False)
class GameWitness:
    """Data for the proof of a statement about a game.

    trim: enclosure of the trim, or None for a plant given by matrices
    solution: enclosure of the solution at the game's delta
    loop: matrices H that count the unstable modes of A - B K
    modes: matrices H that count the unstable modes of A, [] if delta_min is not claimed
    value: enclosure of the solution at the upper bound of delta_min, or None if delta_min is not
        claimed
    refused: proof that the game has no value at the lower bound of delta_min. This is a solution
        whose lowest eigenvalue is negative, or frequencies, rad/s, between which the Hamiltonian
        matrix has an eigenvalue on the imaginary axis. None if delta_min is not claimed.
    """

    trim: PointTrim | None
    solution: SolutionBox
    loop: list[Line]
    modes: list[Line] = field(default_factory=list)
    value: SolutionBox | None = None
    refused: SolutionBox | Sequence[float] | None = None

    @classmethod
    def read(cls, entries: Fields, statement: GameStatement) -> GameWitness:
        """Return the witness of a statement about a game, stored in a certificate.

        statement: the statement, which determines the sizes of the matrices

        Raises Malformed for the first wrong entry.
        """
        n = len(statement.weights.Q)
        trim = None
        if isinstance(statement.plant, Flight):
            trim = PointTrim.read(entries.fields("trim"), statement.plant)
        else:
            assert isinstance(statement.plant, Plant)
        solution = _closed_solution(entries.fields("solution"), n)
        loop = _lines(entries, "loop", n)
        if statement.delta_min is None:
            entries.close()
            return cls(trim, solution, loop)
        modes = _lines(entries, "modes", n)
        value = _closed_solution(entries.fields("value"), n)
        refused: Any = None
        if entries.has("frequencies"):
            refused = entries.array("frequencies", None).tolist()
        else:
            refused = _closed_solution(entries.fields("refused"), n)
        entries.close()
        return cls(trim, solution, loop, modes, value, refused)


def _closed_solution(entries: Fields, n: int) -> SolutionBox:
    solution = SolutionBox.read(entries, n)
    entries.close()
    return solution


def _lines(entries: Fields, name: str, n: int) -> list[Line]:
    lines = []
    for line in entries.items(name):
        lines.append(Line.read(line, n))
        line.close()
    return lines


def trim_content(trim: TrimBox) -> dict[str, Any]:
    """Return an enclosure of trims in the form that is stored in a certificate, with doubles."""
    numbers = {
        name: [float(trim.radii[name]), *map(float, polynomial)]
        for name, polynomial in trim.polynomials.items()
    }
    return {"range": [trim.low, trim.high], "trim": numbers}
