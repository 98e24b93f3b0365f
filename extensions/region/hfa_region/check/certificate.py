"""Certificate file of a proved region: writing, reading and verification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hfa_aircraft.model import Model
from hfa_proof.checker.reading import naming
from hfa_proof.checker.sealed import claims_of, read_sealed, write_sealed
from hfa_region.check.checker import check_region
from hfa_region.check.extents import extents_of
from hfa_region.check.statement import RegionStatement
from hfa_region.check.witness import RegionWitness
from hfa_support.progress import Progress

#: Kind of the certificate.
KIND = "region"


@dataclass(frozen=True, eq=False)
class VerifiedRegion:
    """A region of attraction that the checker has proved.

    statement: the proved statement
    parts: number of parts of the set on which V' < 0 is proved
    extents: state -> lowest and highest deviation in the set, computed by the checker
    written: version, command and date stored in the certificate, not verified
    """

    statement: RegionStatement
    parts: int
    extents: Mapping[str, tuple[float, float]]
    written: dict[str, str]


def check_certificate(
    path: Path, progress: Progress | None = None, model: Model | None = None
) -> VerifiedRegion:
    """Return the region of attraction that a certificate proves.

    path: file of the certificate
    progress: called with the progress of the proof, or None
    model: the user's aircraft, or None if the certificate concerns a built-in model

    Raises BadInputError if the file is not a certificate, was edited, or concerns another model.
    Raises Rejected if an entry is not understood or the statement is not proved.
    """
    content, written = read_sealed(path)
    with naming(path):
        statement, witness = read_content(content, model)
        parts = check_region(statement, witness, progress)
    return VerifiedRegion(statement, parts, extents_of(statement, witness.T), written)


def read_content(
    content: dict[str, Any], model: Model | None
) -> tuple[RegionStatement, RegionWitness]:
    """Return the statement and the witness of a certificate.

    content: the entries of the file
    model: the user's aircraft, or None if the certificate concerns a built-in model

    Raises Malformed for the first invalid entry.
    Raises BadInputError if the certificate concerns another model.
    """
    entries = claims_of(content)
    entries.same("kind", KIND)
    statement = RegionStatement.read(entries.value("statement", lambda value: True), model)
    witness = RegionWitness.read(entries.fields("witness"), statement)
    entries.close()
    return statement, witness


def write_certificate(
    path: Path, statement: RegionStatement, witness: dict[str, Any], origin: dict[str, Any]
) -> None:
    """Write a certificate of a region of attraction.

    path: file of the certificate
    statement: the claim
    witness: data for the proof, in the form that `RegionWitness.read` accepts
    origin: version, command and date, which the digest of the file does not cover
    """
    write_sealed(path, KIND, statement.content(), witness, origin)
