"""The statement about a region. The checker interprets or refuses every field, the digest covers
all of them, and a report shows them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_boxes.check.statement import model_limits
from hfa_proof.checker.aircraft import SAME_TRIM as SAME_TRIM, model_of
from hfa_proof.checker.reading import Fields, require

#: Highest degree of V, and of the polynomial of a policy.
HIGHEST_DEGREE = 6
HIGHEST_POLICY = 5

Limits = Mapping[str, tuple[float, float]]
#: Coefficient and exponents of each monomial, a monomial at most once.
Terms = tuple[tuple[float, tuple[int, ...]], ...]


@dataclass(frozen=True, eq=False)
class SaturatedLoop:
    """x' = f(x, u, w), u = sat(u0 - K (x - x0) + q(x - x0)): a model, a policy and where both are
    about.

    model: the equations; of its states, those of its linear model move
    parameters: every parameter of the model -> value
    trim: moving state -> value, x0
    inputs: input -> value, u0
    held: each other state -> the value that it keeps
    K: (m, n), in the order of the inputs and the moving states
    limits: signal -> (lowest, highest); between those of an input it is saturated, a state or an
        output stays between its own. Those of an input are the model's, those of any other signal
        that the model limits not wider
    policy: input -> q, terms of degree 2 to `HIGHEST_POLICY`; an input without has q = 0
    disturbances: disturbance of the model -> d > 0: any measurable w(t) with |w(t)| <= d; the
        others are 0. The rates are affine in those that are named
    """

    model: Model
    parameters: Mapping[str, float]
    trim: Mapping[str, float]
    inputs: Mapping[str, float]
    held: Mapping[str, float]
    K: np.ndarray
    limits: Limits
    policy: Mapping[str, Terms] = field(default_factory=dict)
    disturbances: Mapping[str, float] = field(default_factory=dict)

    @property
    def states(self) -> tuple[str, ...]:
        """The moving states, in order."""
        return tuple(self.model.linear)

    @property
    def acting(self) -> tuple[str, ...]:
        """Inputs and disturbances, whose combinations define the parts."""
        return (*self.inputs, *self.disturbances)


@dataclass(frozen=True, eq=False)
class RegionStatement:
    """Every trajectory of the loop that begins in {V(z) <= rho} exists for all time, stays there
    and within all limits, and converges to the equilibrium; z: deviations from that. Of a loop with
    disturbances it is not claimed that it converges.

    The equilibrium is the one within `SAME_TRIM` of x0, in nominal values of the states.
    loop: the model with its saturated inputs
    terms: V = Σ coefficient z^exponents, of degrees 2 to `HIGHEST_DEGREE`
    rho: level of V
    extents: moving state -> lowest and highest deviation in the set, or beyond
    """

    loop: SaturatedLoop
    terms: Terms
    rho: float
    extents: Mapping[str, tuple[float, float]]

    @classmethod
    def read(cls, content: Any, own: Model | None) -> RegionStatement:
        """The statement of a certificate.

        content: of its entry `statement`
        own: the user's model, if the statement concerns one

        Malformed names the first entry that cannot be; BadInputError another model.
        """
        entries = Fields("statement", content)
        model = model_of(content.get("dynamics"), content.get("source"), own)
        for name, fact in facts_of(model).items():
            entries.same(name, fact)
        states = tuple(model.linear)
        held = tuple(name for name in model.states if name not in states)
        loop = SaturatedLoop(
            model,
            _all_numbers(entries, "parameters", tuple(model.parameters)),
            _all_numbers(entries, "trim", states),
            _all_numbers(entries, "inputs", tuple(model.inputs)),
            _all_numbers(entries, "held", held),
            entries.array("K", len(model.inputs), len(states)),
            _read_limits(entries, model),
            _read_policy(entries, model),
            _read_disturbances(entries, model),
        )
        terms = _read_terms(entries, "terms", len(states), HIGHEST_DEGREE)
        rho = entries.number("rho", above=0.0)
        stated = entries.fields("extents")
        extents = {name: stated.pair(name) for name in states}
        stated.close()
        require(all(low < 0.0 < high for low, high in extents.values()), "extents", extents)
        entries.close()
        _check_limits(loop)
        return cls(loop, terms, rho, extents)

    def content(self) -> dict[str, Any]:
        """Return the statement as stored in a file, which `read` reads."""
        loop = self.loop
        return {
            **facts_of(loop.model),
            "parameters": dict(loop.parameters),
            "trim": dict(loop.trim),
            "inputs": dict(loop.inputs),
            "held": dict(loop.held),
            "K": loop.K.tolist(),
            "limits": {name: _pair(pair) for name, pair in loop.limits.items()},
            "policy": {name: rows_of(terms) for name, terms in loop.policy.items()},
            "disturbances": dict(loop.disturbances),
            "terms": rows_of(self.terms),
            "rho": self.rho,
            "extents": {name: list(pair) for name, pair in self.extents.items()},
        }


def facts_of(model: Model) -> dict[str, Any]:
    """Return the model's identity, the order of its states and inputs, and the units."""
    return {
        "dynamics": model.name,
        "source": model.extras.source[1],
        "states": list(model.linear),
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
        "disturbance_units": list(model.units(tuple(model.disturbances))),
    }


