"""Equations and limits of an aircraft about a trim, read from a certificate."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.enclosure.program import LARGEST
from hfa_prove.enclosure.splines import is_table, tables_of
from hfa_prove.fields import Fields, Rejected, Stated, entry, require
from hfa_prove.hfa import aircraft_of
from hfa_support.errors import BadInputError, shown

#: Largest difference of a trim from the stated one, in nominal values of its unknowns.
SAME_TRIM = 1e-6


class Subject(NamedTuple):
    """The user's object of a statement.

    model: the user's aircraft, or None for a built-in one
    policy: the user's policy, state deviations -> input deviations, or None if the statement
        contains the coefficients of its policy
    """

    model: Model | None = None
    policy: ca.Function | None = None


def read_model(file: Fields, name: str, known: Any) -> Model:
    """Return the aircraft that a statement concerns.

    This is the user's model, or the flexible aircraft of the paper.

    file: reader of the object with the entry
    name: name of the entry, which contains the facts of the model (`facts`)
    known: namespace with the user's `subject`

    Raises BadInputError if the statement concerns another model than the user's, or an aircraft
    whose file is not given. Raises Malformed if another fact differs.
    """
    stated = file.fields(name)
    dynamics = stated.value("dynamics", str)
    equations = stated.value("equations", str)
    own = known.subject.model
    if own is not None and (own.name, digest_of_equations(own)) != (dynamics, equations):
        raise BadInputError(
            f"the certificate is about {shown(dynamics)} with other equations than those of the "
            f"given file of {own.name}; give the aircraft file used to prove the certificate"
        )
    model = own or (None if equations else aircraft_of(dynamics))
    if model is None:
        raise BadInputError(
            f"the certificate is about {shown(dynamics)}; give the aircraft file with --aircraft "
            "FILE.py:NAME"
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
    signals = model.signals
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
        "nominal": [signals[name].nominal for name in (*model.states, *model.inputs)],
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
    vectors = [ca.vertsplit(each) if each.numel() else [] for each in (x, u, p)]
    disturbances = ca.vertsplit(w) if w.numel() else []
    rates, outputs = layout.expressions(vectors, tuple(model.outputs), disturbances)
    graph = ca.Function("equations", [x, u, p, w], [ca.densify(rates), ca.densify(outputs)])
    names = repr((tuple(map(tuple, layout.names)), layout.replaced))
    return hashlib.sha256(f"{names} {digest_of(graph, model.name)}".encode()).hexdigest()


def digest_of(function: ca.Function, what: str = "the policy") -> str:
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
    hashed = hashlib.sha256()
    for index in range(scalar.n_instructions()):
        code = scalar.instruction_id(index)
        places = (*scalar.instruction_input(index), -1, *scalar.instruction_output(index))
        content = ""
        if code == ca.OP_CONST:
            content = float(scalar.instruction_constant(index)).hex()
        elif code == ca.OP_CALL:
            called = scalar.instructions_sx()[index].which_function()
            # CasADi adds derivatives that it has computed to the stored form of a table
            content = repr(tables_of(called)) if is_table(called) else called.serialize()
        hashed.update(f"{code} {places} {content};".encode())
    return hashed.hexdigest()


#: Lowest and highest value by signal; inf where there is no limit.
Limits = Mapping[str, tuple[float, float]]


def _read_limits(file: Fields, name: str, known: Any) -> Limits:
    """Return signal -> (lowest, highest), with infinity for null."""
    model = known.model
    stated = file.value(name, dict)
    limits = {}
    for signal, pair in stated.items():
        where = f"limits: {signal}"
        require(signal in (*model.states, *model.inputs, *model.outputs), where)
        require(isinstance(pair, list) and len(pair) == 2, where, pair)
        ends = Fields(where, {"low": pair[0], "high": pair[1]})
        low = -np.inf if pair[0] is None else ends.number("low")
        high = np.inf if pair[1] is None else ends.number("high")
        require(low < high, where, pair)
        limits[signal] = (low, high)
    return limits


def stored_limits(limits: Limits) -> dict[str, list[float | None]]:
    """Return limits in the form stored in a file, with None for an infinite limit."""
    return {
        name: [end if np.isfinite(end) else None for end in ends] for name, ends in limits.items()
    }


def _numbers_of(names: Any) -> Any:
    """Return the reader of an entry with a number for each signal, model -> names."""
    return lambda file, name, known: file.all_numbers(name, tuple(names(known.model)))


@dataclass(frozen=True, eq=False)
class Plant(Stated):
    """Plant x' = f(x, u) with limited inputs.

    model: the equations. The states of the linear model are the moving states.
    parameters: every parameter of the model -> value
    trim: moving state -> trim value, x0
    inputs: input -> trim value, u0
    held: every other state -> its constant value
    limits: signal -> lowest and highest value
    """

    model: Model = entry(read_model, store=facts, subject="aircraft")
    parameters: Mapping[str, float] = entry(
        _numbers_of(lambda model: model.parameters), subject="parameters"
    )
    trim: Mapping[str, float] = entry(_numbers_of(lambda model: model.linear), subject="trim")
    inputs: Mapping[str, float] = entry(_numbers_of(lambda model: model.inputs), subject="trim")
    held: Mapping[str, float] = entry(
        _numbers_of(lambda model: (name for name in model.states if name not in model.linear)),
        subject="trim",
    )
    limits: Limits = entry(_read_limits, store=stored_limits, subject="limits")

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the moving states, in the model's order."""
        return tuple(self.model.linear)

    @property
    def limited_outputs(self) -> tuple[str, ...]:
        """Names of the outputs that have limits."""
        return tuple(name for name in self.model.outputs if name in self.limits)

    @property
    def nominal(self) -> np.ndarray:
        """Nominal values of the moving states, (n,)."""
        return np.array([self.model.signals[name].nominal for name in self.states])

    def ends(self, names: Sequence[str]) -> np.ndarray:
        """Return the lowest and highest values of signals, (len(names), 2).

        A missing limit is infinite.

        names: names of the signals
        """
        pairs = [self.limits.get(name, (-np.inf, np.inf)) for name in names]
        return np.array(pairs, dtype=float).reshape(-1, 2)

    def check_held(self) -> None:
        """Raise Rejected if a constant state is outside its limits."""
        for name, value in self.held.items():
            ((low, high),) = self.ends((name,))
            if not low <= value <= high:
                raise Rejected(
                    f"{name} has the constant value {value:g}, outside the limits {low:g} to "
                    f"{high:g}"
                )

    def rates_at(self, x: ca.SX, u: ca.SX, w: Sequence[Any] | None = None) -> tuple[ca.SX, ca.SX]:
        """Return the rates of the states that are not held constant, and the outputs that have
        limits.

        x: values of the states that are not held constant, (n,)
        u: values of the inputs, (m,)
        w: values of all disturbances, or None for 0
        """
        values = dict(self.held) | dict(zip(self.states, ca.vertsplit(x), strict=True))
        vectors: list[Any] = [
            [values[name] for name in self.model.states],
            ca.vertsplit(u) if self.inputs else [],
            list(self.parameters.values()),
        ]
        f, y = self.model.layout.expressions(vectors, self.limited_outputs, w)
        rows = [list(self.model.states).index(name) for name in self.states]
        return ca.densify(f[rows]), ca.densify(y) if self.limited_outputs else ca.SX(0, 1)


