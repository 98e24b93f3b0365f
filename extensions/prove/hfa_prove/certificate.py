"""File format of a certificate, with a digest and a checksum that detect any edit."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from hfa_prove.fields import Fields
from hfa_support.errors import BadInputError, file_faults, on_one_line
from hfa_support.files import regular_file, write_text
from hfa_support.reporting.data_files import jsonable
from hfa_support.version import VERSION

SCHEMA = "hfa.certificate/9"
#: Entries of a file besides the statement and the witness. They are not part of the claim.
_CLOSING = ("digest", "provenance", "checksum")


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


def claims_of(content: dict[str, Any]) -> Fields:
    """Return a reader of the entries kind, statement and witness of a certificate."""
    entries = Fields("", content)
    for name in ("schema", "toolchain", *_CLOSING):
        entries.value(name, lambda value: True)
    return entries


def kind_of(path: Path) -> str:
    """Return the kind of the certificate in a file, such as "schedule".

    Raises BadInputError if the file is not a certificate or was edited.
    """
    content, _ = read_sealed(path)
    return str(content.get("kind"))


def read_sealed(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the content of the certificate in a file, and version, command and date of its run.

    Raises BadInputError if the file is not a certificate, was edited, or has another schema.
    """
    with file_faults(path):
        text = regular_file(path).read_bytes()
    try:
        content = json.loads(text)
        origin = content["provenance"]
        body = {key: value for key, value in content.items() if key not in _CLOSING}
        edited = text != sealed(json.dumps(body)[:-1], json.dumps(origin)).encode()
        schema = str(content["schema"])
        written = {key: on_one_line(str(origin[key])) for key in ("version", "command", "date")}
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        raise BadInputError(
            f"{path} is not a certificate; give a file written by `hfa prove ... -o`"
        ) from error
    if schema != SCHEMA or content.get("kind") == "models":
        raise BadInputError(
            f"{path} has the format {on_one_line(schema)} of another version; prove the statement "
            "again with this version"
        )
    if edited:
        raise BadInputError(
            f"{path}: the certificate was edited (the digest does not match); prove the "
            "statement again"
        )
    return content, written


def write_sealed(
    path: Path,
    kind: str,
    statement: dict[str, Any],
    witness: dict[str, Any],
    origin: dict[str, Any],
) -> None:
    """Write a certificate with all digits of every number.

    path: file of the certificate
    kind: kind of the certificate
    statement: the claim as stored in the file
    witness: data for the proof as stored in the file
    origin: provenance of the run, which the digest does not cover
    """
    content = {
        "schema": SCHEMA,
        "kind": kind,
        "toolchain": VERSION,
        "statement": statement,
        "witness": witness,
    }
    write_text(path, sealed(json.dumps(jsonable(content))[:-1], json.dumps(jsonable(origin))))
