"""Content of the figure of a region."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from pendulum_regions import PENDULUM

from hfa_aircraft.loading import load_model
from hfa_aircraft.march.ending import Outcome
from hfa_aircraft.model import Model, Signal
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.picture import region_figure
from hfa_prove.problem import loop_at
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import LevelSet, Obstacles
from hfa_prove.search.region_search import Region
from hfa_prove.statements.loop import Gain, Loop
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
    assert axes.get_subplotspec().get_geometry()[:2] == (1, 1)
    assert len(axes.patches) == 1
    assert any(np.array_equal(line.get_xydata(), [[0.0, 0.0]]) for line in axes.get_lines())
    assert axes.get_xlabel() == "angle, deg"
    assert axes.get_ylabel() == "rate, deg/s"
    lost = np.radians(np.column_stack(shown[starts].get_data()))
    assert np.all(region.set.V(lost) > 0.25)


def test_a_much_larger_box_is_stated_in_label(
    region: Region, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A comparison box much larger than the region is stated in the axis label and lies beyond the
    axis.
    """
    monkeypatch.setattr("hfa_prove.picture.starts_by_outcome", lambda *arguments: {})
    axes = axes_of(region_figure(region, np.radians([2000.0, 50.0])))
    assert axes.get_xlabel() == "angle, deg (box to ±2e+03)"
    assert axes.get_xlim()[1] < 100.0
    x, y = lines(axes)["box of a critic's comparison"].get_data()
    assert np.max(x) == pytest.approx(2000.0, rel=1e-12)
    assert np.max(y) == pytest.approx(50.0, rel=1e-12)
    assert axes.get_ylim()[1] > 50.0


def test_each_section_shows_its_two_states(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a model with three states of different units, each section shows one pair of them.

    In each section all other deviations are 0: the curves are V = level there. The view is 1.4
    times as large as the levels.
    """
    model = Model(
        "three", {"a": Signal("m"), "b": Signal("rad"), "c": Signal("rad/s")}, {},
        lambda x, u, p, w: ({"a": -x.a, "b": -x.b, "c": -x.c}, {}), trim={},
    )  # fmt: skip
    units = {"a": 1.0, "b": np.degrees(1.0), "c": np.degrees(1.0)}
    shown_units = {"a": "m", "b": "deg", "c": "deg/s"}
    values = {"a": 0.5, "b": 0.1, "c": 0.2}
    loop = Loop(model, {}, dict.fromkeys(values, 0.0), {}, {}, {}, Gain(np.zeros((0, 3))))
    V = PolynomialFunction.quadratic(np.diag([1.0, 2.0, 3.0]))
    T = np.diag([0.9, 0.7, 0.5])
    left = np.array([[0.5, 0.1, 0.2], [0.6, 0.3, 0.4]])
    lost = np.array([[0.7, 0.8, 0.9]])
    starts = {Outcome.LEFT: (0.2, left[0])}
    region = Region(
        RegionStatement.of_terms(loop, V.terms, 0.1, {}), {}, 1, LevelSet(V, 0.1, T), {}, "a test",
        LoopValues(loop), obstacles=Obstacles((np.inf, None), starts, ()),
    )  # fmt: skip
    flown: list[np.ndarray] = []

    def found(loop: Any, proved: Any, rays: np.ndarray, clock: Any) -> dict[Outcome, np.ndarray]:
        flown.append(rays)
        return {Outcome.LEFT: left, Outcome.DIVERGED: lost}

    monkeypatch.setattr("hfa_prove.picture.starts_by_outcome", found)
    assert "box of a critic's comparison" not in lines(region_figure(region).axes[0])
    flown.clear()
    figure = region_figure(region, np.array([2.0, 1.0, 0.5]))
    assert "sections of the proved set, all other deviations 0" in str(
        figure.legends[0].get_title().get_text()
    )
    for axes, rays, (x, y) in zip(figure.axes, flown, ("ab", "ac", "bc"), strict=True):
        assert axes.get_xlabel() == f"{x}, {shown_units[x]}"
        assert axes.get_ylabel() == f"{y}, {shown_units[y]}"
        i, j = "abc".index(x), "abc".index(y)
        drawn = lines(axes)
        edge = "V of the nearest condition that leaves the limits"
        assert "lowest V with V' >= 0" not in drawn
        largest = np.zeros(2)
        for label, level in (("proved", 0.1), (edge, 0.2)):
            z = np.zeros((len(drawn[label].get_xdata()), 3))
            z[:, i] = drawn[label].get_xdata() / units[x]
            z[:, j] = drawn[label].get_ydata() / units[y]
            assert np.allclose(V(z), level)
            half = np.sqrt(level / np.array([1.0, 2.0, 3.0]))[[i, j]] * [units[x], units[y]]
            points = np.array(drawn[label].get_data())
            assert np.allclose(np.max(points, axis=1), half, rtol=1e-3)
            assert np.allclose(np.min(points, axis=1), -half, rtol=1e-3)
            largest = half
        for label, places in (("leaves the limits", left), ("does not converge", lost)):
            shown = drawn[f"initial condition that {label}"]
            assert np.allclose(shown.get_xdata(), places[:, i] * units[x])
            assert np.allclose(shown.get_ydata(), places[:, j] * units[y])
        corners = np.array(drawn["box of a critic's comparison"].get_data())
        box = np.array([2.0, 1.0, 0.5])[[i, j]] * [units[x], units[y]]
        assert np.allclose(np.max(corners, axis=1), box)
        view = np.array([axes.get_xlim(), axes.get_ylim()])
        for half, wide, (low, high) in zip(largest, box, view, strict=True):
            expected = 1.4 * 1.1 * half  # the margin of 5 % on each side
            if wide <= 4.0 * expected:
                expected = max(expected, 1.1 * wide)
            assert (-low, high) == pytest.approx((expected, expected), rel=2e-2)
        assert np.count_nonzero(rays) >= 2 * len(rays) - 4
        assert not np.any(np.delete(rays, [i, j], axis=1))
        ends = 2.0 * np.diag(T)[[i, j]]
        assert np.allclose(np.sum((rays[:, [i, j]] / ends) ** 2, axis=1), 1.0)
    _, _, last = figure.axes
    assert [axes.get_subplotspec().get_geometry()[:2] for axes in figure.axes] == [(1, 3)] * 3
    assert last.get_subplotspec().get_geometry()[2] == 2


def test_at_most_six_sections_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of five states, six of the ten pairs are shown, in rows of three."""
    monkeypatch.setattr("hfa_prove.picture._draw", lambda axes, *_: axes.plot(0.0, 0.0, label="a"))
    names = tuple("abcde")
    model = SimpleNamespace(units=lambda names: ["m"] * len(names), title="five")
    statement = SimpleNamespace(loop=SimpleNamespace(states=names, model=model))
    figure = region_figure(cast(Any, SimpleNamespace(statement=statement)))
    assert [axes.get_subplotspec().get_geometry()[:2] for axes in figure.axes] == [(2, 3)] * 6
    assert [(axes.get_xlabel()[0], axes.get_ylabel()[0]) for axes in figure.axes] == [
        *(("a", "b"), ("a", "c"), ("a", "d"), ("a", "e"), ("b", "c"), ("b", "d")),
    ]
