"""Reports of proved statements, the same for all kinds: the claim, tables, what is not covered."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.certificate import kind_of
from hfa_prove.check import Proved
from hfa_prove.fields import Statement
from hfa_prove.hfa import identity_of
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.statements.piece import Piece
from hfa_prove.statements.plant import Plant
from hfa_prove.statements.region import RegionStatement
from hfa_prove.statements.schedule import ScheduleStatement
from hfa_prove.words import at_least, at_most, polynomial_in_words
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table, beside_unit, shown_values

SCHEMA = "hfa.proof/1"
#: Longest list of numbers that a table of a statement's entries shows.
_LONGEST = 12


class Claim(NamedTuple):
    """What a statement says, in words and as data.

    title: the claim for the first line
    without: what the first line says is not covered
    sentence: the claim as a theorem
    not_covered: last line of a report
    parts: tables of the main figures
    data: the same figures for JSON
    model: the aircraft
    """

    title: str
    without: str
    sentence: str
    not_covered: str
    parts: Sequence[Part]
    data: Mapping[str, Any]
    model: Model


@singledispatch
def claim_of(statement: Statement) -> Claim:
    """Return what a statement says."""
    raise TypeError(type(statement).__name__)


def found_report(
    statement: Statement,
    size: int,
    *more: Part,
    data: Mapping[str, Any] | None = None,
) -> Report:
    """Return the report of a statement that a search has proved.

    size: number of boxes or pieces of the proof
    more: parts about the search
    data: entries about the search
    """
    claim = claim_of(statement)
    parts = (claim.sentence, *claim.parts, *more, claim.not_covered)
    entries = _data(statement, claim, size) | dict(data or {})
    return Report(f"Proved: {claim.title}, without {claim.without}", parts, data=entries)


def checked_report(verified: Proved, not_given: Sequence[str] = (), policy: str = "") -> Report:
    """Return the report of a statement that the checker has proved, with all its entries.

    not_given: parts of the statement that were not compared, because the user did not give them
    policy: description of the user's policy, or ""
    """
    statement = verified.statement
    claim = claim_of(statement)
    of = f", of the {_listed(not_given)} in the certificate" if not_given else ""
    title = f"Verified, proved: {claim.title}{of}, without {claim.without}"
    origin = "written by hfa {version} on {date}: {command}".format(**verified.written)
    digest = _digest(statement)
    parts: list[Part] = [claim.sentence, *claim.parts]
    if policy:
        parts.append(f"Policy: {policy}.")
    rows = [
        (path, text)
        for path, _, value in statement.entries()
        for path, text in _rows(path, value, claim.model)
    ]
    parts += [
        "\n".join(f"{path}: {text}" for path, text in rows),
        _aircraft(statement, claim.model),
        f"statement: SHA-256 {digest[:16]}; {verified.size} boxes\n{origin}",
        claim.not_covered,
    ]
    data = _data(statement, claim, verified.size) | {
        "statement_sha256": digest,
        "written": dict(verified.written),
        "not_given": list(not_given),
    }
    return Report(title, parts, data=data)


def _data(statement: Statement, claim: Claim, size: int) -> dict[str, Any]:
    """Return the data of a report: the claim in the form of the certificate, and its figures."""
    return {
        "schema": SCHEMA,
        "kind": kind_of(statement),
        "proved": True,
        "boxes": size,
        **claim.data,
        "claim": statement.content(),
    }


def _digest(statement: Statement) -> str:
    """Return the SHA-256 of a statement's JSON text."""
    return hashlib.sha256(json.dumps(statement.content()).encode()).hexdigest()


