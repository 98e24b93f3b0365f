"""Statement of a certificate about a gain schedule, and the numbers that its proof needs.

The checker interprets or refuses every entry. The digest covers all entries, and reports show them.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from flint import arb

from hfa_aircraft.model import Model
from hfa_prove.enclosure.ball_function import LARGEST
from hfa_prove.enclosure.splines import is_table, tables_of
from hfa_prove.fields import Fields, Stored, entry, part, require
from hfa_prove.hfa import aircraft_of
from hfa_support.errors import BadInputError, shown
from hfa_support.origin import instructions

#: Largest difference of a trim from the stated one, in nominal values of its unknowns.
SAME_TRIM = 1e-6


def read_model(file: Fields, name: str, known: Any) -> Model:
    """Return the aircraft that a statement concerns.

    This is the user's model, or the flexible aircraft of the paper.

    file: reader of the object with the entry
    name: name of the entry, which contains the facts of the model (`facts`)
    known: namespace with the user's `aircraft`, None for a built-in one

    Raises BadInputError if the statement concerns another model than the user's, or an aircraft
    whose file is not given. Raises Malformed if another fact differs.
    """
    stated = file.fields(name)
    dynamics = stated.value("dynamics", str)
    equations = stated.value("equations", str)
    own = known.aircraft
    if own is not None and (own.name, digest_of_equations(own)) != (dynamics, equations):
        raise BadInputError(
            f"the certificate is about {shown(dynamics)} with other equations than those of the "
            f"given file of {own.name}; give the aircraft file used to prove the certificate"
        )
    model = own or (None if equations else aircraft_of(dynamics))
    if model is None:
        raise BadInputError(
            f"the certificate is about {shown(dynamics)} with equations of its own; give the "
            "--aircraft FILE.py:NAME or the --servo of the proof"
        )
    for fact, value in facts(model).items():
        if fact not in ("dynamics", "equations"):
            stated.same(fact, value)
    stated.close()
    return model


def facts(model: Model) -> dict[str, Any]:
    """Return the entries of a certificate that identify a model.

    dynamics: name of the model
    equations: digest of the equations, "" for the flexible aircraft of this program
    states: names of the moving states
    steady: names of the states whose rates are 0 at a trim
    schedule, schedule_unit: scheduling variable and its unit in certificates
    state_units, input_units, disturbance_units: units of the moving states, inputs and disturbances
    nominal: nominal values of all states and inputs, in which distances of trims are measured
    """
    return {
        "dynamics": model.name,
        "equations": digest_of_equations(model),
        "states": list(model.linear),
        "steady": list(model.steady),
        "schedule": model.schedule,
        "schedule_unit": model.schedule_unit if model.schedule else "",
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
        "disturbance_units": list(model.units(tuple(model.disturbances))),
        "nominal": model.nominal((*model.states, *model.inputs)).tolist(),
    }


@lru_cache(maxsize=16)
def digest_of_equations(model: Model) -> str:
    """Return the SHA-256 of the graph of a model's equations and of the names of its signals.

    Comments, titles, default values and the order of statements in a file do not change it. The
    result is "" for the flexible aircraft of this program, which its name identifies.
    """
    flexible = aircraft_of(model.name)
    if flexible is not None and flexible.layout == model.layout:
        return ""
    layout = model.layout
    x, u, p, w = layout.symbols("x", "u", "p", "w")
    rates, outputs = layout.expressions((x, u, p), tuple(model.outputs), w)
    graph = ca.Function("equations", [x, u, p, w], [ca.densify(rates), ca.densify(outputs)])
    names = repr((tuple(map(tuple, layout.names)), layout.replaced))
    return hashlib.sha256(f"{names} {digest_of(graph, model.name)}".encode()).hexdigest()


def digest_of(function: ca.Function, what: str) -> str:
    """Return the SHA-256 of a function's instructions and of all digits of its constants.

    Functions that it calls, such as tables, are contained.

    what: name of the function, for the message

    Raises BadInputError if the function has more than `LARGEST` operations.
    """
    scalar = function.expand() if function.is_a("MXFunction") else function
    if scalar.n_instructions() > LARGEST:
        raise BadInputError(
            f"{what} has {scalar.n_instructions()} operations, but at most {LARGEST} are "
            "supported; give a smaller one"
        )
    return instructions(
        scalar, lambda called: repr(tables_of(called)) if is_table(called) else called.serialize()
    )


def _read_limits(file: Fields, name: str, known: Any) -> dict[str, tuple[float, float]]:
    """Return signal -> (lowest, highest), refused if wider than those of the model, or missing."""
    model = known.model
    stated = file.fields(name)
    limits = {}
    for signal, (least, most) in model.limits.items():
        if signal in model.airspeeds:
            continue  # a function of signals that have limits
        needed = bool(np.isfinite((least, most)).any()) and signal not in model.disturbances
        if needed or stated.has(signal):
            low, high = stated.pair(signal)
            where = f"limits: {signal} beyond the model's"
            require(least <= low and high <= most, where, [low, high])
            limits[signal] = (low, high)
    stated.close()
    return limits


def _read_parameters(file: Fields, name: str, known: Any) -> dict[str, float]:
    """Return parameter -> value, refused if beyond the limits of the model."""
    signals = known.model.parameters
    values = file.all_numbers(name, tuple(signals))
    for parameter, value in values.items():
        signal = signals[parameter]
        is_within = signal.min <= value <= signal.max
        require(is_within, f"parameters: {parameter} beyond the model's limits", value)
    return values


def _read_range(file: Fields, name: str) -> tuple[float, float]:
    """Return the ends (low, high) of an interval, low < high."""
    low, high = file.pair(name)
    require(low < high, name, [low, high])
    return low, high


def unknowns_of(model: Model, imposed: Mapping[str, float]) -> tuple[str, ...]:
    """Return the names of the unknowns of a trim."""
    return tuple(name for name in model.variables if name not in (model.schedule, *imposed))


@dataclass(frozen=True, eq=False)
class Flight(Stored):
    """Trims of an aircraft at every scheduling value of an interval, within its limits.

    model: the equations
    parameters: every parameter of the model -> value within its limits
    imposed: imposed variable -> value, the same for every trim
    limits: state, input or output -> (lowest, highest)
    range: lowest and highest scheduling value
    first: unknown -> value at the trim at the lowest scheduling value, from which the branch of
        trims begins, within `SAME_TRIM` nominal values
    """

    model: Model = entry(read_model, store=facts, subject="aircraft")
    parameters: Mapping[str, float] = entry(_read_parameters, subject="parameters")
    imposed: Mapping[str, float] = entry(
        lambda file, name, known: file.numbers(
            name,
            [holdable for holdable in known.model.holdable if holdable != known.model.schedule],
        ),
        subject="trim",
    )
    limits: Mapping[str, tuple[float, float]] = entry(_read_limits, subject="limits")
    range: tuple[float, float] = entry(lambda file, name, known: _read_range(file, name))
    first: Mapping[str, float] = entry(
        lambda file, name, known: file.all_numbers(name, unknowns_of(known.model, known.imposed))
    )

    @property
    def low(self) -> float:
        """Lowest scheduling value."""
        return self.range[0]

    @property
    def high(self) -> float:
        """Highest scheduling value."""
        return self.range[1]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns of a trim."""
        return unknowns_of(self.model, self.imposed)

    def check_consistent(self) -> None:
        """Raise Malformed if no unknown is left, or an imposed or scheduling value is not within
        its limits.
        """
        require(bool(self.unknowns), "imposed", self.imposed)
        ranges = {name: (value, value) for name, value in self.imposed.items()}
        low, high = (in_model_unit(self.model, end) for end in self.range)
        ranges[self.model.schedule] = (low, high)
        for name, (lowest, highest) in ranges.items():
            if name in self.limits:
                least, most = self.limits[name]
                require(least <= lowest and highest <= most, f"{name} beyond its limits", lowest)


