"""A region in words, tables and data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hfa_region.check.certificate import VerifiedRegion
from hfa_region.check.statement import RegionStatement
from hfa_region.results import CheckedSet, FoundSet, Place
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from hfa_region.search.region import Region


def region_report(region: Region) -> Report:
    """What is proved, and what bounds it.

    region: proved"""
    statement = region.proved.statement
    bounds = region.bounds
    found = FoundSet(
        statement,
        region.proved.parts,
        region.origin,
        _place(statement, bounds.rises),
        _place(statement, bounds.lost),
        bounds.limits,
    )
    rows = [("proved", f"{statement.rho:.6g}", "1", "")]
    for name, (level, place) in (
        ("V' >= 0 found", bounds.rises),
        ("start lost", bounds.lost),
    ):
        if place is None:
            rows.append((name, "none found", "", ""))
            continue
        share = np.sqrt(level / statement.rho)
        rows.append((name, f"{level:.6g}", f"{share:.3g}", _described(statement, place)))
    table = Table(("level", "V", "linearly", "at"), rows)
    binding = ", ".join(bounds.limits) or "none"
    parts: tuple[str | Table, ...] = (
        _sentence(statement),
        *_policy(statement),
        _extents(statement),
        table,
        f"Limits that bind: {binding}. V is {region.origin}, of degree {found.degree}; "
        + _where_proved(statement, region.proved.parts),
        _not_covered(statement),
    )
    return Report(_title(statement), parts, data=found.as_data())


def checked_report(verified: VerifiedRegion) -> Report:
    """What a certificate proves, as the checker has read it."""
    statement = verified.statement
    checked = CheckedSet(statement, verified.parts, verified.written)
    loop = statement.loop
    gains = Table(
        ("K", *loop.states),
        [
            (name, *(f"{entry:.6g}" for entry in row))
            for name, row in zip(loop.inputs, loop.K.tolist(), strict=True)
        ],
    )
    trim = Table(
        ("trim", "value", "lowest", "highest"),
        [
            (name, loop.model.describe(name, value), *_limits(statement, name))
            for name, value in {**loop.trim, **loop.inputs, **loop.held}.items()
        ],
    )
    parts: tuple[str | Table, ...] = (
        _sentence(statement),
        *_policy(statement),
        _extents(statement),
        trim,
        gains,
        f"{_where_proved(statement, verified.parts)} V of degree {checked.degree}, "
        f"{len(statement.terms)} terms: with --json.",
        _not_covered(statement),
    )
    return Report(f"{_title(statement)}, checked", parts, data=checked.as_data())


def _title(statement: RegionStatement) -> str:
    title = statement.loop.model.title
    if statement.loop.disturbances:
        return f"Invariant set of {title} under disturbances: proved"
    return f"Region of attraction of {title}: proved"


def _sentence(statement: RegionStatement) -> str:
    saturated = ", ".join(statement.loop.inputs) or "no input"
    held = statement.loop.held
    kept = f" {', '.join(held)} held at the trim's." if held else ""
    begins = f"Every trajectory that begins in V(z) <= {statement.rho:.6g} stays there and within "
    within = f"all limits, and converges to the trim; inputs saturated: {saturated}.{kept}"
    if statement.loop.disturbances:
        within = (
            f"all limits under every disturbance {_sizes(statement)}; inputs saturated: "
            f"{saturated}.{kept} That it converges is not claimed."
        )
    return begins + within


def _sizes(statement: RegionStatement) -> str:
    """The bounds of all disturbances, in words."""
    model = statement.loop.model
    sizes = statement.loop.disturbances.items()
    return " and ".join(f"|{name}| <= {model.describe(name, size)}" for name, size in sizes)


def _where_proved(statement: RegionStatement, parts: int) -> str:
    if statement.loop.disturbances:
        return (
            f"V' < 0 is proved on {parts} parts of V = rho, by what each input does and the end "
            "that each disturbance is at."
        )
    return f"V' < 0 is proved on {parts} parts of the set, by what each input does."


def _not_covered(statement: RegionStatement) -> str:
    gusts = "other disturbances" if statement.loop.disturbances else "disturbances"
    return (
        f"Not covered: sampling, actuators, delays, {gusts}, errors of the model; the loop is that "
        "of the model as it is, its inputs saturated at their limits."
    )


def _policy(statement: RegionStatement) -> tuple[str, ...]:
    """The policy of each input that is not linear, a line each."""
    loop = statement.loop
    lines = []
    for name, terms in loop.policy.items():
        monomials = []
        for coefficient, exponents in terms:
            powers = zip(loop.states, exponents, strict=True)
            factors = [f"{state}^{power}" for state, power in powers if power]
            monomials.append(" ".join([f"{coefficient:+.6g}", *factors]))
        lines.append(f"The policy of {name} is -K z {' '.join(monomials)}, then saturated.")
    return tuple(lines)


def _extents(statement: RegionStatement) -> Table:
    model = statement.loop.model
    rows = []
    for name, (low, high) in statement.extents.items():
        at = statement.loop.trim[name]
        rows.append(
            (
                name,
                model.describe(name, low),
                model.describe(name, high),
                model.describe(name, at),
                *_limits(statement, name),
            )
        )
    header = ("the set reaches", "from", "to", "about", "lowest", "highest")
    return Table(header, rows)


def _limits(statement: RegionStatement, name: str) -> list[str]:
    """Lowest and highest value of a signal, in words."""
    ends = statement.loop.limits.get(name, (-np.inf, np.inf))
    model = statement.loop.model
    return [model.describe(name, end) if np.isfinite(end) else "-" for end in ends]


def _described(statement: RegionStatement, place: Sequence[float] | np.ndarray) -> str:
    model = statement.loop.model
    pairs = zip(statement.loop.states, np.asarray(place).tolist(), strict=True)
    return ", ".join(f"{name} {model.describe(name, value)}" for name, value in pairs)


def _place(statement: RegionStatement, found: tuple[float, np.ndarray | None]) -> Place | None:
    """A level and the deviations there; None where nothing was found."""
    level, place = found
    if place is None:
        return None
    return Place(level, dict(zip(statement.loop.states, place.tolist(), strict=True)))
