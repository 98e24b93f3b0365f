"""What a store holds: its arrays, their axes and units, and the plan that decides their contents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple


class Array(NamedTuple):
    """One array of a store: shape of one row, type, value of a row that is not yet computed.

    axes: names of the axes of a row. about: its attributes: units, long_name.
    """

    shape: tuple[int, ...]
    kind: str
    fill: Any
    axes: tuple[str, ...]
    about: Mapping[str, Any]


def described(meaning: str, units: str = "", units_of: str = "") -> dict[str, str]:
    """Attributes of an array. units_of: the labels that hold the unit of each entry, where they have their own."""
    said = {"long_name": meaning, "units": units, "units_of": units_of}
    return {name: text for name, text in said.items() if text}


@dataclass(frozen=True, eq=False)
class Layout:
    """What a store holds. schema: names its form and version. what: the job in one word, for messages.

    rows: N; row: the name of that axis. chunk: rows of a chunk. plan: JSON data that decides the results; identity: a
    hash of it. arrays: name -> one array, (N, *shape). labels: name -> its axis and a text for each place of it; that
    of the same name as the axis are its coordinates. attributes: names and units of the columns.
    """

    schema: str
    what: str
    rows: int
    row: str
    chunk: int
    plan: Mapping[str, Any]
    identity: str
    arrays: Mapping[str, Array]
    labels: Mapping[str, tuple[str, Sequence[str]]]
    attributes: Mapping[str, Any]