def _listed(names: Sequence[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def _aircraft(statement: Statement, model: Model) -> str:
    """Return a line on the model: the hash of its file, or of the parameters of the paper."""
    parameters = next(
        value for path, _, value in statement.entries() if path.endswith("parameters")
    )
    known = None if model.source.digest else identity_of(parameters)
    if known is not None:
        return f"Model: {model.name} dynamics, parameters {known[0]} ({known[1]})."
    source = f" (SHA-256 of the file: {model.source.digest[:16]})" if model.source.digest else ""
    return f"Model: {model.name}{source}."


def _rows(path: str, value: Any, model: Model) -> list[tuple[str, str]]:
    """Return one row for each number, list or object of an entry."""
    if isinstance(value, Mapping) and set(value) <= set(model.signals) and value:
        return [
            (path, ", ".join(f"{name} {_value(model, name, at)}" for name, at in value.items()))
        ]
    if isinstance(value, Mapping):
        return [row for name, at in value.items() for row in _rows(f"{path}.{name}", at, model)]
    if isinstance(value, list) and value and isinstance(value[0], (list, Mapping)):
        flat = all(not isinstance(each, (list, Mapping)) for part in value for each in part)
        if not flat or isinstance(value[0], Mapping) or len(value) > _LONGEST:
            return [
                row
                for number, part in enumerate(value)
                for row in _rows(f"{path}.{number}", part, model)
            ]
        return [(f"{path}.{number}", _numbers(part)) for number, part in enumerate(value)]
    return [(path, _numbers(value) if isinstance(value, list) else _number(value))]


def _value(model: Model, name: str, value: Any) -> str:
    if isinstance(value, list):
        return " to ".join("-" if end is None else model.describe(name, end) for end in value)
    return model.describe(name, value)


def _numbers(values: Sequence[Any]) -> str:
    return ", ".join(_number(value) for value in values)


def _number(value: Any) -> str:
    if isinstance(value, list):
        return f"[{_numbers(value)}]"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


@claim_of.register
def _(statement: ScheduleStatement) -> Claim:
    flight = statement.flight
    model = flight.model
    unit = model.schedule_unit
    every = f"every {model.schedule} from {flight.low:.10g} to {flight.high:.10g} {unit}"
    decay = at_least(statement.decay_rate, 6)
    lines = [
        f"At {every} the trim exists within its limits, is the only one near, and every "
        f"eigenvalue of A - B K has a real part below -{decay} 1/s. The trims are one branch."
    ]
    rate = statement.scheduled_rate
    if rate is not None:
        how = f"at most {at_least(rate, 4)} {unit}/s" if math.isfinite(rate) else "any rate"
        lines.append(f"The linear loop is stable while the {model.schedule} moves at {how}.")
    key = model.schedule_key if model.about.names_schedule else "scheduled"
    interval: Any = [flight.low, flight.high]
    data = {
        "dynamics": model.name,
        key: interval if model.about.names_schedule else {model.schedule: interval},
        "decay_rate": statement.decay_rate,
    }
    if rate is not None:
        data["scheduled_rate"] = rate if math.isfinite(rate) else "inf"
    return Claim(
        f"the linear loop of {model.title} decays by {decay} 1/s at {every}",
        "actuators, delay, the nonlinear aircraft",
        " ".join(lines),
        "Not covered: actuators, delay, sampling, limits of the inputs in motion, the nonlinear "
        f"aircraft, a {model.schedule} that the loop itself moves.",
        (),
        data,
        model,
    )


@claim_of.register
def _(statement: RegionStatement) -> Claim:
    loop = statement.loop
    model = loop.model
    without = "sampling, delay, actuators"
    sizes = " and ".join(
        f"|{name}| <= {model.describe(name, size)}" for name, size in loop.disturbances.items()
    )
    reaches = {name: max(-low, high) for name, (low, high) in statement.extents.items()}
    ends = ", ".join(f"{name} {_outward(model, name, reach)}" for name, reach in reaches.items())
    what = "region of attraction" if not sizes else f"set invariant under {sizes}"
    begins = (
        "Every trajectory that begins in the set {V(z) <= rho, |M z| < 1} stays there and within "
        "all limits"
    )
    then = " and converges to the equilibrium" if not sizes else f" under every {sizes}"
    held = f" {', '.join(loop.held)} held at trim values." if loop.held else ""
    saturated = f"; inputs saturated: {', '.join(_saturated(loop)) or 'none'}."
    convergence = " Convergence is not claimed." if sizes else ""
    V = PolynomialFunction.of_terms(statement.piece.W.terms).substituted(statement.piece.M)
    data = {
        "states": loop.states,
        "state_units": model.units(loop.states),
        "trim": {**loop.trim, **loop.inputs, **loop.held},
        "limits": loop.limits,
        "disturbances": dict(loop.disturbances),
        "extents": reaches,
        "rho": statement.rho,
        "degree": statement.degree,
        "terms": V.terms,
        "M": statement.piece.M,
    }
    if statement.degree == 2:
        data["P"] = V.matrix()
    rows = []
    for name, (low, high) in statement.extents.items():
        at = model.describe(name, statement.equilibrium[name])
        pair = [_outward(model, name, end) for end in (low, high)]
        rows.append((name, *pair, at, *_limits(loop, name)))
    others = "other disturbances" if sizes else "disturbances"
    return Claim(
        f"{what} of {model.title} to {ends}",
        without if sizes else f"{without}, disturbances",
        f"{begins}{then}{saturated}{held}{convergence}",
        f"Not covered: sampling, actuators, delays, {others}, errors of the model, a linearization "
        "that is not Hurwitz.",
        (
            Table(("the set lies within", "from", "to", "about", "lowest", "highest"), rows),
            "The set is not a box: a state within all of these ranges may lie outside it.",
            _set(statement.piece),
        ),
        data,
        model,
    )


def _saturated(loop: Plant) -> list[str]:
    """Return the names of the limited inputs, with the limits of those that are not the model's."""
    shown = []
    for name, signal in loop.model.inputs.items():
        if name not in loop.limits:
            continue
        is_own = loop.limits.get(name, (-np.inf, np.inf)) == (signal.min, signal.max)
        shown.append(name if is_own else f"{name} at {' and '.join(_limits(loop, name))}")
    return shown


def _limits(plant: Plant, name: str) -> list[str]:
    """Return the lowest and highest value of a signal as text, "-" for a missing limit."""
    ends = plant.limits.get(name, (-np.inf, np.inf))
    return [plant.model.describe(name, end) if np.isfinite(end) else "-" for end in ends]


def _outward(model: Model, name: str, value: float) -> str:
    """Return an end of a range, rounded outward."""
    unit = model.unit(name)
    shown = float(shown_values(value, unit))
    return beside_unit((at_least if shown < 0.0 else at_most)(shown, 4), unit)


def _set(piece: Piece) -> str:
    """Return V, its level and the matrix M as text, with six digits of each number."""
    variables = [f"y{i + 1}" for i in range(len(piece.M))]
    V = polynomial_in_words(piece.W.terms, variables)
    lines = [f"V = {V} <= rho = {at_least(piece.c, 6)}, |y_i| < 1, y = M z"]
    lines += [
        f"M, row {i}: {', '.join(f'{entry:.6g}' for entry in row)}"
        for i, row in enumerate(piece.M, start=1)
    ]
    return "\n".join(lines)
