"""Where an output comes from: which program, equations, aircraft and flight condition, by which
command, and when."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from hfa_model.parameters import FIELDS, Parameters, ParameterSet, default_parameters
from hfa_support.errors import BadInputError, shown
from hfa_support.reporting.results import Result
from hfa_support.version import VERSION

#: Hexadecimal digits of a parameter hash.
_DIGITS = 12
#: Differences of a parameter set that people are told; files have all.
_MOST_TOLD = 3


@dataclass(frozen=True)
class Change(Result):
    """A parameter that is not the identified one.

    value: as it is.
    identified: as it was identified."""

    value: float
    identified: float


@dataclass(frozen=True)
class Provenance(Result):
    """One block that every output carries.

    command: as typed.
    dynamics: the equations, "" for a plant of the user's own.
    parameters: name or file of the set.
    parameter_hash: of the values alone, so that two files with the same numbers have the same.
    changed: parameter -> its value and the identified one, where they differ.
    condition: what a trim imposes, leaves free and limits; angles in radians.
    flight: the same in words, what it changes of the paper's level flight; not among the data.
    model: file of a plant.
    version: of the program.
    date: UTC; from SOURCE_DATE_EPOCH where that is set, so that outputs can be made again byte for
        byte."""

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
        """The parameters that differ, the relatively largest differences first; of many their
        number and the first."""
        sizes = {
            name: abs(change.value - change.identified) / (abs(change.identified) or 1.0)
            for name, change in self.changed.items()
        }
        told = []
        for name in sorted(sizes, key=lambda name: -sizes[name])[:_MOST_TOLD]:
            change = self.changed[name]
            unit = f" {getattr(FIELDS, name).unit}" if name in FIELDS._fields else ""
            told.append(f"{name} {change.value:.6g}{unit} (identified: {change.identified:.6g})")
        return [f"{len(sizes)} parameters differ, most", *told] if len(sizes) > _MOST_TOLD else told

    def text(self) -> str:
        """For people: a line, and a few more where aircraft or flight are not the identified and
        the paper's."""
        about = [f"hfa {self.version}", self.date[:10]]
        if self.model:
            about.append(f"plant {self.model}")
        elif self.parameters:
            about += [
                f"{self.dynamics} dynamics",
                f"parameters {self.parameters} ({self.parameter_hash})",
            ]
        lines = [", ".join(about)]
        if self.changed:
            lines.append("not the identified aircraft: " + "\n  ".join(self._changes()))
        if self.flight:
            lines.append(f"not the paper's level flight: {self.flight}")
        return "\n".join(lines)


def parameter_hash(values: Parameters) -> str:
    """The first digits of SHA-256 over the 17-digit values in their order."""
    text = "\n".join(f"{name}={float(value):.17g}" for name, value in values._asdict().items())
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def changed_parameters(parameters: ParameterSet) -> dict[str, Change]:
    """Parameter -> (value, identified value) for those that are not the identified ones."""
    known = default_parameters().values
    pairs = zip(Parameters._fields, parameters.values, known, strict=True)
    return {name: Change(value, other) for name, value, other in pairs if value != other}


def now() -> str:
    """The date and time, UTC; what SOURCE_DATE_EPOCH says where that is set."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    try:
        moment = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdecimal() else datetime.now(UTC)
    except (ValueError, OverflowError, OSError) as error:
        raise BadInputError(
            f"SOURCE_DATE_EPOCH is {shown(epoch)}; give seconds before the year 10000"
        ) from error
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")
