"""The inset of the first second: where it is drawn, that it holds the curves, no later curve through it."""

from __future__ import annotations

import numpy as np
import pytest

from verification.experiments.first_second import EARLY, Line, transient
from verification.experiments.panels import Panel, PaperFigure, draw

TIMES = np.linspace(0.0, 20.0, 2001)
DIP = Line("dip", TIMES, 0.1 * np.sin(TIMES) - 2.0 * np.exp(-5.0 * TIMES))
FLAT = Line("flat", TIMES, np.full(2001, 0.1))
SLOW = Line("slow", TIMES, np.sin(TIMES))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("size", [0.05, 1.0])
def test_the_inset_shows_the_first_second_where_no_later_curve_runs(sign: float, size: float) -> None:
    """size: of what follows; where it takes all the height, room is made."""
    lines = tuple(
        Line(line.label, line.x, sign * line.y) for line in (Line("dip", TIMES, DIP.y + size * np.sin(TIMES)), FLAT)
    )
    panel = Panel("", "speed, ft/s", lines)
    figure = draw(PaperFigure(3, "Title", 1, (panel,)))
    axes = figure.axes[0]
    (inset,) = axes.child_axes
    assert inset.get_title() == "first second"
    for line, drawn in zip(lines, inset.get_lines(), strict=True):
        early = line.x <= EARLY
        np.testing.assert_array_equal(drawn.get_xydata(), np.column_stack([line.x[early], line.y[early]]))
    figure.canvas.draw()
    box = inset.get_tightbbox().transformed(axes.transData.inverted())
    later = np.concatenate([line.y[line.x > EARLY] for line in lines])
    assert later.max() < min(box.y0, box.y1) or later.min() > max(box.y0, box.y1)
    bottom, top = axes.get_ylim()
    assert bottom < min(box.y0, box.y1)
    assert max(box.y0, box.y1) < top
    assert bottom < min(line.y.min() for line in lines)
    assert max(line.y.max() for line in lines) < top


@pytest.mark.parametrize(
    "lines",
    [
        (SLOW,),
        (FLAT,),
        (Line("short", TIMES[:400], DIP.y[:400]),),
        (Line("lost", TIMES[:1], np.ones(1)),),
        (Line("nothing", TIMES[:0], np.zeros(0)),),
        (),
    ],
    ids=["slow", "flat", "short", "lost", "nothing", "none"],
)
def test_what_has_no_transient_has_no_inset(lines: tuple[Line, ...]) -> None:
    assert transient(lines) is None
    if lines:
        assert draw(PaperFigure(3, "Title", 1, (Panel("", "speed, ft/s", lines),))).axes[0].child_axes == []


def test_a_bundle_is_in_the_inset_too() -> None:
    both = Line("both", TIMES, np.column_stack([DIP.y, 2.0 * DIP.y]))
    figure = draw(PaperFigure(3, "Title", 1, (Panel("", "speed, ft/s", (both,)),)))
    assert len(figure.axes[0].child_axes[0].get_lines()) == 2
