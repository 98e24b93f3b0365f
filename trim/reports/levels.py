"""Handling qualities of the modes, and their levels by MIL-F-8785C."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from hfa_support.reporting.rows import Row
from hfa_support.units import STANDARD_GRAVITY, conversion_factor
from trim.linear.modes import Mode
from trim.reports.trimmed import Trimmed

#: Classes: I small and light; II medium, at a carrier or on land; III large; IV maneuverable.
CLASSES = ("I", "II-C", "II-L", "III", "IV")
#: Categories: A rapid maneuvers; B gradual maneuvers, such as cruise; C terminal, such as landing.
CATEGORIES = ("A", "B", "C")
STANDARD = "MIL-F-8785C"
#: Modes with a rule, and the quality of roll and spiral coupled in one oscillation.
_MODES_WITH_RULE = ("short period", "phugoid", "dutch roll", "roll", "spiral")
_DAMPING_TIMES_FREQUENCY = "damping times frequency"
#: Number of a quality that is worse than level 3.
NO_LEVEL = 4
#: Classes with the stricter limits; an unknown class is graded as I.
_STRICTER_CLASSES = ("", "I", "II-C", "IV")
#: Tone of each level.
TONES = {1: "good", 2: "near", 3: "far", NO_LEVEL: "bad"}
#: Largest weights of two classes, lbf (a pound is so many N), and least load factor of class IV.
_LARGEST_WEIGHTS = {"I": 12_500.0, "II-L": 60_000.0}
_POUND = conversion_factor("lbf", "N") or math.nan
_LEAST_LOAD_IV = 6.0
#: Quantity -> its factor to a weight.
_WEIGHTS = {"weight": 1.0, "mass": STANDARD_GRAVITY}
_UNKNOWN_WEIGHT = "weight unknown"


class Airplane(NamedTuple):
    """What decides the limits: class of the airplane and category of the flight phase.

    The class "" is chosen by weight and load factor where these are known (`chosen_airplane`), a
    convention of this tool: the standard describes the classes in words. It is class I elsewhere.
    """

    class_: str = ""
    category: str = "B"


#: Class by weight, category B.
DEFAULT_AIRPLANE = Airplane()


class Span(NamedTuple):
    """Smallest and largest value of a level."""

    least: float = -math.inf
    most: float = math.inf


#: Values of the levels 1, 2 and 3.
Limits: TypeAlias = Sequence[Span]


class Chosen(NamedTuple):
    """Class and category of an airplane, and the reason for a class that the user did not state.

    why: the reason; of a stated one that contradicts it; or ""
    """

    airplane: Airplane
    why: str


def chosen_airplane(trimmed: Trimmed, airplane: Airplane) -> Chosen:
    """Return class and category as the user states them, with the usual class if he does not.

    - IV: the model declares a largest load factor of at least 6
    - I, II-L, III: weight up to 12,500 lbf, up to 60,000 lbf, above
    - I: the model has neither a weight nor a mass, or one in a unit of another quantity

    These numbers are a convention of this tool. MIL-F-8785C, 1.3, describes the classes in words:
    I small and light, II of medium weight, III large and heavy, IV of high maneuverability.
    """
    if airplane.class_:
        usual, why = chosen_airplane(trimmed, airplane._replace(class_=""))
        families = {chosen.class_.partition("-")[0] for chosen in (airplane, usual)}
        if why == _UNKNOWN_WEIGHT or "IV" in families or len(families) == 1:
            return Chosen(airplane, "")
        return Chosen(airplane, f"stated; by hfa's convention, {why} is {usual.class_}")
    outputs = trimmed.model.outputs
    largest_load = outputs["load_factor"].max if "load_factor" in outputs else math.inf
    if _LEAST_LOAD_IV <= largest_load < math.inf:
        return Chosen(airplane._replace(class_="IV"), f"load factor up to {largest_load:.3g}")
    quantities = {} if trimmed.fault else trimmed.quantities
    weights = [quantities[name].value * g for name, g in _WEIGHTS.items() if name in quantities]
    if not weights:
        return Chosen(airplane._replace(class_="I"), _UNKNOWN_WEIGHT)
    for class_, limit in _LARGEST_WEIGHTS.items():
        if weights[0] <= limit * _POUND:
            return Chosen(airplane._replace(class_=class_), f"weight up to {limit:,.0f} lbf")
    return Chosen(airplane._replace(class_="III"), f"weight above {limit:,.0f} lbf")


def graded(rows: Sequence[Row], airplane: Airplane) -> list[Row]:
    """Return rows with a level added to each quality of a mode that the standard grades.

    rows: handling qualities
    airplane: class and category
    """
    rules = _rules(airplane, {row.name: row.value for row in rows})
    graded_rows = []
    for row in rows:
        if row.name == "spiral time to half":  # a stable spiral never doubles
            paragraph, _ = rules["spiral time to double"]
            level, note = 1, f"level 1: stable ({paragraph})"
        elif row.name in rules:
            paragraph, limits = rules[row.name]
            level = level_of(row.value, limits)
            words = f"level {level}"
            if level == NO_LEVEL:
                words = "no level, unstable" if row.value < 0.0 else "below level 3"
            note = f"{words}: {_limits_text(limits)} ({paragraph})"
        else:
            graded_rows.append(row)
            continue
        graded_rows.append(replace(row, level=level, note=note, tone=TONES[level]))
    return graded_rows


def level_of(value: float, limits: Limits) -> int:
    """Return the best level whose limits contain a value, or `NO_LEVEL`.

    A quality below 0 is that of an unstable mode. An upper limit alone, as that of a time constant,
    does not contain it: it has a level only where the standard states a least value below 0.
    """
    for level, span in enumerate(limits, start=1):
        if span.least <= value <= span.most and (value >= 0.0 or math.isfinite(span.least)):
            return level
    return NO_LEVEL


#: Paragraph of the standard on a quality, and its limits.
_Rule: TypeAlias = tuple[str, Limits]


def _rules(airplane: Airplane, qualities: Mapping[str, float]) -> dict[str, _Rule]:
    """Return quality -> its rule for a class and a category (MIL-F-8785C).

    qualities: name -> value, on which the limits of some qualities depend
    """
    # A least value of -inf lets any value have the level, and one of inf none.
    class_, category = airplane
    is_b, is_stricter_class = category == "B", class_ in _STRICTER_CLASSES
    is_strict_laterally = class_ in {"A": ("I", "IV"), "B": (), "C": _STRICTER_CLASSES}[category]
    cap_1, cap_2 = {"A": (0.28, 0.16), "B": (0.085, 0.038), "C": (0.16, 0.096)}[category]
    damping = [Span(0.3, 2.0) if is_b else Span(0.35, 1.3), Span(0.2 if is_b else 0.25, 2.0)]
    # Level 3 of the phugoid is a time to double of 55 s, ln 2/(-ζω).
    phugoid_3 = -math.log(2.0) / (55.0 * qualities.get("phugoid frequency", math.inf))
    # Category A permits no coupled oscillation of roll and spiral.
    coupled = ("3.3.1.4", _least(*[math.inf] * 3 if category == "A" else (0.5, 0.3, 0.15)))
    rules: dict[str, _Rule] = {
        "short period damping": ("3.2.2.1.2", [*damping, Span(0.15)]),
        "CAP": ("3.2.2.1.1", [Span(cap_1, 3.6), Span(cap_2, 10.0), Span(cap_2)]),
        "phugoid damping": ("3.2.1.2", _least(0.04, 0.0, phugoid_3)),
        "dutch roll damping": ("3.3.1.1", _least(0.19 if category == "A" else 0.08, 0.02, 0)),
        "dutch roll damping times frequency": ("3.3.1.1", _products(airplane, qualities)),
        "dutch roll frequency": ("3.3.1.1", _least(1.0 if is_strict_laterally else 0.4, 0.4, 0.4)),
        "roll time constant": (
            "3.3.1.2",
            [
                Span(most=tau)
                for tau in ((1.0, 1.4, 10.0) if is_strict_laterally else (1.4, 3.0, 10.0))
            ],
        ),
        "spiral time to double": ("3.3.1.3", _least(20.0 if is_b else 12.0, 8.0, 4.0)),
        f"roll {_DAMPING_TIMES_FREQUENCY}": coupled,
        f"spiral {_DAMPING_TIMES_FREQUENCY}": coupled,
    }
    frequencies = {
        "A": (1.0, 0.6, 0.0),
        "C": (0.87, 0.6, 0.0) if is_stricter_class else (0.7, 0.4, 0.0),
    }
    if category in frequencies:
        rules["short period frequency"] = ("3.2.2.1.1", _least(*frequencies[category]))
    if category == "C":
        loads = (2.7, 1.8) if is_stricter_class else (2.0, 1.0)
        rules["n/alpha"] = ("3.2.2.1.1", _least(*loads, -math.inf))
    return rules


def _least(*values: float) -> Limits:
    """Return the limits of the levels 1, 2 and 3 with these smallest values."""
    return [Span(least=value) for value in values]


def _products(airplane: Airplane, qualities: Mapping[str, float]) -> Limits:
    """Return the limits of ζω of the Dutch roll, rad/s, which increase with ω² |φ/β| above 20
    (rad/s)².
    """
    # For class III, a damping ratio of 0.7 satisfies each of them.
    class_, category = airplane
    least_1 = {"A": 0.35, "B": 0.15, "C": 0.15 if class_ in _STRICTER_CLASSES else 0.1}[category]
    omega = qualities.get("dutch roll frequency", 0.0)
    excess = max(0.0, omega**2 * qualities.get("dutch roll phi/beta", 0.0) - 20.0)
    least_3 = 0.005 * excess if excess else -math.inf  # else the standard states no level 3
    products = (least_1 + 0.014 * excess, 0.05 + 0.009 * excess, least_3)
    return _least(
        *(min(product, 0.7 * omega) if class_ == "III" else product for product in products)
    )


def level_lines(trimmed: Trimmed, airplane: Airplane, rows: Sequence[Row]) -> list[str]:
    """Return sentences on the class and the category, and on the modes without a rule in the
    standard; or why there are no modes.

    rows: rows of `mode_rows`
    """
    if trimmed.fault:
        return [f"no modes: {trimmed.fault}"]
    if trimmed.airspeed is None:
        return []
    chosen, why = chosen_airplane(trimmed, airplane)
    graded_names = [row.name for row in rows if row.level is not None]
    if not graded_names:
        return [f"{STANDARD}: not in this model: no mode that it has a rule for"]
    reason = f" ({why})" if why else ""
    if why and not airplane.class_:
        reason = f" (by hfa's convention, {why}; --class changes it)"
    sentences = [
        f"{STANDARD}: class {chosen.class_}{reason}, category {chosen.category} (--category "
        "changes it); limits are those of the levels 1, 2, 3"
    ]
    # A family is the name of a mode without an addition, such as that of "roll (fast)".
    families = dict.fromkeys(mode.name.partition(" (")[0] for mode in trimmed.modes)
    without_rule = [
        f"{family} (real eigenvalues)" if family in _MODES_WITH_RULE else family
        for family in families
        if not any(name.startswith(f"{family} ") for name in graded_names)
    ]
    if without_rule:
        sentences.append(f"{STANDARD} has no rule for: {', '.join(without_rule)}")
    return sentences


def _limits_text(limits: Limits) -> str:
    """Return limits as text: "at least 0.08, 0.02, 0", "at most 1.4, 3, 10" or "0.3-2, 0.15-"."""
    # No limit is "any", and a level that does not exist "none".
    words = {-math.inf: "any", math.inf: "none"}
    leasts, mosts = zip(*limits, strict=True)
    for prefix, ends, others in (("at least", leasts, mosts), ("at most", mosts, leasts)):
        if all(map(math.isinf, others)):
            return f"{prefix} " + ", ".join(words.get(end, f"{end:.3g}") for end in ends)
    ranges = (f"{least:.3g}-{most:.3g}".removesuffix("inf") for least, most in limits)
    return ", ".join(ranges)


#: Names that models give to oscillating modes.
_OSCILLATING = ("short period", "phugoid", "dutch roll")


def graded_modes(trimmed: Trimmed, airplane: Airplane) -> Iterator[tuple[Mode, list[Row]]]:
    """Yield each mode with the handling qualities of its family and their levels. If a family has
    several modes, the qualities are yielded with the first one.
    """
    qualities = [] if trimmed.fault else [*handling_qualities(trimmed)]
    if trimmed.airspeed is not None:
        qualities = graded(qualities, chosen_airplane(trimmed, airplane).airplane)
    for mode in trimmed.modes:
        family = mode.name.partition(" (")[0]
        # Two qualities of the short period have names of their own.
        others = ("CAP", "n/alpha") if family == "short period" else ()
        of_mode = [
            row for row in qualities if row.name in others or row.name.startswith(f"{family} ")
        ]
        qualities = [row for row in qualities if row not in of_mode]
        yield mode, of_mode


def mode_rows(trimmed: Trimmed, airplane: Airplane) -> list[Row]:
    """Return the eigenvalues of the modes with their period and time to half or double, each with
    its handling qualities and their levels.
    """
    rows: list[Row] = []
    time = trimmed.model.time_unit
    for mode, qualities in graded_modes(trimmed, airplane):
        times = [f"period {mode.period:.4g} {time}"] if mode.eigenvalue.imag else []
        if mode.stable:
            times.append(f"time to half {mode.time_to_half:.4g} {time}")
        elif mode.eigenvalue.real:
            times.append(f"time to double {mode.time_to_double:.4g} {time}")
        rows.append(Row(f"{mode.name} eigenvalue", mode.eigenvalue, f"1/{time}", ", ".join(times)))
        rows += qualities
        if mode.eigenvalue.imag and not qualities:  # the qualities begin with these figures
            unit = f"rad/{time}"
            rows.append(Row(f"{mode.name} frequency", mode.frequency, unit, in_degrees=False))
            rows.append(Row(f"{mode.name} damping", mode.damping))
    return rows


def handling_qualities(trimmed: Trimmed) -> Iterator[Row]:
    """Yield the handling qualities at a trim, as far as the model declares modes and outputs. A
    trim with a `fault` has none.

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
        frequency, damping = oscillation
        yield Row(f"{name} frequency", frequency, "rad/s", in_degrees=False)
        yield Row(f"{name} damping", damping)
        if name == "dutch roll":
            yield Row(
                f"{name} {_DAMPING_TIMES_FREQUENCY}", damping * frequency, "rad/s", in_degrees=False
            )
            yield from _bank_per_sideslip(trimmed)
        if name == "short period":
            yield from _anticipation(trimmed, frequency)

    values = {name: _eigenvalues(trimmed, name) for name in ("roll", "spiral")}
    real = {
        name: found[0].real
        for name, found in values.items()
        if len(found) == 1 and not found[0].imag
    }
    if real.get("roll"):
        yield Row("roll time constant", -1 / real["roll"], "s")
    if spiral := real.get("spiral"):
        change = "double" if spiral > 0 else "half"
        yield Row(f"spiral time to {change}", math.log(2) / abs(spiral), "s")

    # Roll and spiral coupled in an oscillation.
    for name, found in values.items():
        for value in found:
            if value.imag:
                yield Row(
                    f"{name} {_DAMPING_TIMES_FREQUENCY}", -value.real, "rad/s", in_degrees=False
                )


