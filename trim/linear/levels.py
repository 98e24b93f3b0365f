"""Levels of flying qualities of the modes at a trim, by MIL-F-8785C (November 1980).

Level 1 is adequate for the mission, level 2 adequate with more workload, level 3 controllable. The
limits depend on the class of the airplane and on the category of the flight phase. Limits are those
of the modes only: not of feel, control power, turbulence or failures.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Cell, Table

#: Classes: I small and light; II medium, at a carrier or on land; III large; IV maneuverable.
CLASSES = ("I", "II-C", "II-L", "III", "IV")
#: Categories: A rapid maneuvers; B gradual maneuvers, such as cruise; C terminal, such as landing.
CATEGORIES = ("A", "B", "C")
STANDARD = "MIL-F-8785C"
#: Modes with a rule, and the paragraph on roll and spiral coupled in one oscillation.
_MODES = ("short period", "phugoid", "dutch roll", "roll", "spiral")
_COUPLED = "3.3.1.4"
#: Number of a quality that is worse than level 3.
NO_LEVEL = 4
_AGILE = ("I", "II-C", "IV")
_TONES = {1: "good", 2: "near", 3: "far", NO_LEVEL: "bad"}


class Airplane(NamedTuple):
    """What decides the limits: class of the airplane and category of the flight phase."""

    class_: str = "I"
    category: str = "B"

    @property
    def is_agile(self) -> bool:
        """Whether the limits of the classes I, II-C and IV apply, not those of II-L and III."""
        return self.class_ in _AGILE


#: Smallest and largest value of the levels 1, 2 and 3.
Limits = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Graded(Result):
    """Quality of a mode, with its level.

    mode: name of the mode
    quality: name of the quality, or "" for a mode without a rule
    value: value, in `unit`
    unit: unit
    level: 1 to 3, or 4 if it is worse than level 3; None without a rule
    limits: smallest and largest value of the levels 1, 2 and 3
    paragraph: paragraph of the standard
    """

    mode: str
    quality: str
    value: float
    unit: str
    level: int | None
    limits: Limits
    paragraph: str


def graded(
    qualities: Mapping[str, float], modes: Sequence[str], airplane: Airplane
) -> tuple[Graded, ...]:
    """Return the levels of the modes, and modes without a rule.

    qualities: name -> value, as `handling_qualities` names them
    modes: names of the modes at the trim
    airplane: class and category
    """
    if "spiral time to half" in qualities:
        qualities = {**qualities, "spiral time to double": math.inf}
    found: list[Graded] = []
    for mode in dict.fromkeys(name.partition(" (")[0] for name in modes):
        rules = [rule for rule in _rules(mode, qualities, airplane) if rule.quality in qualities]
        if not rules:
            known = any(_rules(mode, qualities, airplane))
            reason = " (real eigenvalues)" if known else ""
            found.append(Graded(mode + reason, "", math.nan, "", None, (), ""))
        for rule in rules:
            value = qualities[rule.quality]
            level = level_of(value, rule.limits)
            short = rule.quality.removeprefix(f"{mode} ")
            found.append(Graded(mode, short, value, rule.unit, level, rule.limits, rule.paragraph))
    return tuple(found)


def level_of(value: float, limits: Limits) -> int:
    """Return the best level whose limits contain a value, or `NO_LEVEL`."""
    for level, (least, most) in enumerate(limits, start=1):
        if least <= value <= most:
            return level
    return NO_LEVEL


class _Rule(NamedTuple):
    quality: str
    unit: str
    paragraph: str
    limits: Limits


def _least(*values: float) -> Limits:
    return [(value, math.inf) for value in values]


def _most(*values: float) -> Limits:
    return [(-math.inf, value) for value in values]


def _rules(mode: str, qualities: Mapping[str, float], airplane: Airplane) -> Iterator[_Rule]:
    """Yield the rules for a mode."""
    match mode:
        case "short period":
            yield from _of_short_period(airplane)
        case "phugoid":
            yield from _of_phugoid(qualities)
        case "dutch roll":
            yield from _of_dutch_roll(qualities, airplane)
        case "roll":
            agile = airplane.is_agile and airplane.category != "B"
            limits = _most(1.0, 1.4, 10.0) if agile else _most(1.4, 3.0, 10.0)
            yield _Rule("roll time constant", "s", "3.3.1.2", limits)
            yield _of_roll_spiral(mode, airplane)
        case "spiral":
            first = 20.0 if airplane.category == "B" else 12.0
            yield _Rule("spiral time to double", "s", "3.3.1.3", _least(first, 8.0, 4.0))
            yield _of_roll_spiral(mode, airplane)


def _of_short_period(airplane: Airplane) -> Iterator[_Rule]:
    """Yield the rules for damping, CAP = ω²/(n/α), frequency and n/α of the short period."""
    damping = [(0.35, 1.3), (0.25, 2.0), (0.15, math.inf)]
    if airplane.category == "B":
        damping = [(0.30, 2.0), (0.20, 2.0), (0.15, math.inf)]
    yield _Rule("short period damping", "1", "3.2.2.1.2", damping)
    paragraph = "3.2.2.1.1"
    level_1, level_2 = {"A": (0.28, 0.16), "B": (0.085, 0.038), "C": (0.16, 0.096)}[
        airplane.category
    ]
    cap = [(level_1, 3.6), (level_2, 10.0), (level_2, math.inf)]
    yield _Rule("CAP", "1/(s^2 g/rad)", paragraph, cap)
    if airplane.category == "A":
        yield _Rule("short period frequency", "rad/s", paragraph, _least(1.0, 0.6, 0.0))
    if airplane.category == "C":
        frequency = _least(0.87, 0.6, 0.0) if airplane.is_agile else _least(0.7, 0.4, 0.0)
        yield _Rule("short period frequency", "rad/s", paragraph, frequency)
        load = _least(2.7, 1.8, -math.inf) if airplane.is_agile else _least(2.0, 1.0, -math.inf)
        yield _Rule("n/alpha", "g/rad", paragraph, load)


def _of_phugoid(qualities: Mapping[str, float]) -> Iterator[_Rule]:
    """Yield the rule for the damping of the phugoid; level 3 is a time to double of 55 s."""
    frequency = qualities.get("phugoid frequency", math.inf)
    limits = _least(0.04, 0.0, -math.log(2.0) / (55.0 * frequency))
    yield _Rule("phugoid damping", "1", "3.2.1.2", limits)


def _of_roll_spiral(mode: str, airplane: Airplane) -> _Rule:
    """Return the rule for roll and spiral coupled in an oscillation, which category A excludes."""
    limits = _least(0.5, 0.3, 0.15)
    if airplane.category == "A":
        limits = _least(math.inf, math.inf, math.inf)
    return _Rule(f"{mode} damping times frequency", "rad/s", _COUPLED, limits)


def _of_dutch_roll(qualities: Mapping[str, float], airplane: Airplane) -> Iterator[_Rule]:
    """Yield the rules for damping, damping times frequency, and frequency of the Dutch roll.

    The limits of ζω increase with ω² |φ/β| above 20 (rad/s)². For class III, a damping of 0.7
    satisfies each of them.
    """
    level_1 = _level_1_of_dutch_roll(airplane)
    omega = qualities.get("dutch roll frequency", 0.0)
    excess = max(0.0, omega**2 * qualities.get("dutch roll phi/beta", 0.0) - 20.0)
    products = [
        level_1.product + 0.014 * excess,
        0.05 + 0.009 * excess,
        0.005 * excess if excess else -math.inf,
    ]
    if airplane.class_ == "III":
        products = [min(product, 0.7 * omega) for product in products]
    paragraph = "3.3.1.1"
    yield _Rule("dutch roll damping", "1", paragraph, _least(level_1.damping, 0.02, 0.0))
    yield _Rule("dutch roll damping times frequency", "rad/s", paragraph, _least(*products))
    yield _Rule("dutch roll frequency", "rad/s", paragraph, _least(level_1.frequency, 0.4, 0.4))


class _DutchRoll(NamedTuple):
    """Least damping ζ, product ζω, rad/s, and frequency ω, rad/s, of the Dutch roll."""

    damping: float
    product: float
    frequency: float


def _level_1_of_dutch_roll(airplane: Airplane) -> _DutchRoll:
    """Return the limits of level 1 before ω² |φ/β| is considered."""
    if airplane.category == "A":
        return _DutchRoll(0.19, 0.35, 1.0 if airplane.class_ in ("I", "IV") else 0.4)
    if airplane.category == "C":
        return _DutchRoll(0.08, 0.15, 1.0) if airplane.is_agile else _DutchRoll(0.08, 0.10, 0.4)
    return _DutchRoll(0.08, 0.15, 0.4)


def levels_table(found: Sequence[Graded], airplane: Airplane, stated: bool) -> tuple[Any, ...]:
    """Return the table of the levels, and a line on class, category and modes without a rule.

    stated: whether the user stated class and category
    """
    rows = []
    for each in found:
        if each.level is not None:
            level = "worse" if each.level == NO_LEVEL else str(each.level)
            quality = each.quality.replace("damping times frequency", "ζω").replace("phi", "φ")
            cell = Cell(level, _TONES[each.level])
            name = f"{each.mode} {quality}"
            rows.append(
                (name, f"{each.value:.4g}", cell, _limits_text(each.limits), each.paragraph)
            )
    if not rows:
        return (f"{STANDARD}: not in this model: no mode that it has a rule for",)
    header = (STANDARD, "value", "level", "limits of levels 1, 2, 3", "paragraph")
    usual = "" if stated else ", by default (--class, --category)"
    lines = [f"{STANDARD}: class {airplane.class_}, category {airplane.category}{usual}"]
    without = [each.mode for each in found if each.level is None]
    if without:
        lines.append(f"{STANDARD} has no rule for: {', '.join(without)}")
    named = {each.mode.partition(" (")[0] for each in found}
    if any(each.paragraph == _COUPLED for each in found):
        named |= {"roll", "spiral"}
    if absent := [mode for mode in _MODES if mode not in named]:
        lines.append(f"{', '.join(absent)}: not in this model")
    return Table(header, rows), "\n".join(lines)


def _limits_text(limits: Limits) -> str:
    """Return limits as text: "at least 0.08, 0.02, 0", "at most 1.4, 3, 10" or "0.3-2, 0.15-"."""
    least, most = ([each[end] for each in limits] for end in (0, 1))
    if all(math.isinf(each) for each in most):
        return "at least " + ", ".join(_number_text(each) for each in least)
    if all(math.isinf(each) for each in least):
        return "at most " + ", ".join(_number_text(each) for each in most)
    ranges = []
    for low, high in limits:
        ranges.append(f"{low:.3g}-" + ("" if math.isinf(high) else f"{high:.3g}"))
    return ", ".join(ranges)


def _number_text(limit: float) -> str:
    """Return a limit as text; no limit is "any", and a level that does not exist "none"."""
    if math.isinf(limit):
        return "any" if limit < 0.0 else "none"
    return f"{limit:.3g}"
