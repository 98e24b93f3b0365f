"""The command `hfa trim`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import hfa_model
from hfa.options.draws import draws_option, with_draws
from hfa.options.output import show, trimmed
from hfa.options.request import command
from hfa.options.trims import OneTrimRequest, picture_option
from trim.point.trim_report import trim_report

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimRequest(OneTrimRequest):
    """Options of `hfa trim`."""

    draws: int | None = draws_option()
    picture: Path | None = picture_option(
        "a front view of the aircraft with its loads", only_hfa=True
    )


@command(TrimRequest)
def trim(request: TrimRequest) -> int:
    """Trim the aircraft and report variables, limits, active limits, residuals, loads and
    performance."""
    if not hfa_model.is_hfa(request.model):
        request.refuse(("picture",), "supports only the HFA; remove this option or --aircraft")
    aircraft = request.flown_aircraft()
    point = trimmed(request, aircraft)
    report = trim_report(aircraft, request.trim_condition, point)
    report = with_draws(report, request, point)

    def figure() -> Figure:
        from trim.hfa.front_view import trim_figure

        return trim_figure(aircraft, point)

    show(report, request, figure=figure)
    return 0