def _eigenvalues(trimmed: Trimmed, family: str) -> list[complex]:
    """Return the eigenvalues, 1/s, of all modes of a family, one for each conjugate pair. The list
    is empty for a family that the model does not declare.
    """
    if family not in trimmed.model.modes:
        return []
    modes = [mode for mode in trimmed.modes if mode.name.partition(" (")[0] == family]
    return [mode.eigenvalue * trimmed.per_second for mode in modes]


def _oscillation(trimmed: Trimmed, family: str) -> tuple[float, float] | None:
    """Return natural frequency ω, rad/s, and damping ratio ζ of a family with a conjugate pair, or
    with two real eigenvalues of the same sign, the roots of s² + 2ζω s + ω² = 0. The result is None
    for another family.
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
    return frequency, -total.real / (2 * frequency)


def _bank_per_sideslip(trimmed: Trimmed) -> Iterator[Row]:
    """Yield |φ/β| of the eigenvector of the Dutch roll, if bank and sideslip are linear states."""
    states = trimmed.model.linear
    names = [trimmed.roles.get("phi", ""), trimmed.roles.get("beta", "")]
    oscillating = [value for value in _eigenvalues(trimmed, "dutch roll") if value.imag]
    if not {*names} <= {*states} or not oscillating:
        return
    values, vectors = np.linalg.eig(trimmed.linear_A * trimmed.per_second)
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
