"""Reports of proved statements: the claim, its entries, what is not covered."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from decimal import ROUND_FLOOR, Context, Decimal
from typing import Any, NamedTuple

from hfa_aircraft.model import Model
from hfa_prove.certificate import KIND, Certificate
from hfa_prove.hfa import identity_of
from hfa_prove.statements.schedule import ScheduleStatement
from hfa_support.reporting.report import Report

SCHEMA = "hfa.proof/1"


class Claim(NamedTuple):
    """What a statement says, in words and as data.

    title: the claim for the first line
    excluded: what the claim does not cover, for the first line
    theorem: the claim in full sentences
    not_covered: last line of a report
    data: the same figures for JSON
    model: the aircraft
    """

    title: str
    excluded: str
    theorem: str
    not_covered: str
    data: Mapping[str, Any]
    model: Model


def claim_of(statement: ScheduleStatement) -> Claim:
    """Return what a statement says."""
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
        how = f"at up to {at_least(rate, 4)} {unit}/s" if math.isfinite(rate) else "at any rate"
        lines.append(f"The linear loop is stable while the {model.schedule} moves {how}.")
    # The paper's aircraft has {"dihedral_deg": [low, high]}, others {"scheduled": {name: [low,
    # high]}}.
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
        title=f"the linear loop of {model.title} decays by {decay} 1/s at {every}",
        excluded="actuators, delay, the nonlinear aircraft",
        theorem=" ".join(lines),
        not_covered="Not covered: actuators, delay, sampling, limits of the inputs in motion, the "
        f"nonlinear aircraft, a {model.schedule} that the loop itself moves.",
        data=data,
        model=model,
    )


def at_least(value: float, digits: int) -> str:
    """Return a lower bound as text with the given number of digits, rounded down as it is typed."""
    kept = Context(prec=digits, rounding=ROUND_FLOOR).create_decimal(Decimal(repr(float(value))))
    return f"{float(kept):.{digits}g}"


def found_report(statement: ScheduleStatement, size: int, open_claim: str = "") -> Report:
    """Return the report of a statement that a search has proved.

    size: number of pieces of the proof
    open_claim: sentence on what was asked and is not proved, or ""
    """
    claim = claim_of(statement)
    title = f"Proved: {claim.title}, without {claim.excluded}"
    if open_claim:
        title = f"{open_claim}\n{title}"
    parts = (claim.theorem, claim.not_covered)
    return Report(title, parts, data=_data(statement, claim, size))


def checked_report(certificate: Certificate, size: int, not_given: Sequence[str]) -> Report:
    """Return the report of a statement that the checker has proved, with all its entries.

    certificate: the certificate that proves it
    size: number of pieces of the proof
    not_given: parts of the statement that were not compared, because the user did not give them
    """
    statement, written = certificate.statement, certificate.written
    claim = claim_of(statement)
    not_compared = f", of the {_listed(not_given)} in the certificate" if not_given else ""
    title = f"Verified, proved: {claim.title}{not_compared}, without {claim.excluded}"
    origin = "written by hfa {version} on {date}: {command}".format(**written)
    digest = hashlib.sha256(json.dumps(statement.content()).encode()).hexdigest()
    rows = [
        (path, text)
        for path, _, value in statement.entries()
        for path, text in _rows(path, value, claim.model)
    ]
    parts = [
        claim.theorem,
        "\n".join(f"{path}: {text}" for path, text in rows),
        _aircraft(statement, claim.model),
        f"statement: SHA-256 {digest[:16]}; {size} pieces\n{origin}",
        claim.not_covered,
    ]
    data = _data(statement, claim, size) | {
        "statement_sha256": digest,
        "written": dict(written),
        "not_given": list(not_given),
    }
    return Report(title, parts, data=data)


def _data(statement: ScheduleStatement, claim: Claim, size: int) -> dict[str, Any]:
    """Return the data of a report: figures of the claim, and the statement of the certificate."""
    return {
        "schema": SCHEMA,
        "kind": KIND,
        "proved": True,
        "pieces": size,
        **claim.data,
        "claim": statement.content(),
    }


def _listed(names: Sequence[str]) -> str:
    """Return names as text such as "a, b and c"."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def _aircraft(statement: ScheduleStatement, model: Model) -> str:
    """Return a line on the model: the hash of its file, or of the parameters of the paper."""
    parameters = next(
        value for path, _, value in statement.entries() if path.endswith("parameters")
    )
    identity = None if model.source.digest else identity_of(parameters)
    if identity is not None:
        name, digest = identity
        return f"Model: {model.name} dynamics, parameters {name} ({digest})."
    source = f" (SHA-256 of the file: {model.source.digest[:16]})" if model.source.digest else ""
    return f"Model: {model.name}{source}."


def _rows(path: str, value: Any, model: Model) -> list[tuple[str, str]]:
    """Return the rows (path, text) of an entry, one for each part that is not itself a row."""
    if isinstance(value, Mapping) and value and set(value) <= set(model.signals):
        texts = (f"{name} {_in_unit(model, name, part)}" for name, part in value.items())
        return [(path, ", ".join(texts))]
    if isinstance(value, Mapping):
        parts = list(value.items())
    elif isinstance(value, list) and value and isinstance(value[0], (list, Mapping)):
        parts = [(str(number), part) for number, part in enumerate(value)]
    else:
        text = ", ".join(map(_number, value)) if isinstance(value, list) else _number(value)
        return [(path, text)]
    return [row for name, part in parts for row in _rows(f"{path}.{name}", part, model)]


def _in_unit(model: Model, name: str, value: Any) -> str:
    """Return the value of a signal, or its limits [lowest, highest], as text with the unit."""
    if isinstance(value, list):
        return " to ".join("-" if end is None else model.describe(name, end) for end in value)
    return model.describe(name, value)


def _number(value: Any) -> str:
    """Return a number with ten digits, or another value of an entry, as text."""
    return f"{value:.10g}" if isinstance(value, float) else str(value)
