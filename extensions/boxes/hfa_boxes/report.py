"""A region that is proved on boxes, in words, tables and data."""

from __future__ import annotations

import numpy as np

from hfa_boxes.check.checker import VerifiedBoxes
from hfa_boxes.check.statement import BoxStatement
from hfa_boxes.results import CheckedBoxes, FoundBoxes
from hfa_boxes.search.region import BoxRegion
from hfa_proof.outward import at_least, at_most
from hfa_proof.results import limits_in_words, place_in_words
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, shown_unit, shown_values

NOT_COVERED = "sampling, delay, actuators, disturbances not covered"


def found_report(
    region: BoxRegion, policy: str, flight: str | None, not_covered: str = NOT_COVERED
) -> Report:
    """Return the report of a proved region and its bounds.

    policy: its description
    flight: end of a flight from the state with V' >= 0; None without one
    not_covered: of the loop, in the title
    """
    statement = region.statement
    level, place = region.rises
    fails = None
    lines = [f"V is {region.origin}; V' < 0 is proved on {region.boxes} boxes."]
    if place is None:
        lines.append("No state with V' >= 0 was found within the limits.")
    else:
        fails = dict(zip(statement.loop.states, place.tolist(), strict=True))
        share = np.sqrt(statement.rho / level)
        lines.append(
            f"V' >= 0 at V = {level:.6g}, {place_in_words(statement.loop, place)}: the proved set "
            f"reaches {share:.3g} of that level, linearly."
        )
        if flight is not None:
            lines.append(f"A flight from that state {flight}.")
    lines.append(f"No larger level is proved: {region.stopped}.")
    found = FoundBoxes(statement, region.boxes, region.origin, fails, region.stopped)
    parts: tuple[str | Table, ...] = (_sentence(statement, policy), _extents(statement), *lines)
    return Report(_title(statement, "Proved", not_covered), parts, data=found.as_data())


def checked_report(verified: VerifiedBoxes, policy: str, not_covered: str = NOT_COVERED) -> Report:
    """Return the report of a checked certificate."""
    statement = verified.statement
    loop = statement.loop
    checked = CheckedBoxes(statement, verified.boxes, verified.written)
    inputs = Table(
        ("input", "trim", "lowest", "highest"),
        [
            (name, loop.model.describe(name, value), *limits_in_words(loop, name))
            for name, value in {**loop.inputs, **loop.held}.items()
        ],
    )
    parts: tuple[str | Table, ...] = (
        _sentence(statement, policy),
        _extents(statement),
        inputs,
        f"V' < 0 is proved on {verified.boxes} boxes.",
    )
    title = _title(statement, "Verified, proved", not_covered)
    return Report(title, parts, data=checked.as_data())


def _title(statement: BoxStatement, verdict: str, not_covered: str) -> str:
    title = statement.loop.model.title
    return f"{verdict}: region of attraction of {title}; {not_covered}"


def _sentence(statement: BoxStatement, policy: str) -> str:
    saturated = ", ".join(statement.loop.inputs) or "no input"
    held = statement.loop.held
    kept = f" {', '.join(held)} held at the trim's." if held else ""
    level = at_least(statement.rho, 6)
    return (
        f"Every trajectory that begins in V(z) = z'P z <= {level} stays there and within all "
        "limits, and converges to the equilibrium of the loop; z: deviation from that. "
        f"Policy: {policy}. Inputs saturated: {saturated}.{kept}"
    )


def _extents(statement: BoxStatement) -> Table:
    model = statement.loop.model
    rows = []
    for name, extent in statement.extents.items():
        unit = model.unit(name)
        reach = f"{at_most(float(shown_values(extent, unit)), 6)} {shown_unit(unit)}"
        at = model.describe(name, statement.equilibrium[name])
        trim = model.describe(name, statement.loop.trim[name])
        rows.append((name, reach, at, trim, *limits_in_words(statement.loop, name)))
    header = ("the set reaches", "by", "about", "trim", "lowest", "highest")
    return Table(header, rows)
