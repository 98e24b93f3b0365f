"""Reports of regions: text, tables and data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hfa_aircraft.march.ending import Outcome
from hfa_prove.check import Proved
from hfa_prove.check.game import SAME_GAIN
from hfa_prove.check.region_squares import extents_of
from hfa_prove.results import CheckedSet, FoundSet, Place
from hfa_prove.search.plant import NOT_RETURNED
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
    polynomial_in_words,
)
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, shown_unit, shown_values

if TYPE_CHECKING:
    from hfa_prove.search.region_squares import Region


def region_report(region: Region) -> Report:
    """Return the report of a proved region, and of the obstacles to a larger region."""
    statement = region.proved.statement
    bounds = region.bounds
    reaches = extents_of(statement, region.T)
    starts = {outcome: _place(statement, found) for outcome, found in bounds.starts.items()}
    found = FoundSet(
        statement,
        region.proved.parts,
        reaches,
        region.origin,
        _place(statement, bounds.rises),
        starts.get(Outcome.LEFT),
        starts.get(Outcome.DIVERGED),
        bounds.limits,
        region.stopped,
    )
    rows = [("proved", at_least(statement.rho, 6), "1", "")]
    nowhere = (np.inf, None)
    for name, (level, place) in (
        ("V' >= 0 found", bounds.rises),
        *((words, bounds.starts.get(kind, nowhere)) for kind, words in NOT_RETURNED.items()),
    ):
        if place is None:
            rows.append((name, "none found", "", ""))
            continue
        share = np.sqrt(level / statement.rho)
        rows.append((name, f"{level:.6g}", f"{share:.3g}", place_in_words(statement.loop, place)))
    table = Table(("level", "V", "linearly", "at"), rows)
    stopped = (f"No larger set is proved: {region.stopped}.",) if region.stopped else ()
    binding = ", ".join(bounds.limits) or "none"
    parts: tuple[str | Table, ...] = (
        _sentence(statement),
        *curved_policies_in_words(statement.loop.gain.terms, statement.loop.states),
        *_extents(statement, reaches),
        table,
        f"Limits that bind: {binding}. Origin of V: {region.origin}. Degree: {found.degree}. "
        + _where_proved(statement, region.proved.parts),
        *stopped,
        *_V(statement),
        _not_covered(statement),
    )
    return Report(_title(statement, "Proved"), parts, data=found.as_data())


def checked_report(verified: Proved, not_given: Sequence[str] = ()) -> Report:
    """Return the report of a checked certificate of a region.

    not_given: parts of the statement that were not compared, because the user did not give them
    """
    statement = verified.statement
    reaches = extents_of(statement, verified.witness.T)
    checked = CheckedSet(statement, verified.size, reaches, verified.written, list(not_given))
    loop = statement.loop
    gains = Table(
        ("K", *loop.states),
        [
            (name, *(f"{entry:.6g}" for entry in row))
            for name, row in zip(loop.inputs, loop.gain.K.tolist(), strict=True)
        ],
    )
    trim = Table(
        ("trim", "value", "lowest", "highest"),
        [
            (name, loop.model.describe(name, value), *limits_in_words(statement.loop, name))
            for name, value in {**loop.trim, **loop.inputs, **loop.held}.items()
        ],
    )
    parts: tuple[str | Table, ...] = (
        _sentence(statement),
        *curved_policies_in_words(statement.loop.gain.terms, statement.loop.states),
        *_extents(statement, reaches),
        trim,
        *_equilibrium(statement),
        gains,
        *_of_this_gain(statement, not_given),
        *outputs_in_words(loop),
        parameters_in_words(loop.model, loop.parameters),
        f"{_where_proved(statement, verified.size)} V is of degree {checked.degree}.",
        *_V(statement),
        _not_covered(statement),
    )
    return Report(_title(statement, "Verified, proved", not_given), parts, data=checked.as_data())


def _of_this_gain(statement: RegionStatement, not_given: Sequence[str]) -> tuple[str, ...]:
    """Return a note that the user's policy agrees with the stated policy within a tolerance.

    The note is in a tuple. The tuple is empty if the policies were not compared or the loop has no
    inputs.
    """
    if "policy" in not_given or not statement.loop.inputs:
        return ()
    return (
        "Proved for the policy in the certificate. The given policy agrees with it to "
        f"{SAME_GAIN:g} of its largest entry.",
    )


#: Effects that no statement covers, for the first line.
_WITHOUT = "sampling, delay, actuators"


def _title(statement: RegionStatement, verdict: str, not_given: Sequence[str] = ()) -> str:
    """Return the first line of a report.

    The line states the claim, the parts of the statement that were not compared, and the effects
    that the proof neglects.

    verdict: first words of the line
    not_given: parts of the statement that were not compared
    """
    title = statement.loop.model.title
    if statement.loop.disturbances:
        claim = f"{verdict}: invariant set of {title} under disturbances"
        without = _WITHOUT
    else:
        claim = f"{verdict}: region of attraction of {title}"
        without = f"{_WITHOUT}, disturbances"
    return first_line(claim, not_given, without)


def _sentence(statement: RegionStatement) -> str:
    saturated = ", ".join(statement.loop.inputs) or "no input"
    held = statement.loop.held
    kept = f" {', '.join(held)} held at trim values." if held else ""
    level = at_least(statement.rho, 6)
    begins = f"Every trajectory that begins in V(z) <= {level} stays there and within "
    end = "equilibrium" if _equilibrium(statement) else "trim"
    within = f"all limits, and converges to the {end}; inputs saturated: {saturated}.{kept}"
    if statement.loop.disturbances:
        within = (
            f"all limits under every disturbance {_sizes(statement)}; inputs saturated: "
            f"{saturated}.{kept} Convergence is not claimed."
        )
    return begins + within


def _sizes(statement: RegionStatement) -> str:
    """Return the bounds of all disturbances as text, such as "|gust| <= 1 m/s"."""
    model = statement.loop.model
    sizes = statement.loop.disturbances.items()
    return " and ".join(f"|{name}| <= {model.describe(name, size)}" for name, size in sizes)


def _where_proved(statement: RegionStatement, parts: int) -> str:
    if statement.loop.disturbances:
        return (
            f"V' < 0 is proved by sums of squares on {parts} parts of V = rho. The parts differ in "
            "the saturated inputs and the signs of the disturbances."
        )
    return (
        f"V' < 0 is proved by sums of squares on {parts} parts of the set, which differ in the "
        "saturated inputs."
    )


def _not_covered(statement: RegionStatement) -> str:
    gusts = "other disturbances" if statement.loop.disturbances else "disturbances"
    return (
        f"Not covered: sampling, actuators, delays, {gusts}, errors of the model. Inputs saturate "
        "at the limits of the model."
    )


def _extents(
    statement: RegionStatement, reaches: Mapping[str, tuple[float, float]]
) -> tuple[Table, str]:
    """Return a table of the deviations in the set, and the sentence `NO_BOX`.

    Each row has the lowest and highest deviation of a state, its trim and its limits. The sentence
    states that the set does not fill the box of these deviations.

    reaches: state -> lowest and highest deviation in the set
    """
    model = statement.loop.model
    rows = []
    for name, (low, high) in reaches.items():
        at = statement.loop.trim[name]
        unit = model.unit(name)
        ends = (
            at_least(float(shown_values(low, unit)), 6),
            at_most(float(shown_values(high, unit)), 6),
        )
        rows.append(
            (
                name,
                *(f"{end} {shown_unit(unit)}" for end in ends),
                model.describe(name, at),
                *limits_in_words(statement.loop, name),
            )
        )
    header = ("the set lies within", "from", "to", "about", "lowest", "highest")
    return Table(header, rows), NO_BOX


def _V(statement: RegionStatement) -> tuple[str | Table, ...]:
    """Return V with all of its terms as text, six digits for each coefficient."""
    piece = statement.piece
    states = statement.loop.states
    if piece.whole and np.array_equal(piece.M, np.eye(len(states))):
        return (f"V(z) = {polynomial_in_words(statement.terms, states)}",)
    table, V = piece_in_words(piece, states)
    return table, V if piece.whole else f"{V}, |y_i| < 1"


def _equilibrium(statement: RegionStatement) -> tuple[str, ...]:
    """Return one line on the stated equilibrium if it differs from the trim, otherwise ()."""
    if dict(statement.equilibrium) == dict(statement.loop.trim):
        return ()
    values = ", ".join(f"{name} {value:.15g}" for name, value in statement.equilibrium.items())
    return (f"Equilibrium near {values}, in the units of the model.",)


def _place(statement: RegionStatement, found: tuple[float, np.ndarray | None]) -> Place | None:
    """Return an obstacle for the data of the report, or None if no state was found.

    found: level of V, and the state deviation at that level or None
    """
    level, place = found
    if place is None:
        return None
    return Place(level, dict(zip(statement.loop.states, place.tolist(), strict=True)))
