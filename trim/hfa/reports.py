"""Reports of a trim and of a linear model, and the figure of a trim. Those of the paper's flexible
aircraft, whose package is imported for no other, have more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa_aircraft.model import Model
from hfa_support.reporting.report import Report
from trim.point.operating_point import OperatingPoint
from trim.reports.levels import DEFAULT_AIRPLANE, Airplane
from trim.reports.sheet import report_of, saved_report
from trim.reports.trimmed import Trimmed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trim.linear.linear_model import LinearModel


def _is_flexible(model: Model) -> bool:
    """Return whether a model is the flexible aircraft with the equations of a `Variant`."""
    # Only that aircraft names its scheduling variable in options (--dihedral). Its package is not
    # imported for another one.
    if not model.about.names_schedule:
        return False
    from hfa_model.declaration import is_hfa

    return is_hfa(model)


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
    if not point.ok or not _is_flexible(point.model):
        return report_of(trimmed, full=full, airplane=airplane)
    from trim.hfa.beside import differences_group, mode_differences, with_other_dynamics

    other = with_other_dynamics(point)
    if other is None:
        return report_of(trimmed, full=full, airplane=airplane)
    differences = mode_differences(trimmed.modes, other.modes)
    others = [differences_group(other.dynamics, differences)]
    report = report_of(trimmed, full=full, airplane=airplane, others=others)
    return report.with_data(other_dynamics=other.dynamics, mode_differences=differences)


def linear_model_report(model: LinearModel, *, responses: bool = False) -> Report:
    """Return a report of a linear model: A, B, the offsets, the modes and the handling qualities.

    C and D are included if the outputs are not the states. The data of the report also contain E
    and F. For the paper's flexible aircraft, the error bands of the entries, the differences from
    other dynamics and from the printed matrices are added where they are known.

    responses: whether to add the frequency responses at the natural frequencies of the modes
    """
    from trim.reports.linear_report import report_of_linear

    if not _is_flexible(model.model):
        return report_of_linear(model, responses=responses, beside=None)
    from trim.hfa.beside import beside

    return report_of_linear(model, responses=responses, beside=beside(model))


def trim_figure(point: OperatingPoint) -> Figure:
    """Return a figure of a trim: the flexible aircraft from the front with its loads, or the
    variables of another aircraft in percent of their ranges.

    Raises BadInputError if no variable of another aircraft has two limits.
    """
    if _is_flexible(point.model):
        from trim.hfa.front_view import front_view

        return front_view(point)
    from trim.reports.book import point_figure

    return point_figure(point)
