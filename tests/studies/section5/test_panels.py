"""Pictures of Section 5: what is drawn is what is stored, commands are dashed, learning times are marked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from experiment_configurations import BRIEF, COARSE, changed

from hfa_support.reporting.figure import png_bytes
from studies.section5.flown_laws import CERTIFIED, MODIFIED, PRINTED
from studies.section5.panels import COMMAND, LOST, Line, PaperFigure, PlotPanel, draw
from studies.section5.reproduction import EXPERIMENTS, run_experiment
from studies.section5.sections import Outcome
from studies.section5.setting import make_setting

TIMES = np.linspace(0.0, 20.0, 201)
LINES = (
    Line(CERTIFIED, TIMES, np.sin(TIMES)),
    Line(f"{PRINTED}{LOST}0.0001 s)", TIMES[:1], np.ones(1)),
    Line(COMMAND, TIMES, np.ones(201)),
)


@pytest.fixture(scope="module")
def noise() -> Outcome:
    """The smallest experiment, flown for a second."""
    return run_experiment(EXPERIMENTS["5.4"], make_setting(changed(COARSE, BRIEF)))


def picture_of(*panels: PlotPanel) -> PaperFigure:
    return PaperFigure(3, "Title", 2, panels)


def test_what_is_drawn_is_what_is_stored() -> None:
    panel = PlotPanel("left", "speed, ft/s", LINES, marked=((10.0, "T_w"),))
    picture = picture_of(panel, panel)
    axes = draw(picture).axes[0]
    drawn = {line.get_label(): line for line in axes.get_lines()}
    for line in LINES:
        np.testing.assert_array_equal(drawn[line.label].get_xydata(), np.column_stack([line.x, line.y]))
    assert len(picture.arrays) == 2 * 2 * len(LINES)
    assert not any("/" in name for name in picture.arrays)
    np.testing.assert_array_equal(picture.arrays["01 left speed, ft_s _ certified _ y"], LINES[0].y)


def test_lines_differ_without_color() -> None:
    axes = draw(picture_of(PlotPanel("left", "speed, ft/s", LINES, marked=((10.0, "T_w"),)))).axes[0]
    drawn = {line.get_label(): line for line in axes.get_lines()}
    assert drawn[COMMAND].get_linestyle() == "--"
    assert drawn[CERTIFIED].get_linestyle() == "-"
    assert drawn[LINES[1].label].get_marker() == "x"
    assert [line.get_xdata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 2] == [10.0]


def test_axes_are_named_and_the_legend_names_every_law() -> None:
    figure = draw(picture_of(PlotPanel("left", "speed, ft/s", LINES), PlotPanel("right", "alpha, rad", LINES)))
    assert [axes.get_ylabel() for axes in figure.axes] == ["speed, ft/s", "alpha, rad"]
    assert [axes.get_xlabel() for axes in figure.axes] == ["time, s", "time, s"]
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {line.label for line in LINES}


@pytest.mark.parametrize("scale", ["log", "asinh"])
def test_values_that_an_axis_leaves_out_do_not_shorten_it(scale: str) -> None:
    values = np.where(TIMES < 5.0, 1000.0 * np.exp(-TIMES), np.nan)
    axes = draw(picture_of(PlotPanel("left", "size", (Line(MODIFIED, TIMES, values),), scale))).axes[0]
    assert axes.get_xlim()[1] > 20.0
    assert axes.get_yscale() == scale
    assert [text.get_text() for text in axes.texts] == ["0 from 4.9 s on"]


def test_limits_are_drawn_where_a_line_comes_near_them() -> None:
    panel = PlotPanel(
        "left", "aileron_outer, rad", (Line(MODIFIED, TIMES, np.sin(TIMES)),), "asinh", (), 0.1, (-1.1, 2.0)
    )
    figure = draw(picture_of(panel))
    assert [line.get_ydata()[0] for line in figure.axes[0].get_lines() if line.get_label() == "limit"] == [-1.1]
    assert "limit" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == ["0", "-0.1", "0.1", "-1", "1"]


@pytest.mark.parametrize(
    ("largest", "marks"),
    [(0.005, ["0", r"$3\cdot10^{-4}$", r"$10^{-3}$", r"$3\cdot10^{-3}$"]), (50.0, ["0", "3", "10", "30"])],
)
def test_a_scale_has_marks_enough(largest: float, marks: list[str]) -> None:
    line = Line(MODIFIED, TIMES, largest * np.abs(np.sin(TIMES)))
    axes = draw(picture_of(PlotPanel("left", "size", (line,), "asinh", (), 0.1))).axes[0]
    assert [text.get_text() for text in axes.get_yticklabels()] == marks


def test_the_legend_is_above_where_no_caption_is() -> None:
    figure = draw(picture_of(PlotPanel("left", "speed, ft/s", LINES)))
    figure.canvas.draw()
    assert figure.legends[0].get_window_extent().y0 > figure.axes[0].get_window_extent().y1
    assert figure.legends[0].get_title().get_text() == "Figure 3. Title"


def test_a_bundle_of_nothing_is_drawn() -> None:
    figure = draw(picture_of(PlotPanel("left", "weights W", (Line("weights", TIMES, np.zeros((201, 3))),), "asinh")))
    assert len(figure.axes[0].get_lines()) == 3
    assert png_bytes(figure).startswith(b"\x89PNG")


def test_a_flight_that_was_lost_at_once_is_drawn() -> None:
    nothing = Line(MODIFIED, TIMES[:0], np.zeros(0))
    for lines in ((nothing,), (nothing, LINES[0])):
        for scale in ("linear", "log", "asinh"):
            assert len(draw(picture_of(PlotPanel("left", "size", lines, scale))).axes) == 1 + 1


def test_every_panel_of_an_experiment_has_units_and_the_learning_time(noise: Outcome, tmp_path: Path) -> None:
    pictures = noise.experiment.pictures(noise.setting, noise.flown)
    assert [picture.number for picture in pictures] == [22, 23]
    for picture in pictures:
        for panel in picture.panels:
            assert (0.5, "T_w") in panel.marked
            assert panel.y_label.endswith((", ft/s", ", rad", "weights W, of z in ft/s, rad"))
    errors = next(line for line in pictures[0].panels[0].lines if line.label == CERTIFIED)
    plan = next(plan for plan in noise.flown if plan.law == CERTIFIED and plan.noise)
    np.testing.assert_array_equal(errors.y, noise.flown[plan].errors[:, 0])


def test_processes_share_the_flights(noise: Outcome) -> None:
    again = run_experiment(EXPERIMENTS["5.4"], noise.setting, processes=2)
    assert list(again.flown) == list(noise.flown)
    assert [claim.to_dict() for claim in again.claims] == [claim.to_dict() for claim in noise.claims]
    for one, other in zip(again.flown.values(), noise.flown.values(), strict=True):
        np.testing.assert_array_equal(one.states, other.states)


def test_a_bundle_is_pale_and_its_panel_names_the_lines_beside_it() -> None:
    lines = (Line("the other 3", TIMES, np.ones((201, 3))), Line("z1 z2", TIMES, TIMES), Line("z4^2", TIMES, -TIMES))
    figure = draw(picture_of(PlotPanel("left", "weights W", lines, "asinh"), PlotPanel("right", "speed, ft/s", LINES)))
    left, right = figure.axes[:2]
    assert [text.get_text() for text in left.get_legend().get_texts()] == ["the other 3", "z1 z2", "z4^2"]
    assert right.get_legend() is None
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {line.label for line in LINES}
    named = [line.get_color() for line in left.get_lines() if line.get_label() in ("z1 z2", "z4^2")]
    assert len(set(named)) == 2
    assert "0.8" not in named
