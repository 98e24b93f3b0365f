"""Content of the figure of a region."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from pendulum_regions import PENDULUM

from hfa_aircraft.loading import load_model
from hfa_aircraft.march.ending import Outcome
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.picture import region_figure
from hfa_prove.problem import loop_at
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import LevelSet, Obstacles
from hfa_prove.search.region_search import Region
from hfa_prove.statements.loop import Gain
from hfa_prove.statements.region import RegionStatement
from trim.point.linearize import linearize
from trim.point.solve import trim


@pytest.fixture(scope="module")
def region() -> Region:
    """Return the region {angle² + rate² / 36 <= 0.25} of the pendulum, without a proof.

    The region has a state with V' >= 0 outside and an initial condition that does not converge.
    """
    model = load_model(PENDULUM)
    loop = loop_at(linearize(model, trim(model)), Gain(np.array([[2.0, 1.0]])))
    V = PolynomialFunction.quadratic(np.diag([1.0, 1.0 / 36.0]))
    statement = RegionStatement.of_terms(
        loop, V.terms, 0.25, {"angle": (-0.5, 0.5), "rate": (-3.0, 3.0)}
    )
    obstacles = Obstacles(
        (0.3, np.array([0.5, 0.0])), {Outcome.DIVERGED: (0.5, np.array([0.6, 1.0]))}, ()
    )
    level_set = LevelSet(V, 0.25, np.diag([0.5, 3.0]))
    plant = LoopValues(loop)
    return Region(
        statement, {}, 1, level_set, statement.extents, "a test", plant, obstacles=obstacles
    )


def lines(axes: Axes) -> dict[str, Line2D]:
    return {str(line.get_label()): line for line in axes.get_lines()}


def axes_of(figure: Figure) -> Axes:
    (axes,) = figure.axes
    return axes


def test_the_picture_shows_set_limits_and_box(region: Region) -> None:
    """The picture shows the set, the obstacles, lost initial conditions and the box."""
    figure = region_figure(region, np.array([1.0, 8.0]))
    figure.canvas.draw()
    axes = axes_of(figure)
    shown = lines(axes)
    rise = "lowest V with V' >= 0"
    least = "V of the nearest condition that does not converge"
    starts = "initial condition that does not converge"
    assert {"proved", rise, least, starts, "box of a critic's comparison"} <= set(shown)
    for name, level in (("proved", 0.25), (rise, 0.3), (least, 0.5)):
        points = np.radians(np.column_stack(shown[name].get_data()))
        assert np.allclose(region.set.V(points), level)
    x, y = shown["box of a critic's comparison"].get_data()
    corners = set(zip(np.abs(x), np.abs(y), strict=True))
    assert corners == {(np.degrees(1.0), np.degrees(8.0))}
    assert axes.get_xlim()[1] > np.degrees(1.0)
    assert axes.get_ylim()[1] > np.degrees(8.0)
    assert axes.get_xlabel() == "angle, deg"
    assert axes.get_ylabel() == "rate, deg/s"
    lost = np.radians(np.column_stack(shown[starts].get_data()))
    assert np.all(region.set.V(lost) > 0.25)


def test_a_much_larger_box_is_stated_in_label(
    region: Region,
) -> None:
    """A comparison box much larger than the region is stated in the axis label and lies beyond the
    axis.
    """
    axes = axes_of(region_figure(region, np.radians([2000.0, 50.0])))
    assert axes.get_xlabel() == "angle, deg (box to ±2e+03)"
    assert axes.get_xlim()[1] < 100.0
    x, y = lines(axes)["box of a critic's comparison"].get_data()
    assert np.max(x) == pytest.approx(2000.0, rel=1e-12)
    assert np.max(y) == pytest.approx(50.0, rel=1e-12)
    assert axes.get_ylim()[1] > 50.0


def test_a_figure_without_a_box_shows_none(region: Region) -> None:
    """Without a comparison box, the figure contains none."""
    assert "box of a critic's comparison" not in lines(axes_of(region_figure(region)))
