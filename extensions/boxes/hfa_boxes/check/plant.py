"""An aircraft about a trim: its equations and limits, read from a certificate."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_proof.checker.aircraft import model_of
from hfa_proof.checker.reading import Fields, Rejected, Terms, require

#: Lowest and highest value by signal; inf where there is no limit.
Limits = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Plant:
    """Plant x' = f(x, u) with inputs between their limits.

    model: the equations; the states of its linear model are the moving states
    parameters: every parameter of the model -> value
    trim: moving state -> value, x0
    inputs: input -> value, u0
    held: each other state -> its constant value
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
        """The moving states, in order."""
        return tuple(self.model.linear)

    @property
    def limited_outputs(self) -> tuple[str, ...]:
        """Outputs that have limits."""
        return tuple(name for name in self.model.outputs if name in self.limits)

    def content(self) -> dict[str, Any]:
        """Return the entries of a statement, which `read_plant` reads."""
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
        """Return the lowest and highest values of signals, (len(names), 2), infinite without a
        limit."""
        pairs = [self.limits.get(name, (-np.inf, np.inf)) for name in names]
        return np.array(pairs, dtype=float).reshape(-1, 2)

    def check_held(self) -> None:
        """Raise Rejected where a state that does not move is beyond its limits."""
        for name, value in self.held.items():
            ((low, high),) = self.ends((name,))
            if not low <= value <= high:
                raise Rejected(f"{name} is held beyond its limits")

    def rates_at(self, x: ca.SX, u: ca.SX, w: Sequence[Any] | None = None) -> tuple[ca.SX, ca.SX]:
        """Return the rates of the moving states, and the limited outputs.

        x: (n,), the moving states
        u: (m,), the inputs
        w: every disturbance, or None for 0
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


def read_plant(entries: Fields, content: Any, own: Model | None) -> Plant:
    """Return the model about a trim and its limits. Raises Malformed for the first wrong entry.

    content: content of the entries
    own: the user's model, if the statement concerns one
    """
    model = model_of(content.get("dynamics"), content.get("source"), own)
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
    """Read the limits by signal; a missing limit is null."""
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
    """Read the terms of the polynomials of some inputs, up to the degree `highest`."""
    rows = entries.fields(name)
    terms = {}
    for each in plant.inputs:
        if rows.has(each):
            terms[each] = rows.terms(each, len(plant.states), highest)
    rows.close()
    return terms


def read_extents(entries: Fields, states: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Read the lowest and highest deviation of each state, on either side of 0."""
    listed = entries.fields("extents")
    extents = {name: listed.pair(name) for name in states}
    listed.close()
    require(all(low < 0.0 < high for low, high in extents.values()), "extents", extents)
    return extents


def check_limits_of_model(plant: Plant) -> None:
    """Raise Malformed if a limit of the model is missing or widened, or an input limit differs."""
    states = {**plant.trim, **plant.held}
    own = model_limits(plant.model, states, plant.parameters)
    wrong = limits_hold(plant.limits, own, plant.inputs)
    require(wrong is None, f"limits: {wrong} beyond or not the model's")


def limits_hold(stated: Limits, own: Limits, inputs: Collection[str]) -> str | None:
    """Return the first signal whose stated limits do not agree with the model's own, or None if all
    do.

    Input limits define the saturation and must equal the model's. Limits of states and outputs may
    be narrower."""
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
    """Return the lowest and highest value of every limited state, input and output.

    They are min and max of the declaration, and the model's envelope about this trim.

    states: all of them, at the trim
    parameters: name -> value
    """
    limits = {}
    for name in (*model.states, *model.inputs, *model.outputs):
        signal = model.signals[name]
        limits[name] = (signal.min, signal.max)
    if model.extras.envelope is not None:
        x = model.layout.record("x", [states[name] for name in model.states])
        p = model.layout.record("p", [parameters[name] for name in model.parameters])
        limits |= model.extras.envelope(x, p)
    return {name: pair for name, pair in limits.items() if np.isfinite(pair).any()}


def facts(model: Model) -> dict[str, Any]:
    """Return the model's identity, the order of its states and inputs, and the units."""
    return {
        "dynamics": model.name,
        "source": model.extras.source[1],
        "states": list(model.linear),
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
    }


def pair_of(limits: tuple[float, float]) -> list[float | None]:
    """Return the limits as stored in a file, where an infinite one is None."""
    return [end if np.isfinite(end) else None for end in limits]
