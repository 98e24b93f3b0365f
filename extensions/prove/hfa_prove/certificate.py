"""A certificate: a statement with data for its proof, in a file that detects any edit."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from flint import ctx

from hfa_aircraft.model import Model
from hfa_prove.fields import Fields, naming
from hfa_prove.statements.schedule import ScheduleStatement, ScheduleWitness
from hfa_support.errors import BadInputError, file_faults, on_one_line
from hfa_support.files import regular_file, write_text
from hfa_support.origin import toolchain
from hfa_support.reporting.results import jsonable

SCHEMA = "hfa.certificate/11"
#: Entries of a file besides the statement and the witness. They are not part of the claim.
_CLOSING = ("digest", "provenance", "checksum")
#: Bits of the balls that enclose decimal numbers of a file.
_PRECISION = 256
#: Entry `kind` of every certificate.
KIND = "schedule"


@dataclass(frozen=True, eq=False)
class Certificate:
    """A statement with data for its proof, not yet checked.

    path: file of the certificate
    statement: the claim
    witness: data for the proof
    written: version, command and date stored in the file, not verified
    """

    path: Path
    statement: ScheduleStatement
    witness: ScheduleWitness
    written: Mapping[str, str]


def read_certificate(path: Path, aircraft: Model | None) -> Certificate:
    """Return the certificate in a file.

    aircraft: the user's aircraft, or None for a built-in one

    Raises BadInputError if the file is not a certificate, was edited, has another schema, or
    concerns another aircraft. Raises Rejected if an entry is not understood.
    """
    content, written = read_sealed(path)
    with naming(path):
        statement, witness = read_content(content, aircraft)
    return Certificate(path, statement, witness, written)


@ctx.workprec(_PRECISION)
def read_content(
    content: dict[str, Any], aircraft: Model | None = None
) -> tuple[ScheduleStatement, ScheduleWitness]:
    """Return the statement and the witness of a certificate.

    content: the entries of the file
    aircraft: the user's aircraft, or None for a built-in one

    Raises Malformed for the first wrong entry. Raises BadInputError if the certificate concerns
    another aircraft.
    """
    entries = Fields("", content)
    for name in ("schema", "toolchain", *_CLOSING):
        entries.value(name)  # counts as read: `read_sealed` has checked it
    entries.same("kind", KIND)
    known = SimpleNamespace(aircraft=aircraft)
    statement = ScheduleStatement.read(entries.fields("statement"), known)
    known = SimpleNamespace(statement=statement)
    witness = ScheduleWitness.read(entries.fields("witness"), known)
    entries.close()
    return statement, witness


def write_certificate(
    path: Path,
    statement: ScheduleStatement,
    witness: ScheduleWitness,
    origin: Mapping[str, Any],
) -> None:
    """Write a certificate with all digits of every number.

    path: file of the certificate
    statement: the claim
    witness: data for the proof
    origin: version, command and date of the run, which the digest does not cover
    """
    content = {
        "schema": SCHEMA,
        "kind": KIND,
        "toolchain": toolchain(),
        "statement": statement.content(),
        "witness": witness.content(),
    }
    write_text(path, sealed(json.dumps(jsonable(content))[:-1], json.dumps(jsonable(origin))))


def sealed(head: str, origin: str) -> str:
    """Return the text of a certificate.

    head: the JSON object of statement and witness, without the closing brace
    origin: provenance in JSON

    The entry `digest` is the SHA-256 of head. The last entry, `checksum`, is the SHA-256 of all
    text before it.
    """
    digest = hashlib.sha256(head.encode()).hexdigest()
    whole = f'{head}, "digest": "{digest}", "provenance": {origin}'
    checksum = hashlib.sha256(whole.encode()).hexdigest()
    return f'{whole}, "checksum": "{checksum}"}}\n'


def read_sealed(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the content of the certificate in a file, and version, command and date of its run.

    Raises BadInputError if the file is not a certificate, was edited, has another schema, or was
    written by other code.
    """
    with file_faults(path):
        text = regular_file(path).read_bytes()
    try:
        content = json.loads(text)
        origin = content["provenance"]
        body = {key: value for key, value in content.items() if key not in _CLOSING}
        edited = text != sealed(json.dumps(body)[:-1], json.dumps(origin)).encode()
        schema = str(content["schema"])
        if not schema.startswith("hfa.certificate/"):
            raise ValueError(schema)
        written = {key: on_one_line(str(origin[key])) for key in ("version", "command", "date")}
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        raise BadInputError(
            f"{path} is not a certificate; give a file written by `hfa prove ... -o`"
        ) from error
    if schema != SCHEMA:
        raise BadInputError(
            f"{path} has the format {on_one_line(schema)} of another version; prove the statement "
            "again with this version"
        )
    if edited:
        raise BadInputError(
            f"{path}: the certificate was edited (the digest does not match); prove the "
            "statement again"
        )
    made_by = content.get("toolchain")
    if made_by != toolchain():
        raise BadInputError(
            f"{path} was made by hfa {on_one_line(str(made_by))}, but this is {toolchain()}; prove "
            "the statement again, or check it with that version"
        )
    return content, written
