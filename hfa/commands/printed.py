"""The command `hfa printed`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hfa.options.argument_types import input_file, positive
from hfa.options.output import ProgressLine, show
from hfa.options.request import command, option
from hfa.options.trims import OutputOptions
from verification.printed.verdict import check_printed


@dataclass(frozen=True, kw_only=True, eq=False)
class PrintedRequest(OutputOptions):
    """Arguments of `hfa printed`."""

    file: Path = option(
        "TOML file with the printed plant and the printed P, K, L, W or H (format: "
        "docs/critics.md)",
        "FILE",
        input_file(".toml"),
        names="file",
        required=True,
    )
    limit_cost: float | None = option(
        "for a file with learned = true: exit code 0 if the cost of the printed solution is at "
        "most this many percent above the optimum; default: every printed digit must be correct",
        "PERCENT",
        positive,
    )

    def origin(self) -> Mapping[str, Any]:
        """Return no additional entries of the provenance, because the file contains the plant."""
        return {}


@command(PrintedRequest)
def printed(request: PrintedRequest) -> int:
    """Compare every printed digit of P, K, L, W or H with the exact solution of the printed plant.

    The report names wrong entries. Exit code 0: every digit is correct, or the cost is within
    --limit-cost. Exit code 1: an entry is wrong, or the comparison is inconclusive."""
    progress = ProgressLine("compare")
    progress(0, 1)
    verdict = replace(check_printed(request.file, progress), limit_cost=request.limit_cost)
    progress(1, 1)
    show(verdict.report(), request)
    return 0 if verdict.ok else 1
