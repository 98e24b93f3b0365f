"""Equations and limits of an aircraft about a trim, read from a certificate."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.fields import Fields, Rejected, Terms, require
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


def model_of(name: Any, source: Any, own: Model | None) -> Model:
    """Return the aircraft that a statement concerns.

    This is the flexible aircraft of the paper or the user's model.

    name: name of the dynamics in the statement
    source: hash of the user's file in the statement, "" for the flexible aircraft
    own: the user's model, or None

    Raises Malformed unless `name` and `source` are strings. Raises BadInputError if the statement
    concerns another model than the user's, or an aircraft whose file is not given.
    """
    require(isinstance(name, str) and isinstance(source, str), "dynamics", name)
    if own is not None:
        if (own.name, own.source.digest) != (name, source):
            raise BadInputError(
                f"the certificate is about {shown(name)} from another file than the given file "
                f"of {own.name}; give the aircraft file used to prove the certificate"
            )
        return own
    flexible = None if source else aircraft_of(name)
    if flexible is None:
        raise BadInputError(
            f"the certificate is about {shown(name)}; give the aircraft file with --aircraft "
            "FILE.py:NAME"
        )
    return flexible


#: Lowest and highest value by signal; inf where there is no limit.
Limits = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Plant:
    """Plant x' = f(x, u) with limited inputs.

    model: the equations. The states of the linear model are the moving states.
    parameters: every parameter of the model -> value
    trim: moving state -> trim value, x0
    inputs: input -> trim value, u0
    held: every other state -> its constant value
    limits: signal -> lowest and highest value
    """

    model: Model
    parameters: Mapping[str, float]
    trim: Mapping[str, float]
    inputs: Mapping[str, float]
    held: Mapping[str, float]
    limits: Limits

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the moving states, in the model's order."""
        return tuple(self.model.linear)

    @property
    def limited_outputs(self) -> tuple[str, ...]:
        """Names of the outputs that have limits."""
        return tuple(name for name in self.model.outputs if name in self.limits)

    def content(self) -> dict[str, Any]:
        """Return the plant in the form of a certificate, which `read_plant` accepts."""
        return {
            **facts(self.model),
            "parameters": dict(self.parameters),
            "trim": dict(self.trim),
            "inputs": dict(self.inputs),
            "held": dict(self.held),
            "limits": {name: pair_of(pair) for name, pair in self.limits.items()},
        }

    @property
    def nominal(self) -> np.ndarray:
        """Nominal values of the moving states and the inputs, (n + m,)."""
        signals = self.model.signals
        return np.array([signals[name].nominal for name in (*self.states, *self.inputs)])

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


def read_plant(entries: Fields, content: Any, subject: Subject) -> Plant:
    """Return the plant stored in a certificate.

    entries: reader of the certificate's entry `statement`
    content: the same entry as data
    subject: the user's aircraft

    Raises Malformed for the first wrong entry, and BadInputError if the statement concerns another
    model.
    """
    model = model_of(content.get("dynamics"), content.get("source"), subject.model)
    for name, fact in facts(model).items():
        entries.same(name, fact)
    states = tuple(model.linear)
    held = tuple(name for name in model.states if name not in states)
    return Plant(
        model,
        entries.all_numbers("parameters", tuple(model.parameters)),
        entries.all_numbers("trim", states),
        entries.all_numbers("inputs", tuple(model.inputs)),
        entries.all_numbers("held", held),
        _read_limits(entries, model),
    )


def _read_limits(entries: Fields, model: Model) -> Limits:
    """Return signal -> (lowest, highest) from the entry `limits`, with infinity for null.

    Raises Malformed for the first wrong entry.
    """
    stated = entries.value("limits", lambda value: isinstance(value, dict))
    limits = {}
    for name, pair in stated.items():
        where = f"limits: {name}"
        require(name in (*model.states, *model.inputs, *model.outputs), where)
        require(isinstance(pair, list) and len(pair) == 2, where, pair)
        ends = Fields(where, {"low": pair[0], "high": pair[1]})
        low = -np.inf if pair[0] is None else ends.number("low")
        high = np.inf if pair[1] is None else ends.number("high")
        require(low < high, where, pair)
        limits[name] = (low, high)
    return limits


def terms_by_input(entries: Fields, name: str, plant: Plant, highest: int) -> dict[str, Terms]:
    """Return the polynomial of each input, input -> terms, read from the entry `name`.

    An input without a polynomial is omitted.

    highest: highest accepted degree

    Raises Malformed for the first wrong term.
    """
    rows = entries.fields(name)
    terms = {}
    for each in plant.inputs:
        if rows.has(each):
            terms[each] = rows.terms(each, len(plant.states), highest)
    rows.close()
    return terms


def read_extents(entries: Fields, states: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return state -> lowest and highest deviation, from the entry `extents`.

    Raises Malformed unless every lowest deviation is negative and every highest deviation positive.
    """
    listed = entries.fields("extents")
    extents = {name: listed.pair(name) for name in states}
    listed.close()
    require(all(low < 0.0 < high for low, high in extents.values()), "extents", extents)
    return extents


def check_limits_of_model(plant: Plant) -> None:
    """Raise Malformed unless the stated limits are admissible for the model (`limits_hold`)."""
    states = {**plant.trim, **plant.held}
    own = model_limits(plant.model, states, plant.parameters)
    wrong = limits_hold(plant.limits, own, plant.inputs)
    require(wrong is None, f"limits: {wrong} beyond or not the model's")


def limits_hold(stated: Limits, own: Limits, inputs: Collection[str]) -> str | None:
    """Return the first signal whose stated limits are not admissible, or None if all are.

    The limits of an input define its saturation and must equal the model's. The limits of a state
    or output must not be wider than the model's.

    stated: limits in the certificate, signal -> lowest and highest value
    own: limits of the model, signal -> lowest and highest value
    inputs: names of the inputs
    """
    unlimited = (-np.inf, np.inf)
    for name in (*inputs, *own):
        low, high = stated.get(name, unlimited)
        least, most = own.get(name, unlimited)
        same = (low, high) == (least, most)
        if not (same if name in inputs else least <= low and high <= most):
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


def facts(model: Model) -> dict[str, Any]:
    """Return entries that identify a model: name, source, moving states and units."""
    return {
        "dynamics": model.name,
        "source": model.source.digest,
        "states": list(model.linear),
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
    }


def pair_of(limits: tuple[float, float]) -> list[float | None]:
    """Return a pair of limits in the form stored in a file, with None for an infinite limit."""
    return [end if np.isfinite(end) else None for end in limits]
