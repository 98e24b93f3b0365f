"""The command `hfa daveml`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hfa.options.argument_types import input_file
from hfa.options.part import option
from hfa.options.request import Request, command
from hfa_aircraft.readers.daveml.check_cases import checked_document
from hfa_aircraft.readers.daveml.document import read_document


@dataclass(frozen=True, kw_only=True, eq=False)
class DavemlRequest(Request):
    """Options of `hfa daveml`."""

    file: Path = option(
        "DAVE-ML file to check (docs/daveml.md)",
        "FILE",
        input_file(".dml", ".xml"),
        names="file",
        required=True,
    )


@command(DavemlRequest)
def daveml(request: DavemlRequest) -> int:
    """Recompute the check cases of a DAVE-ML file, and compare them with the outputs in the file.

    Exit code 0: every output agrees within the tolerance in the file. Exit code 1: otherwise, or if
    the file has no check case.
    """
    checked = checked_document(read_document(str(request.file)))
    request.show(checked.report())
    return 0 if checked.ok else 1
