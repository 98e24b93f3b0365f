"""What happens in the first second of a long flight, in an inset where no curve runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: s; shown in the inset where the picture is more than `_LONG` times as long.
EARLY, _LONG = 1.0, 5.0
#: Share of the range of all values that the first second takes up, from which it gets its inset.
_SWEEPING = 0.5
#: Of the height of the axes: what is left free of later curves, and the inset within it, with room for its numbers.
_FREE, _ABOVE, _BELOW = 0.54, 0.09, 0.1
_LEFT, _WIDTH = 0.36, 0.6


@dataclass(frozen=True, eq=False)
class Line:
    """x: (N,), y: (N,) or (N, k) for a bundle without names of its own."""

    label: str
    x: np.ndarray
    y: np.ndarray


def transient(lines: Sequence[Line]) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Lowest and highest of all values, and of those after `EARLY`; None when the first second does not stand out."""
    if not lines or max(float(line.x.max(initial=0.0)) for line in lines) <= _LONG * EARLY:
        return None
    whole, early, late = (
        np.concatenate([line.y[chosen(line.x)].ravel() for line in lines])
        for chosen in (lambda x: x >= 0.0, lambda x: x <= EARLY, lambda x: x > EARLY)
    )
    if not len(early) or not len(late) or np.ptp(early) < _SWEEPING * np.ptp(whole):
        return None
    if np.ptp(whole) == 0.0 or np.ptp(late) > (1.0 - _SWEEPING / 2) * np.ptp(whole):
        return None
    return (float(whole.min()), float(whole.max())), (float(late.min()), float(late.max()))


def draw_inset(axes: Axes, lines: Sequence[Line], draw: Callable[[Axes, Sequence[Line]], None]) -> Axes | None:
    """The first second of the lines where later ones leave room, which is made where there is too little."""
    found = transient(lines)
    if found is None:
        return None
    (lowest, highest), (low, high) = found
    above = highest - high > low - lowest
    margin = 0.04 * (highest - lowest)
    bottom, top = lowest - margin, highest + margin
    if above:
        top = max(top, (high + margin - _FREE * bottom) / (1.0 - _FREE))
        begin, end = (high + margin - bottom) / (top - bottom), 1.0
    else:
        bottom = min(bottom, (low - margin - _FREE * top) / (1.0 - _FREE))
        begin, end = 0.0, (low - margin - bottom) / (top - bottom)
    axes.set_ylim(bottom, top)
    inset = axes.inset_axes((_LEFT, begin + _BELOW, _WIDTH, end - begin - _ABOVE - _BELOW), zorder=7)
    draw(inset, [Line(line.label, line.x[line.x <= EARLY], line.y[line.x <= EARLY]) for line in lines])
    inset.set_xlim(-0.02 * EARLY, EARLY)
    inset.set_title("first second", fontsize=7, pad=2)
    inset.tick_params(labelsize=6, length=2, pad=1)
    inset.grid(alpha=0.3)
    return inset