def _all_numbers(entries: Fields, name: str, names: tuple[str, ...]) -> dict[str, float]:
    """Read a number for each of the names, in their order."""
    numbers = entries.numbers(name, names)
    require(set(numbers) == set(names), name, sorted(numbers))
    return {each: numbers[each] for each in names}


def _read_terms(entries: Fields, name: str, variables: int, highest: int) -> Terms:
    """Terms of degree 2 to `highest`, each monomial at most once."""
    rows = entries.value(name, lambda value: isinstance(value, list) and bool(value))
    terms = []
    for row in rows:
        require(isinstance(row, list) and len(row) == 2, name, row)
        term = Fields(name, {"coefficient": row[0], "exponents": row[1]})
        coefficient = term.number("coefficient")
        exponents = tuple(int(entry) for entry in term.array("exponents", variables).tolist())
        require(list(exponents) == row[1] and min(exponents) >= 0, name, row)
        require(2 <= sum(exponents) <= highest, name, row)
        terms.append((coefficient, exponents))
    require(len({exponents for _, exponents in terms}) == len(terms), name)
    return tuple(terms)


def _read_policy(entries: Fields, model: Model) -> dict[str, Terms]:
    """q of the inputs that have one."""
    stated = entries.fields("policy")
    variables = len(model.linear)
    policy = {}
    for name in model.inputs:
        if stated.has(name):
            policy[name] = _read_terms(stated, name, variables, HIGHEST_POLICY)
    stated.close()
    return policy


def _read_disturbances(entries: Fields, model: Model) -> dict[str, float]:
    """Largest absolute value of each stated disturbance, in the order of the model."""
    sizes = entries.numbers("disturbances", tuple(model.disturbances))
    for name, size in sizes.items():
        require(size > 0.0, f"disturbances: {name}", size)
    return {name: sizes[name] for name in model.disturbances if name in sizes}


def _read_limits(entries: Fields, model: Model) -> dict[str, tuple[float, float]]:
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


def rows_of(terms: Terms) -> list[list[Any]]:
    """Return the rows of a file."""
    return [[coefficient, list(exponents)] for coefficient, exponents in terms]


def _pair(limits: tuple[float, float]) -> list[float | None]:
    """Return the limits as stored in a file."""
    return [end if np.isfinite(end) else None for end in limits]


def _check_limits(loop: SaturatedLoop) -> None:
    """Malformed where a limit of the model is missing or widened, or a limit of an input
    differs."""
    states = {**loop.trim, **loop.held}
    own = model_limits(loop.model, states, loop.parameters)
    wrong = limits_hold(loop.limits, own, tuple(loop.inputs))
    require(
        wrong is None, f"limits: {wrong} beyond or not the model's", loop.limits.get(wrong or "")
    )


def limits_hold(stated: Limits, own: Limits, inputs: Collection[str]) -> str | None:
    """The first signal whose stated limits are not those that the loop needs; None for none.

    Those of an input are its saturation, and so the model's own: others are another loop. A state
    or an output may be kept within narrower ones."""
    unlimited = (-np.inf, np.inf)
    for name in (*inputs, *own):
        low, high = stated.get(name, unlimited)
        least, most = own.get(name, unlimited)
        same = (low, high) == (least, most)
        if not (same if name in inputs else least <= low and high <= most):
            return name
    return None
