"""Front view of the flexible aircraft (HFA) in a trim, drawn by the extension `page`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa_aircraft.model import Model
from hfa_support.entry_points import PARTS, part
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def trim_figure(aircraft: Model, point: OperatingPoint) -> Figure:
    """Return a figure of the aircraft from the front, with lift, weight and hinge moments.

    Raises BadInputError if the extension that draws the figure is not installed.
    """
    draw = part(PARTS, "trim.picture", "the picture of a trim")
    figure: Figure = draw(aircraft, point)
    return figure
