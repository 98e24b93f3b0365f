"""How Section 5 is read: one TOML file, checked against the form of the one that comes with the project."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from controller.flight.signals import Harmonic, Signal
from controller.flight.times import check_whole
from hfa_model.support.errors import BadInputError

SECTIONS = ("5.1", "5.2", "5.3", "5.4")
_BASES = ("paper", "quadratic", "quadratic+linear", "quadratic+quartic")
_CHOICES = {
    "critic.normalisation": ("root", "squared"),
    "critic.basis": _BASES,
    "published_helped.basis": _BASES,
    "published_as_printed.coordinates": ("raw", "scaled"),
    "published_helped.coordinates": ("raw", "scaled"),
    "published_as_printed.drift": ("with reference", "error"),
    "published_helped.drift": ("with reference", "error"),
    "irl.form": ("lqr", "game"),
}
_SIGNALS = ("reference", "disturbance", "noise")
#: Signals may have any number of frequencies; every other list has the length of the default's.
_ANY_LENGTH = {f"{signal}.{name}" for signal in _SIGNALS for name in ("frequencies", "sine", "cosine")}
#: Numbers that may be 0 or negative; all others must be positive.
_ANY_SIGN = {"initial_state.value", "uncertainty.factors", *_ANY_LENGTH}
_ANY_SIGN |= {f"{signal}.{name}" for signal in _SIGNALS for name in ("constant", "slope")}
_NOT_NEGATIVE = {
    "published_helped.alpha1",
    "published_helped.alpha2",
    "irl.disturbance",
    "criteria.late",
    "critic.seed",
}
#: A learning time has at least this many ticks, so that its last tenth has one.
_LEAST_TICKS = 10
#: Times are compared with this slack, s: a quotient of decimals is not exact.
_SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class Reading:
    """The tables of a reading by name; `reading["flight"]["step"]` and the like are checked and of the right type."""

    tables: Mapping[str, Mapping[str, Any]]

    def __getitem__(self, name: str) -> Mapping[str, Any]:
        return self.tables[name]

    def signal(self, name: str) -> Signal:
        """x_d ("reference"), d ("disturbance") or n ("noise"), (6,)."""
        table = self[name]
        rows = zip(table["frequencies"], table["sine"], table["cosine"], strict=True)
        harmonics = tuple(Harmonic(float(f), np.array(s, dtype=float), np.array(c, dtype=float)) for f, s, c in rows)
        return Signal(np.array(table["constant"], dtype=float), np.array(table["slope"], dtype=float), harmonics)

    @property
    def initial(self) -> np.ndarray:
        """x(0), (6,)."""
        return np.array(self["initial_state"]["value"], dtype=float)

    @property
    def steps_per_tick(self) -> int:
        """Steps of the integration in a tick."""
        return round(self["flight"]["tick"] / self["flight"]["step"])

    def predefined_time(self, section: str) -> float:
        """T_w of an experiment, s."""
        return float(self["learning"]["predefined_time"][SECTIONS.index(section)])

    def frozen(self, section: str) -> bool:
        """Whether an experiment stops learning at T_w."""
        return bool(self["learning"]["frozen_at_predefined_time"][SECTIONS.index(section)])

    @property
    def settings(self) -> dict[str, dict[str, Any]]:
        """Everything but the reasons: what decides the numbers."""
        return {
            name: {key: value for key, value in table.items() if key != "why"} for name, table in self.tables.items()
        }


@cache
def default_reading() -> Reading:
    """The reading that comes with the project."""
    text = files("verification.experiments").joinpath("section5.toml").read_text(encoding="utf-8")
    return _checked(tomllib.loads(text), "section5.toml")


def load_reading(path: str | Path) -> Reading:
    """A reading of one's own. BadInputError, one line, for anything missing, unknown, not finite or impossible."""
    try:
        with Path(path).open("rb") as stream:
            tables = tomllib.load(stream)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror}); name a reading, a TOML file") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInputError(f"{path}: is not TOML ({error})") from error
    return _checked(tables, str(path), default_reading().tables)