def in_model_unit(model: Model, scheduling_value: float) -> float:
    """Return a scheduling value of a certificate in the unit of the model."""
    return math.radians(scheduling_value) if model.is_typed_in_degrees else scheduling_value


def unit_of_schedule(model: Model) -> arb:
    """Return the unit of the scheduling values of a certificate in the unit of the model."""
    return arb.pi() / 180 if model.is_typed_in_degrees else arb(1)


#: Largest number of pieces that a certificate may state.
_MOST_PIECES = 10_000_000


def _read_breakpoints(file: Fields, name: str, known: Any) -> np.ndarray:
    """Return increasing scheduling values, or one value of a constant gain."""
    values = file.array(name, None)
    require(len(values) > 0 and bool(np.all(np.diff(values) > 0.0)), name)
    return values


@dataclass(frozen=True, eq=False)
class Gains(Stored):
    """Gain schedule u = u0 - K(η) (x - x0), with K linear in η between breakpoints.

    breakpoints: scheduling values, (g,), increasing. With one value, K is constant.
    K: (g, m, n), in the order of the inputs and of the states of the linear model
    """

    breakpoints: np.ndarray = entry(_read_breakpoints, subject="gains")
    K: np.ndarray = entry(
        lambda file, name, known: file.array(
            name, len(known.breakpoints), len(known.model.inputs), len(known.model.linear)
        ),
        subject="gains",
    )

    def pieces(self, low: float, high: float) -> list[tuple[float, float]]:
        """Return the parts of [low, high] between breakpoints.

        Raises Malformed if the breakpoints do not cover the interval.
        """
        first, last = float(self.breakpoints[0]), float(self.breakpoints[-1])
        if first == last:
            return [(low, high)]
        require(first <= low and high <= last, "gains: breakpoints", [first, last])
        cuts = [low, *(cut for cut in self.breakpoints.tolist() if low < cut < high), high]
        return list(pairwise(cuts))


