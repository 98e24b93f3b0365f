"""The command `hfa trim`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import hfa_model
from hfa.options.aircraft import Aircraft, of_hfa
from hfa.options.argument_types import breakpoint_value
from hfa.options.output import Output, picture_option
from hfa.options.part import option, part
from hfa.options.request import Request, command
from hfa.options.trim import Trim, scheduled
from trim.point.solve import TrimError
from trim.point.trim_report import point_figure, trim_report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trim.point.operating_point import OperatingPoint


@dataclass(frozen=True, kw_only=True, eq=False)
class OneTrimRequest(Request):
    """Request about one trim of any aircraft."""

    aircraft: Aircraft = part(Aircraft)
    trim: Trim = part(Trim, at=scheduled(breakpoint_value, required=True))

    def trimmed(self) -> OperatingPoint:
        """Return the operating point at the trim condition given by the options.

        If no trim is found, the command reports the reason. With --json, the report of the nearest
        point within the limits, with the active limits, is printed before the error is raised.

        Raises TrimError if no trim is found.
        """
        try:
            return self.trim.point()
        except TrimError as error:
            if self.output.json:
                report = trim_report(self.trim.aircraft, self.trim.condition, error.attempt)
                self.print(report.with_data(reason=str(error)))
            raise


#: Content of the picture: of the HFA, and of other aircraft.
_shown = of_hfa("a front view of the aircraft with its loads", "each variable between its limits")


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimRequest(OneTrimRequest):
    """Options of `hfa trim`."""

    output: Output = part(
        Output,
        picture=picture_option(_shown),
    )
    full: bool = option("print each equation, all near limits, outputs and participations")


@command(TrimRequest)
def trim(request: TrimRequest) -> int:
    """Trim the aircraft and report variables, limits, active limits, residuals, loads and
    performance."""
    point = request.trimmed()
    aircraft = request.trim.aircraft
    report = trim_report(aircraft, request.trim.condition, point, full=request.full)

    def figure() -> Figure:
        if not hfa_model.is_hfa(aircraft):
            return point_figure(point)
        from trim.hfa.front_view import trim_figure

        return trim_figure(aircraft, point)

    request.show(report, figure=figure)
    return 0
