"""Report and figure of a trim; for the paper's flexible aircraft, the report has the modes of other
dynamics, and the figure is the front view.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa_model.declaration import is_hfa
from hfa_support.reporting.report import Report
from trim.hfa.other_dynamics import differences_group, mode_differences, with_other_dynamics
from trim.point.operating_point import OperatingPoint
from trim.reports.levels import DEFAULT_AIRPLANE, Airplane
from trim.reports.trim_report import report_of, saved_report
from trim.reports.trimmed import Trimmed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def trim_report(
    point: OperatingPoint,
    *,
    full: bool = False,
    airplane: Airplane = DEFAULT_AIRPLANE,
) -> Report:
    """Return the report of a trim, or of the nearest point if its condition has no trim.

    Angles are in degrees in the text and in radians in the data. For a point that was not found by
    a search, the report contains only the states and inputs.

    point: the trim or the nearest point
    full: whether to list each equation, the margins of all variables, all outputs, and the
        participation of the states in the modes
    airplane: class and flight phase category for the levels; by default the class that weight and
        load factor suggest, and category B
    """
    if point.found_by is None:
        return saved_report(point)
    trimmed = Trimmed(point)
    other = with_other_dynamics(point) if point.ok and is_hfa(point.model) else None
    if other is None:
        return report_of(trimmed, full=full, airplane=airplane)
    differences = mode_differences(trimmed.modes, other.modes)
    others = [differences_group(other.dynamics, differences)]
    report = report_of(trimmed, full=full, airplane=airplane, others=others)
    return report.with_data(other_dynamics=other.dynamics, mode_differences=differences)


def trim_figure(point: OperatingPoint) -> Figure:
    """Return a figure of a trim: the flexible aircraft from the front with its loads, or the
    variables of another aircraft in percent of their ranges.

    Raises BadInputError if no variable of another aircraft has two limits.
    """
    if is_hfa(point.model):
        from trim.hfa.front_view import front_view

        return front_view(point)
    from trim.reports.point_figure import point_figure

    return point_figure(point)
