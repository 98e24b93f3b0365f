"""The eigenvalues of linear models along one variable, and their picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import shown_unit, shown_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: A mode is slow when it never has a larger share of the fastest eigenvalue.
_SLOW = 0.15


class RootLocus(NamedTuple):
    """N points along one variable. values: (N,), in `unit`. eigenvalues: (N, n), 1/s, a column a mode;
    nan where there is no trim. mode_names: of the columns, empty where nothing is trimmed.
    """

    variable: str
    unit: str
    values: np.ndarray
    eigenvalues: np.ndarray
    mode_names: tuple[str, ...]
    called: str

    @property
    def slow(self) -> np.ndarray:
        """(n,) which eigenvalues stay slow along the line: below a share of the fastest everywhere."""
        size = np.nanmax(np.abs(self.eigenvalues), axis=0)
        return np.asarray(size < _SLOW * size.max())

    def figure(self) -> Figure:
        """One color a mode, the slow ones enlarged; both ends of the line marked.

        BadInputError when no point of it has a trim: there is nothing to draw.
        """
        if not self.mode_names:
            raise BadInputError("no point of the sweep has a trim: there is no root locus to draw")
        slow = self.slow
        parts = [("all modes", np.ones(len(slow), dtype=bool))]
        if slow.any() and not slow.all():
            parts.append(("the slow modes", slow))
        figure = new_figure(10.0, 5.2)
        for axes, (title, shown) in zip(figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True):
            self._draw(axes, shown)
            axes.set_title(f"{self.called}, {title}", fontsize=10)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8)
        return figure

    def _draw(self, axes: Axes, shown: np.ndarray) -> None:
        """The columns that are shown, a line a mode, and both ends of the line."""
        values, unit = shown_values(self.values, self.unit), shown_unit(self.unit)
        names = list(dict.fromkeys(self.mode_names))
        for column in np.flatnonzero(shown).tolist():
            name = self.mode_names[column]
            style = ("-", "--", "-.", ":")[names.index(name) % 4]
            label = name if column == self.mode_names.index(name) else None
            roots = self.eigenvalues[:, column]
            axes.plot(roots.real, roots.imag, style, color=f"C{names.index(name)}", label=label)
        trimmed = np.flatnonzero(~np.isnan(self.eigenvalues[:, 0]))
        for end, marker in ((trimmed[0], "o"), (trimmed[-1], "s")):
            roots = self.eigenvalues[end, shown]
            note = f"{self.variable} {values[end]:.4g} {unit}"
            axes.plot(roots.real, roots.imag, marker, color="black", fillstyle="none", markersize=5, label=note)
        axes.axvline(0.0, color="gray", linewidth=0.8)
        axes.set_xlabel("real part, 1/s")
        axes.set_ylabel("imaginary part, 1/s")
        axes.grid(alpha=0.3)