def check_limits_of_model(plant: Plant) -> None:
    """Raise Malformed unless the stated limits are admissible for the model (`limits_hold`)."""
    states = {**plant.trim, **plant.held}
    own = model_limits(plant.model, states, plant.parameters)
    wrong = limits_hold(plant.limits, own)
    require(wrong is None, f"limits: {wrong} beyond the model's")


def limits_hold(stated: Limits, own: Limits, saturated: Collection[str] = ()) -> str | None:
    """Return the first signal whose stated limits are not within one's own, or None if all are.

    stated: limits in the certificate, signal -> lowest and highest value
    own: one's own limits, signal -> lowest and highest value
    saturated: names of the inputs, whose limits define the loop and must be equal; none if only
        the width is compared
    """
    unlimited = (-np.inf, np.inf)
    for name in (*saturated, *own):
        low, high = stated.get(name, unlimited)
        least, most = own.get(name, unlimited)
        same = (low, high) == (least, most)
        if not (same if name in saturated else least <= low and high <= most):
            return name
    return None


def model_limits(
    model: Model, states: Mapping[str, float], parameters: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Return signal -> (lowest, highest) for every limited state, input and output of a model.

    The limits are the declared min and max. If the model has an envelope, the limits of the
    envelope at the trim replace the declared limits.

    states: state -> value at the trim, for all states
    parameters: parameter -> value
    """
    limits = {}
    for name in (*model.states, *model.inputs, *model.outputs):
        signal = model.signals[name]
        limits[name] = (signal.min, signal.max)
    x = model.layout.record("x", [states[name] for name in model.states])
    p = model.layout.record("p", [parameters[name] for name in model.parameters])
    limits |= model.domain.limits_about(x, p)
    return {name: pair for name, pair in limits.items() if np.isfinite(pair).any()}
