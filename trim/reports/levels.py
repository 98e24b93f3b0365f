"""Handling qualities of the modes, and their levels by MIL-F-8785C."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hfa_support.reporting.rows import Row
from hfa_support.units import STANDARD_GRAVITY, conversion_factor
from trim.linear.modes import Mode
from trim.reports.trimmed import Trimmed
from trim.reports.warnings import Quantity, configuration_of

#: Classes: I small and light; II medium, at a carrier or on land; III large; IV maneuverable.
CLASSES = ("I", "II-C", "II-L", "III", "IV")
#: Categories: A rapid maneuvers; B gradual maneuvers, such as cruise; C terminal, such as landing.
CATEGORIES = ("A", "B", "C")
STANDARD = "MIL-F-8785C"
#: Modes with a rule, and the quality of roll and spiral coupled in one oscillation.
_MODES = ("short period", "phugoid", "dutch roll", "roll", "spiral")
_COUPLED = "damping times frequency"
#: Number of a quality that is worse than level 3.
NO_LEVEL = 4
_AGILE = ("", "I", "II-C", "IV")
#: Tone of each level.
TONES = {1: "good", 2: "near", 3: "far", NO_LEVEL: "bad"}
#: Largest weights of the classes I and II-L, lbf, and least limit load factor of class IV.
_LIGHT, _MEDIUM = 12_500.0, 60_000.0
_MANEUVERABLE = 6.0


class Airplane(NamedTuple):
    """What decides the limits: class of the airplane and category of the flight phase.

    The class "" is chosen by weight and load factor where these are known (`usual_class`), a
    convention of this tool: the standard describes the classes in words. It is class I elsewhere.
    """

    class_: str = ""
    category: str = "B"

    @property
    def is_agile(self) -> bool:
        """Whether the limits of the classes I, II-C and IV apply, not those of II-L and III."""
        return self.class_ in _AGILE


#: Class by weight, category B.
DEFAULT_AIRPLANE = Airplane()


class Span(NamedTuple):
    """Smallest and largest value of a level."""

    least: float = -math.inf
    most: float = math.inf


#: Values of the levels 1, 2 and 3.
Limits = Sequence[Span]


class Chosen(NamedTuple):
    """Class and category of an airplane, and the reason for a class that the user did not state.

    why: the reason, or ""
    """

    airplane: Airplane
    why: str


class UsualClass(NamedTuple):
    """Class of an airplane, and the reason for it."""

    class_: str
    why: str


def chosen_airplane(trimmed: Trimmed, airplane: Airplane) -> Chosen:
    """Return class and category as the user states them, with the usual class if he does not."""
    if airplane.class_:
        return Chosen(airplane, "")
    usual = usual_class(trimmed)
    return Chosen(airplane._replace(class_=usual.class_), usual.why)


def usual_class(trimmed: Trimmed) -> UsualClass:
    """Return the class of an airplane by its declared load factor and its weight, and the reason.

    - IV: the model declares a largest load factor of at least 6
    - I, II-L, III: weight up to 12,500 lbf, up to 60,000 lbf, above
    - I: the model has neither a weight nor a mass, or one in a unit of another quantity

    These numbers are a convention of this tool. MIL-F-8785C, 1.3, describes the classes in words:
    I small and light, II of medium weight, III large and heavy, IV of high maneuverability.
    """
    outputs = trimmed.model.outputs
    largest_load = outputs["load_factor"].max if "load_factor" in outputs else math.inf
    if _MANEUVERABLE <= largest_load < math.inf:
        return UsualClass("IV", f"load factor up to {largest_load:.3g}")
    weight = _weight(trimmed)
    unit_per_lbf = None if weight is None else conversion_factor("lbf", weight.unit)
    if weight is None or unit_per_lbf is None:
        return UsualClass("I", "weight unknown")
    for class_, most_weight in (("I", _LIGHT), ("II-L", _MEDIUM)):
        most_in_unit = most_weight * unit_per_lbf
        if weight.value <= most_in_unit:
            return UsualClass(class_, f"weight up to {most_in_unit:,.0f} {weight.unit}")
    return UsualClass("III", f"weight above {_MEDIUM * unit_per_lbf:,.0f} {weight.unit}")


def _weight(trimmed: Trimmed) -> Quantity | None:
    """Return the weight, or None if it is unknown.

    Without an output weight, it is the mass times standard gravity: in N for a mass in kg, g or t,
    else in lbf.
    """
    if "weight" in trimmed.model.outputs:
        return Quantity(trimmed["weight"], trimmed.unit("weight"))
    mass = configuration_of(trimmed).get("mass")
    per_kg = None if mass is None else conversion_factor(mass.unit, "kg")
    if mass is None or per_kg is None:
        return None
    newtons = mass.value * per_kg * STANDARD_GRAVITY
    if mass.unit in ("kg", "g", "t"):
        return Quantity(newtons, "N")
    return Quantity(newtons * (conversion_factor("N", "lbf") or math.nan), "lbf")


def graded(rows: Sequence[Row], airplane: Airplane) -> list[Row]:
    """Return rows with a level added to each quality of a mode that the standard grades.

    rows: handling qualities
    airplane: class and category
    """
    qualities = {row.name: float(row) for row in rows}
    rules = {rule.quality: rule for mode in _MODES for rule in _rules(mode, qualities, airplane)}
    return [_with_level(row, rules) for row in rows]


def _with_level(row: Row, rules: Mapping[str, _Rule]) -> Row:
    """Return a row with its level if there is a rule for it. A stable spiral never doubles."""
    if row.name == "spiral time to half" and "spiral time to double" in rules:
        paragraph = rules["spiral time to double"].paragraph
        return replace(row, level=1, note=f"level 1: stable ({paragraph})", tone=TONES[1])
    if row.name not in rules:
        return row
    rule = rules[row.name]
    level = level_of(float(row), rule.limits)
    note = _note(level, rule, float(row) < 0.0)
    return replace(row, level=level, note=note, tone=TONES[level])


def level_of(value: float, limits: Limits) -> int:
    """Return the best level whose limits contain a value, or `NO_LEVEL`.

    A quality is negative because its mode is unstable: it has a level only if the standard states a
    least value below 0.
    """
    for level, span in enumerate(limits, start=1):
        if span.least <= value <= span.most and (value >= 0.0 or math.isfinite(span.least)):
            return level
    return NO_LEVEL


class _Rule(NamedTuple):
    """Rule for a quality: its name, the paragraph of the standard, and the limits."""

    quality: str
    paragraph: str
    limits: Limits


def _least(*values: float) -> Limits:
    """Return the limits of the levels 1, 2 and 3 with these smallest values."""
    return [Span(least=value) for value in values]


def _most(*values: float) -> Limits:
    """Return the limits of the levels 1, 2 and 3 with these largest values."""
    return [Span(most=value) for value in values]


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
            faster_classes = {"A": ("I", "IV"), "B": (), "C": _AGILE}[airplane.category]
            is_faster = airplane.class_ in faster_classes
            limits = _most(1.0, 1.4, 10.0) if is_faster else _most(1.4, 3.0, 10.0)
            yield _Rule("roll time constant", "3.3.1.2", limits)
            yield _of_roll_spiral(mode, airplane)
        case "spiral":
            first = 20.0 if airplane.category == "B" else 12.0
            yield _Rule("spiral time to double", "3.3.1.3", _least(first, 8.0, 4.0))
            yield _of_roll_spiral(mode, airplane)


def _of_short_period(airplane: Airplane) -> Iterator[_Rule]:
    """Yield the rules for damping, CAP = ω²/(n/α), frequency and n/α of the short period."""
    damping = [Span(0.35, 1.3), Span(0.25, 2.0), Span(0.15)]
    if airplane.category == "B":
        damping = [Span(0.30, 2.0), Span(0.20, 2.0), Span(0.15)]
    yield _Rule("short period damping", "3.2.2.1.2", damping)
    paragraph = "3.2.2.1.1"
    least_1 = {"A": 0.28, "B": 0.085, "C": 0.16}[airplane.category]
    least_2 = {"A": 0.16, "B": 0.038, "C": 0.096}[airplane.category]
    cap = [Span(least_1, 3.6), Span(least_2, 10.0), Span(least_2)]
    yield _Rule("CAP", paragraph, cap)
    if airplane.category == "A":
        yield _Rule("short period frequency", paragraph, _least(1.0, 0.6, 0.0))
    if airplane.category == "C":
        frequency = _least(0.87, 0.6, 0.0) if airplane.is_agile else _least(0.7, 0.4, 0.0)
        yield _Rule("short period frequency", paragraph, frequency)
        load = _least(2.7, 1.8, -math.inf) if airplane.is_agile else _least(2.0, 1.0, -math.inf)
        yield _Rule("n/alpha", paragraph, load)


def _of_phugoid(qualities: Mapping[str, float]) -> Iterator[_Rule]:
    """Yield the rule for the damping of the phugoid; level 3 is a time to double of 55 s."""
    frequency = qualities.get("phugoid frequency", math.inf)
    limits = _least(0.04, 0.0, -math.log(2.0) / (55.0 * frequency))
    yield _Rule("phugoid damping", "3.2.1.2", limits)


def _of_roll_spiral(mode: str, airplane: Airplane) -> _Rule:
    """Return the rule for roll and spiral coupled in an oscillation, which category A excludes."""
    limits = _least(0.5, 0.3, 0.15)
    if airplane.category == "A":
        limits = _least(math.inf, math.inf, math.inf)
    return _Rule(f"{mode} {_COUPLED}", "3.3.1.4", limits)


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
    yield _Rule("dutch roll damping", paragraph, _least(level_1.damping, 0.02, 0.0))
    yield _Rule("dutch roll damping times frequency", paragraph, _least(*products))
    yield _Rule("dutch roll frequency", paragraph, _least(level_1.frequency, 0.4, 0.4))


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


def _note(level: int, rule: _Rule, is_negative: bool) -> str:
    """Return the note of a graded figure: "level 2: at least 0.04, 0, -0.0166 (3.2.1.2)"."""
    words = f"level {level}"
    if level == NO_LEVEL:
        words = "no level, unstable" if is_negative else "below level 3"
    return f"{words}: {_limits_text(rule.limits)} ({rule.paragraph})"


def level_lines(trimmed: Trimmed, airplane: Airplane, rows: Sequence[Row]) -> list[str]:
    """Return sentences on the class and the category, the modes for which the standard has no rule,
    and the modes with a rule that the aircraft does not have; or why there are no modes.

    rows: rows of `mode_rows`
    """
    if trimmed.fault:
        return [f"no modes: {trimmed.fault}"]
    if "speed" not in trimmed.roles:
        return []
    chosen, why = chosen_airplane(trimmed, airplane)
    graded_names = [row.name for row in rows if row.level is not None]
    if not graded_names:
        return [f"{STANDARD}: not in this model: no mode that it has a rule for"]
    reason = f" (by hfa's convention, {why}; --class changes it)" if why else ""
    category = f"category {chosen.category} (--category changes it)"
    sentences = [f"{STANDARD}: class {chosen.class_}{reason}, {category}"]
    families = dict.fromkeys(mode.name.partition(" (")[0] for mode in trimmed.modes)
    without_rule = [
        f"{family} (real eigenvalues)" if family in _MODES else family
        for family in families
        if not any(name.startswith(f"{family} ") for name in graded_names)
    ]
    if without_rule:
        sentences.append(f"{STANDARD} has no rule for: {', '.join(without_rule)}")
    is_coupled = any(f"{mode} {_COUPLED}" in graded_names for mode in ("roll", "spiral"))
    present = {*families, "roll", "spiral"} if is_coupled else {*families}
    if absent := [mode for mode in _MODES if mode not in present]:
        sentences.append(f"{', '.join(absent)}: not in this model")
    return sentences


def _limits_text(limits: Limits) -> str:
    """Return limits as text: "at least 0.08, 0.02, 0", "at most 1.4, 3, 10" or "0.3-2, 0.15-"."""
    if all(math.isinf(span.most) for span in limits):
        return "at least " + ", ".join(_number_text(span.least) for span in limits)
    if all(math.isinf(span.least) for span in limits):
        return "at most " + ", ".join(_number_text(span.most) for span in limits)
    ranges = []
    for span in limits:
        most = "" if math.isinf(span.most) else f"{span.most:.3g}"
        ranges.append(f"{span.least:.3g}-{most}")
    return ", ".join(ranges)


def _number_text(limit: float) -> str:
    """Return a limit as text; no limit is "any", and a level that does not exist "none"."""
    if math.isinf(limit):
        return "any" if limit < 0.0 else "none"
    return f"{limit:.3g}"


#: Names that models give to oscillating modes.
_OSCILLATING = ("short period", "phugoid", "dutch roll")


def mode_rows(trimmed: Trimmed, airplane: Airplane) -> list[Row]:
    """Return the eigenvalues of the modes, each with its handling qualities and their levels."""
    if trimmed.fault:
        return []
    qualities = [*handling_qualities(trimmed)]
    if "speed" in trimmed.roles:
        qualities = graded(qualities, chosen_airplane(trimmed, airplane).airplane)
    rows: list[Row] = []
    time = trimmed.model.time_unit
    for mode in trimmed.modes:
        times = _times_text(mode, time)
        rows.append(Row(f"{mode.name} eigenvalue", mode.eigenvalue, f"1/{time}", times))
        family = mode.name.partition(" (")[0]
        of_mode = [row for row in qualities if _belongs(row.name, family)]
        qualities = [row for row in qualities if row not in of_mode]
        if mode.eigenvalue.imag and not of_mode:
            of_mode = [
                Row(f"{mode.name} frequency", mode.frequency, f"rad/{time}", in_degrees=False),
                Row(f"{mode.name} damping", mode.damping),
            ]
        rows += of_mode
    return [*rows, *qualities]


def _belongs(quality: str, family: str) -> bool:
    """Return whether a handling quality belongs to the modes of a family, such as "phugoid"."""
    if family == "short period" and quality in ("CAP", "n/alpha"):
        return True
    return quality.startswith(f"{family} ")


def _times_text(mode: Mode, unit: str) -> str:
    """Return period and time to half or double of a mode as text.

    unit: unit of time
    """
    words = []
    if mode.eigenvalue.imag:
        words.append(f"period {mode.period:.4g} {unit}")
    if mode.stable:
        words.append(f"time to half {mode.time_to_half:.4g} {unit}")
    elif mode.eigenvalue.real:
        words.append(f"time to double {mode.time_to_double:.4g} {unit}")
    return ", ".join(words)


def handling_qualities(trimmed: Trimmed) -> Iterator[Row]:
    """Yield the handling qualities at a trim, as far as the model declares modes and outputs; none
    with a `fault`.

    - `short period`, `phugoid` and `dutch roll`: natural frequency and damping ratio, for two real
      eigenvalues from their product and sum
    - `dutch roll`: also the product of frequency and damping ratio, and |φ/β| of the mode's shape
    - `roll`: time constant -1/λ
    - `spiral`: time to double or half, ln 2/|λ|
    - `roll` or `spiral` coupled in an oscillation: the product of frequency and damping ratio
    - with an output `load_factor` and a state `alpha` in the short period: n/alpha and the control
      anticipation parameter CAP = ω²/(n/alpha) (MIL-F-8785C, 3.2.2.1)

    n/alpha is the steady change of the load factor divided by the steady change of alpha, after a
    step of the input that pitches the aircraft most. Lags follow, and all other states except alpha
    and pitch rate are held.
    """
    for name in _OSCILLATING:
        oscillation = _oscillation(trimmed, name)
        if oscillation is None:
            continue
        yield Row(f"{name} frequency", oscillation.frequency, "rad/s", in_degrees=False)
        yield Row(f"{name} damping", oscillation.damping)
        if name == "dutch roll":
            product = oscillation.damping * oscillation.frequency
            yield Row("dutch roll damping times frequency", product, "rad/s", in_degrees=False)
            yield from _bank_per_sideslip(trimmed)
        if name == "short period":
            yield from _anticipation(trimmed, oscillation.frequency)
    roll = _real_eigenvalue(trimmed, "roll")
    if roll:
        yield Row("roll time constant", -1 / roll, "s")
    spiral = _real_eigenvalue(trimmed, "spiral")
    if spiral:
        change = "double" if spiral > 0 else "half"
        yield Row(f"spiral time to {change}", math.log(2) / abs(spiral), "s")
    for name in ("roll", "spiral"):
        for value in _eigenvalues(trimmed, name):
            if value.imag:
                yield Row(f"{name} damping times frequency", -value.real, "rad/s", in_degrees=False)


def _eigenvalues(trimmed: Trimmed, family: str) -> list[complex]:
    """Return the eigenvalues, 1/s, of all modes with a given name, one for each conjugate pair."""
    if family not in trimmed.model.modes:
        return []
    modes = [mode for mode in trimmed.modes if mode.name.partition(" (")[0] == family]
    return [mode.eigenvalue * trimmed.per_second for mode in modes]


def _real_eigenvalue(trimmed: Trimmed, family: str) -> float | None:
    """Return the eigenvalue, 1/s, of the only mode with a declared name if it is real, or None."""
    values = _eigenvalues(trimmed, family)
    return values[0].real if len(values) == 1 and not values[0].imag else None


class _Oscillation(NamedTuple):
    """Natural frequency, rad/s, and damping ratio of a mode."""

    frequency: float
    damping: float


def _oscillation(trimmed: Trimmed, family: str) -> _Oscillation | None:
    """Return the natural frequency and damping ratio of the mode with a declared name, or None
    unless it consists of one conjugate pair or of two real eigenvalues of the same sign.
    """
    values = _eigenvalues(trimmed, family)
    if len(values) == 1 and values[0].imag:
        values = [values[0], values[0].conjugate()]
    if len(values) != 2:
        return None
    total = values[0] + values[1]
    product = (values[0] * values[1]).real
    if product <= 0 or total.imag:
        return None
    frequency = math.sqrt(product)
    return _Oscillation(frequency, -total.real / (2 * frequency))


def _bank_per_sideslip(trimmed: Trimmed) -> Iterator[Row]:
    """Yield |φ/β| of the eigenvector of the Dutch roll, if bank and sideslip are linear states."""
    states = trimmed.model.linear
    names = [trimmed.roles.get("phi", ""), trimmed.roles.get("beta", "")]
    oscillating = [value for value in _eigenvalues(trimmed, "dutch roll") if value.imag]
    if not {*names} <= {*states} or not oscillating:
        return
    values, vectors = np.linalg.eig(trimmed.A * trimmed.per_second)
    nearest = int(np.argmin(np.abs(values - oscillating[0])))
    shape = np.abs(vectors[:, nearest])
    bank, sideslip = (shape[states.index(name)] for name in names)
    if sideslip:
        yield Row("dutch roll phi/beta", float(bank / sideslip))


def _anticipation(trimmed: Trimmed, frequency: float) -> Iterator[Row]:
    """Yield n/alpha, unless it is unknown or 0, and the parameter CAP if it is positive."""
    pull_up = trimmed.pull_up
    if pull_up is None or not pull_up.alpha or not pull_up.load_factor:
        return
    load_per_alpha = pull_up.load_factor / pull_up.alpha
    if math.isnan(load_per_alpha):
        return
    yield Row("n/alpha", load_per_alpha, "1/rad")
    if frequency**2 / load_per_alpha > 0:
        yield Row("CAP", frequency**2 / load_per_alpha, "1/s^2")
