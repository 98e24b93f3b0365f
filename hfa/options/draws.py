"""The option --draws: the spread of a result for random parameters of the aircraft."""

from __future__ import annotations

from typing import Any

from hfa.options.argument_types import whole
from hfa.options.request import option
from hfa_support.entry_points import PARTS, part
from hfa_support.reporting.report import Report


def draws_option() -> Any:
    """Return the field `draws` of a request, with the option --draws."""
    return option(
        "add the spread of the result for N aircraft with random parameters",
        "N",
        whole(1),
        part="draws",
    )


def with_draws(report: Report, request: Any, subject: Any) -> Report:
    """Return a report, with the spread of its result for random parameters if --draws is given.

    report: report without the spread
    request: the options
    subject: the result: an operating point, a linear model, or (game, gain)
    """
    if request.draws is None:
        return report
    drawn: Report = part(PARTS, "draws", "--draws")(report, request, subject)
    return drawn
