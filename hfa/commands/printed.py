"""The command `hfa printed`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from hfa.options.argument_types import input_file, positive
from hfa.options.output import ProgressLine
from hfa.options.part import option
from hfa.options.request import Request, command
from verification.printed.verdict import check_printed


@dataclass(frozen=True, kw_only=True, eq=False)
class PrintedRequest(Request):
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


@command(PrintedRequest)
def printed(request: PrintedRequest) -> int:
    """Compare every printed digit of P, K, L, W or H with the exact solution of the printed plant.

    The report names wrong entries. Exit code 0: every digit is correct, or the cost is within
    --limit-cost. Exit code 1: an entry is wrong, or the comparison is inconclusive."""
    progress = ProgressLine("compare")
    progress(0, 1)
    verdict = replace(check_printed(request.file, progress), limit_cost=request.limit_cost)
    progress(1, 1)
    request.show(verdict.report())
    return 0 if verdict.ok else 1
