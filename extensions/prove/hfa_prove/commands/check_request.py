"""Request of the check of a certificate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hfa.options.argument_types import input_file
from hfa.options.command import Request
from hfa.options.games import WeightOptions
from hfa.options.parser import PAPER, option
from hfa.options.trims import TrimOptions
from hfa_support.files import MATRIX_FILES


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckRequest(Request, TrimOptions, WeightOptions):
    """Options of `hfa prove --check`: a certificate, and data with which it must agree."""

    units: None = None
    start: None = None
    conditions: None = None
    row: None = None
    at: str | None = option("value or interval that the certificate must contain", "LOW:HIGH")
    dihedral: str | None = option(
        "value or interval of the dihedral angle that the certificate must contain, degrees",
        "DEG|LOW:HIGH",
        group=PAPER,
        first=True,
    )
    check: Path | None = option("certificate to verify", "FILE", input_file(".json"))
    weights: Path | None = option(
        "file with the gains that the certificate must be about",
        "FILE",
        input_file(*MATRIX_FILES),
    )
