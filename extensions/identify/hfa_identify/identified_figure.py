"""Figure of an identification: measured and fitted quantities, and residuals."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import shown_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa_identify.identified import Identified


def identified_figure(
    identified: Identified, make: Callable[[float, float], Figure] = new_figure
) -> Figure:
    """Return a figure with one row for each measured quantity and all records one after another.

    The left panel shows the measured samples and the fitted response. The right panel shows the
    residuals.

    make: function (width, height) -> empty figure, in inches
    """
    names = list(identified.quantities)
    figure = make(10.0, 1.2 + 1.6 * len(names))
    axes = figure.subplots(len(names), 2, sharex=True, squeeze=False)
    begins = np.cumsum([0.0, *(r.time[-1] - r.time[0] for r, _ in identified.fitted)])
    for row, name in enumerate(names):
        unit = identified.model.unit(name)
        factor = 180.0 / np.pi if unit.startswith("rad") else 1.0
        left, right = axes[row]
        for (record, y), begin in zip(identified.fitted, begins, strict=False):
            if name not in record.measured:
                continue
            time = record.time - record.time[0] + begin
            measured = factor * record.measured[name]
            fitted = factor * y[:, row]
            left.plot(time, measured, ".", color="0.6", markersize=2.0, label="measured")
            left.plot(time, fitted, color="C0", linewidth=1.2, label="fitted")
            right.plot(time, measured - fitted, color="C3", linewidth=0.6)
        left.set_ylabel(f"{name},\n{shown_unit(unit)}")
        right.set_ylabel(shown_unit(unit))
    axes[0][0].set_title("measured and fitted")
    axes[0][1].set_title("residual: measured - fitted")
    handles, labels = axes[0][0].get_legend_handles_labels()
    shown = dict(zip(labels, handles, strict=True))  # one entry for all records
    title = f"{identified.model.title}: {', '.join(identified.records)}"
    figure.legend([*shown.values()], [*shown], loc="outside upper center", ncols=2, title=title)
    for bottom in axes[-1]:
        bottom.set_xlabel("time, s")
    return figure
