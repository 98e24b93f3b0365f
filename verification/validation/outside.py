"""What others have printed and released about this aircraft: read from one file, none of it computed here."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from hfa_model.vectors import INPUTS, LINEAR_STATES, Input, entry_unit


@dataclass(frozen=True)
class ReleasedTrim:
    """One trim of the released simulation. speed: ft/s. dihedral, alpha: rad. inputs: lbf (throttle) and rad.

    eigenvalues: of its six-state A, one of each conjugate pair, 1/s, fastest first.
    """

    speed: float
    altitude: float
    dihedral: float
    alpha: float
    inputs: Input
    eigenvalues: tuple[complex, ...]


@dataclass(frozen=True)
class PrintedEntry:
    """One printed entry of A or B; `digits` as they stand on the page."""

    name: str
    row: str
    column: str
    digits: str

    @property
    def value(self) -> float:
        """The printed number."""
        return float(self.digits)

    @property
    def unit(self) -> str:
        """Of the number."""
        return entry_unit(self.row, self.column)

    @property
    def half_unit(self) -> float:
        """Half of the last printed digit; 0 for an entry printed without decimals, which is exact."""
        decimals = len(self.digits.partition(".")[2])
        return 0.5 * 10.0**-decimals if decimals else 0.0


@cache
def outside_data() -> dict[str, Any]:
    """The file as it is."""
    return dict(json.loads(files("verification.validation").joinpath("outside.json").read_text(encoding="utf-8")))


def released_trims() -> tuple[ReleasedTrim, ...]:
    """The trims of the released simulation, in the order of the file."""
    data = outside_data()["released_simulation"]
    return tuple(
        ReleasedTrim(
            speed=speed,
            altitude=data["altitude_ft"],
            dihedral=math.radians(degrees),
            alpha=alpha,
            inputs=Input(*inputs),
            eigenvalues=tuple(complex(*parts) for parts in eigenvalues),
        )
        for speed, degrees, alpha, *inputs, eigenvalues in data["rows"]
    )


def third_printed_model() -> tuple[PrintedEntry, ...]:
    """The entries of A and B of Qu 2018, Eq. (97), those of B under the inputs that they belong to."""
    data = outside_data()["qu_2018"]
    found = []
    for name, columns, rows in (("A", LINEAR_STATES, data["A"]), ("B", data["B_inputs"], data["B"])):
        for row, digits_of_row in zip(LINEAR_STATES, rows, strict=True):
            for column, digits in zip(columns, digits_of_row, strict=True):
                assert column in INPUTS or column in LINEAR_STATES
                if digits is not None:
                    found.append(PrintedEntry(f"{name}({row}, {column})", row, column, digits))
    return tuple(found)


def trim_of_third_printed_model() -> ReleasedTrim:
    """The released trim at the speed and dihedral angle of Qu 2018, Eq. (97), which prints no true trim of its own."""
    data = outside_data()["qu_2018"]
    dihedral = math.radians(data["dihedral_deg"])
    return next(each for each in released_trims() if (each.speed, each.dihedral) == (data["speed_ft_s"], dihedral))
