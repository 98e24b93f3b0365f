"""Names and units of a plant's states and inputs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from hfa_support.errors import BadInputError
from hfa_support.reporting.text import numbered


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """Return name in a file -> name in the model, an identifier that no other name has."""
    found: dict[str, str] = {}
    seen: Counter[str] = Counter()
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "variable"
        plain = f"v_{plain}" if plain[0].isdigit() else plain
        found[name] = plain + "_" * seen[plain]  # no plain name ends with "_"
        seen[plain] += 1
    return found


class PlantNames(NamedTuple):
    """Names and units of a plant's states and inputs, () where unknown.

    states: n names
    inputs: m names
    state_units: n units, with "" for an unknown unit
    input_units: m units, with "" for an unknown unit
    origin: name of the plant in the title of a report
    disturbances: names of the columns of a game's E, where they are winds of the model
    """

    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    state_units: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    origin: str = "the plant"
    disturbances: tuple[str, ...] = ()

    def completed(self, n: int, m: int) -> PlantNames:
        """Return names and units for n states and m inputs.

        Unknown states are named x1, x2, ..., unknown inputs u1, u2, ..., and unknown units are "".

        Raises BadInputError if the number of known names or units is not n for states or m for
        inputs.
        """
        return PlantNames(
            _as_many("states", self.states, numbered("x", n)),
            _as_many("inputs", self.inputs, numbered("u", m)),
            _as_many("state_units", self.state_units, ("",) * n),
            _as_many("input_units", self.input_units, ("",) * m),
            self.origin,
            self.disturbances,
        )


def _as_many(key: str, texts: tuple[str, ...], usual: tuple[str, ...]) -> tuple[str, ...]:
    """Return the given names or units, or the default ones if none are given."""
    if not texts:
        return usual
    if len(texts) != len(usual):
        raise BadInputError(f"{key} has {len(texts)} entries; give {len(usual)} for this plant")
    return tuple(texts)


UNNAMED = PlantNames()
