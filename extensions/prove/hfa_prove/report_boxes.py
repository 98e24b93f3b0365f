"""Reports of regions that are proved on boxes: text, tables and data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hfa_prove.check import Proved
from hfa_prove.results import CheckedBoxes, FoundBoxes, quadratic_form
from hfa_prove.search.region_boxes import BoxRegion
from hfa_prove.statements.loop import Gain
from hfa_prove.statements.region import RegionStatement
from hfa_prove.subject import first_line
from hfa_prove.words import (
    NO_BOX,
    at_least,
    at_most,
    curved_policies_in_words,
    limits_in_words,
    outputs_in_words,
    parameters_in_words,
    piece_in_words,
    place_in_words,
)
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, shown_unit, shown_values

NOT_COVERED = "sampling, delay, actuators, disturbances"


def found_report(
    region: BoxRegion,
    policy: str,
    flight: str | None,
    not_covered: str = NOT_COVERED,
    reason: str = "",
) -> Report:
    """Return the report of a proved region.

    The report includes the obstacle to a larger region, if one was found.

    policy: description of the policy
    flight: clause on the outcome of a flight from the obstacle, or None
    not_covered: effects that the proof neglects, for the title
    reason: reason why the proof uses boxes instead of sums of squares, or "" if the user chose
        boxes
    """
    statement = region.statement
    level, place, rises = region.bound
    fails = None
    lines = [f"Origin of V: {region.origin}. The proof of V' < 0 evaluates {region.boxes} boxes."]
    if reason:
        lines.append(f"Proved on boxes, not by sums of squares: {reason}.")
    if place is None:
        lines.append("No state with V' >= 0 or beyond a limit was found around the set.")
    else:
        what = "V' >= 0 was found" if rises else "A limit is exceeded"
        if rises:
            fails = dict(zip(statement.loop.states, place.tolist(), strict=True))
        share = np.sqrt(statement.rho / level)
        lines.append(
            f"{what} at V = {level:.6g}, {place_in_words(statement.loop, place)}. The linear "
            f"dimensions of the proved set are {share:.3g} times those of this level set."
        )
        if flight is not None:
            lines.append(f"A flight from this state {flight}.")
    lines.append(f"No larger set is proved: {region.stopped}.")
    found = FoundBoxes(statement, region.boxes, region.origin, fails, region.stopped)
    parts: tuple[str | Table, ...] = (
        _sentence(statement, policy),
        *_extents(statement),
        *lines,
        *_V(statement),
    )
    return Report(_title(statement, "Proved", not_covered), parts, data=found.as_data())


def checked_report(
    verified: Proved,
    policy: str,
    not_covered: str = NOT_COVERED,
    not_given: Sequence[str] = (),
) -> Report:
    """Return the report of a checked certificate of a region.

    policy: description of the policy
    not_covered: effects that the proof neglects, for the title
    not_given: parts of the statement that were not compared, because the user did not give them
    """
    statement = verified.statement
    loop = statement.loop
    checked = CheckedBoxes(statement, verified.size, verified.written, list(not_given))
    inputs = Table(
        ("input", "trim", "lowest", "highest"),
        [
            (name, loop.model.describe(name, value), *limits_in_words(loop, name))
            for name, value in {**loop.inputs, **loop.held}.items()
        ],
    )
    parts: tuple[str | Table, ...] = (
        _sentence(statement, policy),
        *_extents(statement),
        inputs,
        *_coefficients(statement),
        *outputs_in_words(loop),
        parameters_in_words(loop.model, loop.parameters),
        *_V(statement),
        f"The proof of V' < 0 evaluates {verified.size} boxes.",
    )
    title = _title(statement, "Verified, proved", not_covered, not_given)
    return Report(title, parts, data=checked.as_data())


def _title(
    statement: RegionStatement, verdict: str, not_covered: str, not_given: Sequence[str] = ()
) -> str:
    """Return the first line of a report.

    The line states the claim, the parts of the statement that were not compared, and the effects
    that the proof neglects.

    verdict: first words of the line
    not_covered: effects that the proof neglects
    not_given: parts of the statement that were not compared
    """
    claim = f"{verdict}: region of attraction of {statement.loop.model.title}"
    return first_line(claim, not_given, not_covered)


def _sentence(statement: RegionStatement, policy: str) -> str:
    saturated = ", ".join(statement.loop.inputs) or "no input"
    held = statement.loop.held
    kept = f" {', '.join(held)} held at trim values." if held else ""
    level = at_least(statement.rho, 6)
    V = "z'P z" if statement.degree == 2 else "W(M z)"
    cube = "" if statement.degree == 2 else ", |(M z)_i| <= 1"
    return (
        f"Every trajectory that begins in V(z) = {V} <= {level}{cube} stays there and within all "
        "limits, and converges to the equilibrium of the loop. z is the deviation from the "
        f"equilibrium. V is of degree {statement.degree}. Policy: {policy}. Inputs saturated: "
        f"{saturated}.{kept}"
    )


def _extents(statement: RegionStatement) -> tuple[Table, str]:
    """Return a table of the deviations in the set, and the sentence `NO_BOX`.

    Each row has the lowest and highest deviation of a state, its equilibrium and trim, and its
    limits. The sentence states that the set does not fill the box of these deviations.
    """
    model = statement.loop.model
    rows = []
    for name, (low, high) in statement.extents.items():
        unit = model.unit(name)
        least = f"{at_least(float(shown_values(low, unit)), 6)} {shown_unit(unit)}"
        most = f"{at_most(float(shown_values(high, unit)), 6)} {shown_unit(unit)}"
        at = model.describe(name, statement.equilibrium[name])
        trim = model.describe(name, statement.loop.trim[name])
        rows.append((name, least, most, at, trim, *limits_in_words(statement.loop, name)))
    header = ("the set lies within", "from", "to", "about", "trim", "lowest", "highest")
    return Table(header, rows), NO_BOX


def _V(statement: RegionStatement) -> tuple[str | Table, ...]:
    """Return text and tables that define V: the matrix P for degree 2, otherwise M and W(y)."""
    states = statement.loop.states
    P = quadratic_form(statement.piece)
    if P is None:
        return piece_in_words(statement.piece, states)
    rows = [(name, *(f"{entry:.6g}" for entry in row)) for name, row in zip(states, P, strict=True)]
    return (Table(("P", *states), rows),)


def _coefficients(statement: RegionStatement) -> tuple[Table | str, ...]:
    """Return tables and text of the policy's coefficients.

    The tuple is empty if the certificate stores only a digest of the policy.
    """
    loop = statement.loop
    if not isinstance(loop.policy, Gain):
        return ()
    rows = [
        (name, *(f"{entry:.6g}" for entry in row))
        for name, row in zip(loop.inputs, loop.policy.K.tolist(), strict=True)
    ]
    curved = curved_policies_in_words(loop.policy.terms, loop.states)
    return (Table(("K", *loop.states), rows), *curved)