def _checked(tables: dict[str, Any], source: str, form: Mapping[str, Any] | None = None) -> Reading:
    try:
        _compare(tables, tables if form is None else form, "")
        reading = Reading(tables)
        _possible(reading)
    except BadInputError as error:
        raise BadInputError(f"{source}: {error}") from error
    return reading


def _compare(given: Any, form: Any, where: str) -> None:
    """The same keys, kinds and lengths as the form, and numbers that are finite and of the right sign."""
    if isinstance(form, Mapping):
        if not isinstance(given, Mapping):
            raise BadInputError(f"{where or 'it'} is {given!r}; it must be a table")
        prefix = f"{where}." if where else ""
        for name in form:
            if name not in given:
                raise BadInputError(f"{prefix}{name} is missing; copy it from the reading that comes with the project")
        for name, value in given.items():
            if name not in form:
                raise BadInputError(f"{prefix}{name} is unknown; there are {', '.join(form)}")
            _compare(value, form[name], prefix + name)
    elif isinstance(form, list):
        free = where in _ANY_LENGTH
        if not isinstance(given, list) or (len(given) != len(form) and not free) or not given:
            wanted = "a list that is not empty" if free else f"a list of {len(form)}"
            raise BadInputError(f"{where} is {given!r}; it must be {wanted}")
        for index, value in enumerate(given):
            _compare(value, form[0 if free else index], where)
    else:
        _compare_values(given, form, where)


def _compare_values(given: Any, form: Any, where: str) -> None:
    if isinstance(form, (bool, str)):
        kind = "true or false" if isinstance(form, bool) else "a text"
        if type(given) is not type(form):
            raise BadInputError(f"{where} is {given!r}; it must be {kind}")
        if where in _CHOICES and given not in _CHOICES[where]:
            raise BadInputError(f"{where} is {given!r}; choose from {', '.join(_CHOICES[where])}")
        return
    if isinstance(given, bool) or not isinstance(given, (int, float)) or not math.isfinite(given):
        raise BadInputError(f"{where} holds {given!r}; it must be a finite number")
    if isinstance(form, int) and not isinstance(given, int):
        raise BadInputError(f"{where} is {given!r}; it must be a whole number")
    if where in _NOT_NEGATIVE and given < 0:
        raise BadInputError(f"{where} holds {given!r}; it must not be negative")
    if where not in _ANY_SIGN | _NOT_NEGATIVE and not given > 0:
        raise BadInputError(f"{where} holds {given!r}; it must be positive")


def _possible(reading: Reading) -> None:
    """What the numbers must be to each other."""
    check_whole(reading["flight"], "flight.")
    for name in _SIGNALS:
        counts = {len(reading[name][part]) for part in ("frequencies", "sine", "cosine")}
        if len(counts) > 1:
            raise BadInputError(
                f"{name} has frequencies, sine and cosine of different lengths; give one row a frequency"
            )
        if not all(frequency > 0 for frequency in reading[name]["frequencies"]):
            raise BadInputError(f"{name}.frequencies holds a number that is not positive, rad/s")
    _long_enough(reading)


def _long_enough(reading: Reading) -> None:
    """Every window that something is measured in holds samples: the learning time and what follows, and late."""
    flight, criteria = reading["flight"], reading["criteria"]
    tick, duration = flight["tick"], flight["duration"]
    for section in SECTIONS:
        T_w = reading.predefined_time(section)
        if not _LEAST_TICKS * tick - _SLACK <= T_w <= duration - tick + _SLACK:
            raise BadInputError(
                f"learning.predefined_time of {section} is {T_w:g} s; it must lie between {_LEAST_TICKS} ticks "
                f"({_LEAST_TICKS * tick:g} s) and the duration of the flight less one tick ({duration - tick:g} s)"
            )
    begin, end = criteria["late"]
    if not (begin + tick <= end + _SLACK and end <= duration + _SLACK):
        raise BadInputError(
            f"criteria.late is {begin:g} to {end:g} s; it must lie within the flight ({duration:g} s) and be at least "
            f"a tick ({tick:g} s) long"
        )
    if not criteria["short_adjustment"] <= duration - tick + _SLACK:
        raise BadInputError(
            f"criteria.short_adjustment is {criteria['short_adjustment']:g} s; it must end a tick or more before the "
            f"flight does ({duration:g} s)"
        )
