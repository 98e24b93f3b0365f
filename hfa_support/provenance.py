"""Provenance of an output: program, equations, aircraft, flight condition, command and date."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from hfa_support.errors import BadInputError, shown
from hfa_support.origin import code
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import with_unit
from hfa_support.version import VERSION

#: Hexadecimal digits of a parameter hash.
_HASH_DIGITS = 12
#: Largest number of changed parameters in the text. Files contain all.
_MOST_CHANGES_SHOWN = 3


@dataclass(frozen=True)
class Change(Result):
    """Parameter that differs from that of the identified HFA, or of the file of an aircraft.

    value: the current value.
    usual: the identified value, or that of the file.
    unit: unit of both values.
    """

    value: float
    usual: float
    unit: str = ""

    def words(self, origin: str) -> str:
        """Return the value with the usual one as text: "9 kg (as loaded: 13.5 kg)".

        origin: what the usual value is
        """
        usual = with_unit(self.usual, self.unit)
        return f"{with_unit(self.value, self.unit)} ({origin}: {usual})"


@dataclass(frozen=True)
class Provenance(Result):
    """The provenance stored in every output.

    command: command line as typed.
    dynamics: name of the equations of motion, or "" for the user's plant.
    parameters: name or file of the parameters.
    parameter_hash: of the HFA, a hash of the parameter values, equal for two files with equal
        numbers. Of another aircraft, a hash of the file of the parameters.
    changed: parameter -> its value and the identified value or that of the file, if these differ.
    condition: imposed, free and limited variables of a trim, with angles in radians.
    flight: changes of the trim condition from the paper's level flight, in words; files have
        `condition`.
    model: file of the plant.
    version: version of the program; in files its identity (`hfa --version`).
    date: date and time in UTC, taken from SOURCE_DATE_EPOCH if it is set.
    """

    schema = "hfa.provenance/1"

    command: str
    dynamics: str = ""
    parameters: str = ""
    parameter_hash: str = ""
    changed: Mapping[str, Change] = field(default_factory=dict)
    condition: Mapping[str, Any] = field(default_factory=dict)
    flight: str = field(default="", repr=False)
    model: str = ""
    version: str = VERSION
    date: str = field(default_factory=lambda: now())

    def _largest_changes(self) -> list[str]:
        """Return texts on the parameters with the largest relative changes, at most
        `_MOST_CHANGES_SHOWN`; if more differ, the first text is their number.
        """
        sizes = {
            name: abs(change.value - change.usual) / (abs(change.usual) or 1.0)
            for name, change in self.changed.items()
        }
        origin = "as loaded" if self.model else "identified"
        largest = sorted(sizes, key=sizes.__getitem__, reverse=True)[:_MOST_CHANGES_SHOWN]
        descriptions = [f"{name} {self.changed[name].words(origin)}" for name in largest]
        if len(sizes) > _MOST_CHANGES_SHOWN:
            descriptions.insert(0, f"{len(sizes)} parameters differ, most")
        return descriptions

    def text(self) -> str:
        """Return the provenance as text: one line with the version, the date and the plant.

        Further lines describe parameters that differ from the identified or loaded ones, and a
        flight that differs from the paper's level flight.
        """
        first_line = [f"hfa {self.version}", self.date[:10]]
        if self.model:  # a user's plant or aircraft
            first_line.append(f"plant {self.model}")
        elif self.parameters:
            first_line.append(f"{self.dynamics} dynamics")
        if self.parameters:
            first_line.append(f"parameters {self.parameters} ({self.parameter_hash})")
        lines = [", ".join(first_line)]
        if self.changed:
            what = "changed" if self.model else "not the identified aircraft"
            lines.append(f"{what}: " + "\n  ".join(self._largest_changes()))
        if self.flight:
            lines.append(f"not the paper's level flight: {self.flight}")
        return "\n".join(lines)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        entries = super()._entries()
        del entries["flight"]
        return entries | {"version": code()}


def parameter_hash(values: Any) -> str:
    """Return the first `_HASH_DIGITS` hexadecimal digits of a SHA-256 hash of names and values.

    values: named tuple of numbers, hashed in their order with 17 significant digits
    """
    text = "\n".join(f"{name}={float(value):.17g}" for name, value in values._asdict().items())
    return hashlib.sha256(text.encode()).hexdigest()[:_HASH_DIGITS]


def now() -> str:
    """Return the date and time in UTC as text, from SOURCE_DATE_EPOCH if it is set.

    Raises BadInputError if SOURCE_DATE_EPOCH is out of range.
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    try:
        moment = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdecimal() else datetime.now(UTC)
    except (ValueError, OverflowError, OSError) as error:
        raise BadInputError(
            f"SOURCE_DATE_EPOCH is {shown(epoch)}; give seconds since 1970, before the year 10000"
        ) from error
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")
