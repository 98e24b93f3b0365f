"""Where an output comes from: which program, equations, aircraft and flight condition, by which
command, and when."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from hfa_support.errors import BadInputError, shown
from hfa_support.reporting.results import Result
from hfa_support.version import VERSION

#: Hexadecimal digits of a parameter hash.
_DIGITS = 12
#: Differences of a parameter set that a text shows; files have all.
_MOST_SHOWN = 3


@dataclass(frozen=True)
class Change(Result):
    """A parameter that is not the identified one.

    value: as it is
    identified: as it was identified
    """

    value: float
    identified: float
    unit: str = ""


@dataclass(frozen=True)
class Provenance(Result):
    """Where an output comes from; every output carries it.

    command: as typed
    dynamics: name of the equations, "" for a plant of the user's own
    parameters: name or file of the set
    parameter_hash: of the values alone, so that two files with the same numbers have the same
    changed: parameter -> its value and the identified one, where they differ
    condition: what a trim imposes, leaves free and limits; angles in radians
    flight: how the condition differs from the paper's level flight, in words; not among the data
    model: file of a plant
    version: of the program
    date: UTC; from SOURCE_DATE_EPOCH where that is set, so that outputs can be made again byte for
        byte
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

    def _changes(self) -> list[str]:
        """A phrase for each parameter that differs, the relatively largest difference first; of
        more than `_MOST_SHOWN` their number and the first."""
        sizes = {
            name: abs(change.value - change.identified) / (abs(change.identified) or 1.0)
            for name, change in self.changed.items()
        }
        phrases = []
        if len(sizes) > _MOST_SHOWN:
            phrases.append(f"{len(sizes)} parameters differ, most")
        for name in sorted(sizes, key=lambda name: -sizes[name])[:_MOST_SHOWN]:
            change = self.changed[name]
            unit = f" {getattr(FIELDS, name).unit}" if name in FIELDS._fields else ""
            phrases.append(f"{name} {change.value:.6g}{unit} (identified: {change.identified:.6g})")
        return phrases

    def text(self) -> str:
        """For people: one line, and further ones for parameters that are not the identified ones
        and a flight that is not the paper's."""
        about = [f"hfa {self.version}", self.date[:10]]
        if self.model:
            first_line.append(f"plant {self.model}")
        elif self.parameters:
            first_line.append(f"{self.dynamics} dynamics")
            first_line.append(f"parameters {self.parameters} ({self.parameter_hash})")
        lines = [", ".join(first_line)]
        if self.changed:
            lines.append("not the identified aircraft: " + "\n  ".join(self._largest_changes()))
        if self.flight:
            lines.append(f"not the paper's level flight: {self.flight}")
        return "\n".join(lines)


def parameter_hash(values: Any) -> str:
    """The first digits of SHA-256 over the 17-digit values of a named tuple, in their order."""
    text = "\n".join(f"{name}={float(value):.17g}" for name, value in values._asdict().items())
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def changed_parameters(parameters: ParameterSet) -> dict[str, Change]:
    """Parameter -> its change, for those whose values are not the identified ones."""
    identified = default_parameters().values
    changes = {}
    for name, value in parameters.values._asdict().items():
        if value != getattr(identified, name):
            changes[name] = Change(value, getattr(identified, name))
    return changes


def now() -> str:
    """Date and time, UTC, as "2026-01-31T12:00:00Z"; those of SOURCE_DATE_EPOCH where that is set.

    BadInputError when that number of seconds lies beyond the year 9999.
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    try:
        moment = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdecimal() else datetime.now(UTC)
    except (ValueError, OverflowError, OSError) as error:
        raise BadInputError(
            f"SOURCE_DATE_EPOCH is {shown(epoch)}; give seconds before the year 10000"
        ) from error
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")
