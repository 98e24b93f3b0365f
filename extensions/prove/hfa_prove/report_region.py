"""Reports of regions of attraction and invariant sets: text, tables and data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hfa_aircraft.march.ending import Outcome
from hfa_prove.check import Proved
from hfa_prove.results import CheckedRegion, FoundRegion, Place, ProvedRegion
from hfa_prove.statements.game import SAME_GAIN
from hfa_prove.statements.loop import Gain
from hfa_prove.statements.region import RegionStatement, SquaresWitness
from hfa_prove.subject import qualified
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
    from hfa_prove.search.region_search import Region

#: Effects that no statement covers, for the first line.
_WITHOUT = "sampling, delay, actuators"


def region_report(region: Region, policy: str = "", timing: str = _WITHOUT) -> Report:
    """Return the report of a proved set, and of the obstacles to a larger set.

    policy: description of the policy, or ""
    timing: effects other than disturbances that the proof neglects, for the first line
    """
    assert region.obstacles is not None  # of a search
    statement = region.statement
    starts = region.obstacles.starts
    found = FoundRegion(
        statement,
        region.prover,
        region.size,
        region.extents,
        region.origin,
        _place(statement, region.obstacles.rises),
        _place(statement, starts.get(Outcome.LEFT)),
        _place(statement, starts.get(Outcome.DIVERGED)),
        region.obstacles.limits,
        region.stopped,
        region.others,
    )
    binding = ", ".join(region.obstacles.limits) or "none"
    lines = [
        f"Limits that bind: {binding}. Origin of V: {region.origin}. Degree: {found.degree}.",
        _where_proved(found),
    ]
    lines += [f"{_METHOD[name].capitalize()}: {what}." for name, what in region.others.items()]
    if region.stopped:
        lines.append(f"No larger set is proved: {region.stopped}.")
    parts: tuple[str | Table, ...] = (
        _sentence(found, policy),
        *_curved(found),
        *_extents(found),
        _obstacles(region),
        "\n".join(lines),
        *_V(found),
        _not_covered(found),
    )
    return Report(_title(found, "Proved", timing), parts, data=found.as_data())


def checked_report(
    verified: Proved,
    not_given: Sequence[str] = (),
    policy: str = "",
    timing: str = _WITHOUT,
) -> Report:
    """Return the report of a checked certificate of a region.

    not_given: parts of the statement that were not compared, because the user did not give them
    policy: description of the policy, or ""
    timing: effects other than disturbances that the proof neglects, for the first line
    """
    statement = verified.statement
    prover, reaches = "boxes", dict(statement.extents)
    if isinstance(verified.witness, SquaresWitness):
        from hfa_prove.check.region_squares import extents_of

        prover, reaches = "squares", extents_of(statement, verified.witness.T)
    written = verified.written
    checked = CheckedRegion(statement, prover, verified.size, reaches, written, list(not_given))
    loop = statement.loop
    trim = Table(
        ("trim", "value", "lowest", "highest"),
        [
            (name, loop.model.describe(name, value), *limits_in_words(loop, name))
            for name, value in {**loop.trim, **loop.inputs, **loop.held}.items()
        ],
    )
    parts: tuple[str | Table, ...] = (
        _sentence(checked, policy),
        *_curved(checked),
        *_extents(checked),
        trim,
        *_equilibrium(checked),
        *_gains(checked, not_given),
        *outputs_in_words(loop),
        parameters_in_words(loop.model, loop.parameters),
        f"{_where_proved(checked)} V is of degree {checked.degree}.",
        *_V(checked),
        _not_covered(checked),
    )
    title = _title(checked, "Verified, proved", timing, not_given)
    return Report(title, parts, data=checked.as_data())


#: Row of the table of obstacles.
_RISE = "V' >= 0 found"
#: Prover -> its method.
_METHOD = {"squares": "sums of squares", "boxes": "branch and bound"}


def _title(proved: ProvedRegion, verdict: str, timing: str, not_given: Sequence[str] = ()) -> str:
    """Return the first line of a report.

    The line states the claim, the parts of the statement that were not compared, and the effects
    that the proof neglects.

    verdict: first words of the line
    timing: effects other than disturbances that the proof neglects
    not_given: parts of the statement that were not compared
    """
    title = proved.subject.model.title
    if proved.disturbances:
        claim = f"{verdict}: invariant set of {title} under disturbances"
        return f"{qualified(claim, not_given)}, without {timing}"
    claim = f"{verdict}: region of attraction of {title}"
    return f"{qualified(claim, not_given)}, without {timing}, disturbances"


def _sentence(proved: ProvedRegion, policy: str) -> str:
    loop = proved.subject
    saturated = ", ".join(loop.inputs) or "no input"
    held = f" {', '.join(loop.held)} held at trim values." if loop.held else ""
    flown = f" Policy: {policy}." if policy else ""
    level = at_least(proved.rho, 6)
    begins = f"Every trajectory that begins in V(z) <= {level} stays there and within all limits"
    if proved.disturbances:
        return (
            f"{begins} under every disturbance {_sizes(proved)}; inputs saturated: {saturated}."
            f"{held}{flown} Convergence is not claimed."
        )
    end = "equilibrium" if _equilibrium(proved) else "trim"
    return f"{begins}, and converges to the {end}; inputs saturated: {saturated}.{held}{flown}"


def _sizes(proved: ProvedRegion) -> str:
    """Return the bounds of all disturbances as text, such as "|gust| <= 1 m/s"."""
    model = proved.subject.model
    sizes = proved.disturbances.items()
    return " and ".join(f"|{name}| <= {model.describe(name, size)}" for name, size in sizes)


def _where_proved(proved: ProvedRegion) -> str:
    method = f"V' < 0 is proved by {_METHOD[proved.prover]} (--prover {proved.prover})"
    if proved.prover == "boxes":
        return f"{method} on {proved.size} boxes."
    if proved.disturbances:
        return (
            f"{method} on {proved.size} parts of V = rho. The parts differ in the saturated inputs "
            "and the signs of the disturbances."
        )
    return f"{method} on {proved.size} parts of the set, which differ in the saturated inputs."


def _not_covered(proved: ProvedRegion) -> str:
    gusts = "other disturbances" if proved.disturbances else "disturbances"
    return (
        f"Not covered: sampling, actuators, delays, {gusts}, errors of the model. Inputs saturate "
        "at the limits of the model."
    )


def _extents(proved: ProvedRegion) -> tuple[Table, str]:
    """Return a table of the deviations in the set, and the sentence `NO_BOX`.

    Each row has the lowest and highest deviation of a state, its equilibrium and its limits. The
    sentence states that the set does not fill the box of these deviations.
    """
    loop = proved.subject
    about = proved.statement.equilibrium
    rows = []
    for name, (low, high) in proved.reaches.items():
        unit = loop.model.unit(name)
        least = f"{at_least(float(shown_values(low, unit)), 6)} {shown_unit(unit)}"
        most = f"{at_most(float(shown_values(high, unit)), 6)} {shown_unit(unit)}"
        at = loop.model.describe(name, about[name])
        rows.append((name, least, most, at, *limits_in_words(loop, name)))
    header = ("the set lies within", "from", "to", "about", "lowest", "highest")
    return Table(header, rows), NO_BOX


def _obstacles(region: Region) -> Table:
    """Return a table of the lowest levels of V at which a larger set meets an obstacle."""
    from hfa_prove.search.obstacles import NOT_RETURNED

    assert region.obstacles is not None  # of a search
    rho = region.statement.rho
    rows = [("proved", at_least(rho, 6), "1", "")]
    nowhere = (np.inf, None)
    starts = region.obstacles.starts
    for name, (level, place) in (
        (_RISE, region.obstacles.rises),
        *((words, starts.get(kind, nowhere)) for kind, words in NOT_RETURNED.items()),
    ):
        if place is None:
            is_open = name != _RISE and not region.obstacles.simulated
            rows.append((name, "not simulated in the time" if is_open else "none found", "", ""))
            continue
        share = np.sqrt(level / rho)
        where = place_in_words(region.statement.loop, place)
        rows.append((name, f"{level:.6g}", f"{share:.3g}", where))
    return Table(("level", "V", "linearly", "at"), rows)


def _V(proved: ProvedRegion) -> tuple[str | Table, ...]:
    """Return text and tables that define V with six digits for each coefficient."""
    states = proved.subject.states
    piece = proved.statement.piece
    if piece.whole and np.array_equal(piece.M, np.eye(len(states))):
        return (f"V(z) = {polynomial_in_words(proved.terms, states)}",)
    table, V = piece_in_words(piece, states)
    return table, V if piece.whole else f"{V}, |y_i| < 1"


def _equilibrium(proved: ProvedRegion) -> tuple[str, ...]:
    """Return one line on the stated equilibrium if it differs from the trim, otherwise ()."""
    stated = dict(proved.statement.equilibrium)
    if stated == dict(proved.subject.trim):
        return ()
    values = ", ".join(f"{name} {value:.15g}" for name, value in stated.items())
    return (f"Equilibrium near {values}, in the units of the model.",)


def _curved(proved: ProvedRegion) -> tuple[str, ...]:
    """Return one line for each input whose policy is a nonlinear polynomial."""
    gain = proved.subject.policy
    if not isinstance(gain, Gain):
        return ()
    return curved_policies_in_words(gain.terms, proved.subject.states)


def _gains(proved: ProvedRegion, not_given: Sequence[str]) -> tuple[Table | str, ...]:
    """Return a table of the gain, and a note on the comparison with the user's policy.

    The result is empty if the certificate stores only a digest of the policy.
    """
    gain = proved.subject.policy
    if not isinstance(gain, Gain):
        return ()
    loop = proved.subject
    rows = [
        (name, *(f"{entry:.6g}" for entry in row))
        for name, row in zip(loop.inputs, gain.K.tolist(), strict=True)
    ]
    gains = Table(("K", *loop.states), rows)
    if "policy" in not_given or not loop.inputs:
        return (gains,)
    return (
        gains,
        "Proved for the policy in the certificate. The given policy agrees with it to "
        f"{SAME_GAIN:g} of its largest entry.",
    )


def _place(
    statement: RegionStatement, found: tuple[float, np.ndarray | None] | None
) -> Place | None:
    """Return an obstacle for the data of the report, or None if no state was found.

    found: level of V, and the state deviation at that level or None
    """
    if found is None or found[1] is None:
        return None
    level, place = found
    assert place is not None  # as found above
    return Place(level, dict(zip(statement.loop.states, place.tolist(), strict=True)))
