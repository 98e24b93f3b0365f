"""The command `hfa daveml`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hfa.options.argument_types import input_file
from hfa.options.output import show
from hfa.options.request import command, option
from hfa.options.trims import OutputOptions
from hfa_aircraft.readers.daveml.check_cases import checked_document
from hfa_aircraft.readers.daveml.document import read_document


@dataclass(frozen=True, kw_only=True, eq=False)
class DavemlRequest(OutputOptions):
    """Options of `hfa daveml`."""

    file: Path = option(
        "DAVE-ML file to check (docs/daveml.md)",
        "FILE",
        input_file(".dml", ".xml"),
        names="file",
        required=True,
    )

    def origin(self) -> Mapping[str, Any]:
        """Return an empty provenance. The recorded command line already contains the path of the
        file.
        """
        return {}


@command(DavemlRequest)
def daveml(request: DavemlRequest) -> int:
    """Recompute the check cases of a DAVE-ML file, and compare them with the outputs in the file.

    Exit code 0: every output agrees within the tolerance in the file. Exit code 1: otherwise, or if
    the file has no check case.
    """
    checked = checked_document(read_document(str(request.file)))
    show(checked.report(), request)
    return 0 if checked.ok else 1