@dataclass(frozen=True, eq=False)
class ScheduleStatement(Stored):
    """Claim about the linear loop x' = (A - B K) x at the trims of an aircraft.

    For every scheduling value η of the flight, within all limits, there is one trim on the smooth
    branch of trims that begins at `flight.first`, and no other trim near it. With A and B there:

    - Re λ < -decay_rate for every eigenvalue λ of A - B K(η)
    - with `scheduled_rate`: x' = (A - B K(η(t))) x is uniformly exponentially stable for every
      absolutely continuous η(t) in the interval with |η'| <= scheduled_rate, and for every
      measurable η(t) if the rate is infinite

    flight: aircraft and its trims
    gains: the gain schedule
    decay_rate: 1/s, at least 0
    scheduled_rate: unit of the scheduling values per s, infinite for any motion, or None
    """

    flight: Flight = part(Flight)
    gains: Gains = entry(
        lambda file, name, known: Gains.read(file.fields(name), known.flight),
        store=lambda gains: gains.content(),
    )
    # 0.0 is added because a file may have -0.0.
    decay_rate: float = entry(lambda file, name, known: file.number(name, least=0.0) + 0.0)
    scheduled_rate: float | None = entry(
        lambda file, name, known: file.positive(name) if file.has(name) else None,
        store=lambda rate: "inf" if math.isinf(rate) else rate,
        default=None,
    )

    def check_consistent(self) -> None:
        """Raise Malformed if the breakpoints do not cover the interval."""
        self.gains.pieces(*self.flight.range)


def _read_witness_breakpoints(file: Fields, name: str, known: Any) -> np.ndarray:
    """Return the scheduling values of P, (l,), none if the statement has no scheduled rate."""
    if known.statement.scheduled_rate is None:
        return np.zeros(0)
    return _read_breakpoints(file, name, known)


def _read_matrices(file: Fields, name: str, known: Any) -> np.ndarray:
    """Return the symmetric matrices P, (l, n, n), none if the statement has no scheduled rate."""
    n = len(known.statement.flight.model.linear)
    if known.statement.scheduled_rate is None:
        return np.zeros((0, n, n))
    P = file.array(name, len(known.breakpoints), n, n)
    require(np.array_equal(P, P.transpose(0, 2, 1)), "witness: P: not symmetric")
    return P


@dataclass(frozen=True, eq=False)
class ScheduleWitness(Stored):
    """Numbers for the proof of a schedule, not part of the claim.

    pieces: number of pieces after which the checker stops
    breakpoints: scheduling values of P, (l,), increasing; one value of a constant P; empty without
        a rate
    P: (l, n, n), symmetric. V = x'P(η)x with P linear between breakpoints decreases on every
        motion.
    """

    pieces: int = entry(lambda file, name, known: file.count(name, _MOST_PIECES))
    breakpoints: np.ndarray = entry(_read_witness_breakpoints)
    P: np.ndarray = entry(_read_matrices)

    def content(self) -> dict[str, Any]:
        """Return the certificate's entry `witness`, without P if there is none."""
        return {name: value for name, value in super().content().items() if value != []}
