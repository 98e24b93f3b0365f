"""Integration error of simulations, from half the step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hfa_aircraft.march.march import Rows, march
from hfa_aircraft.march.refinement import RESOLVED, resolved


def swing(parts: int, step: float = 0.5) -> float:
    """Return the largest x of x'' = -sin x from x = 0 and x' = 1.9, in Runge-Kutta steps."""
    loop = Rows(
        lambda x, _: np.column_stack([x[:, 1], -np.sin(x[:, 0])]),
        np.array([[0.0, 1.9]]),
        step / parts,
    )
    return float(march(loop, 40 * parts)[0].states[0, ::parts, 0].max())


@pytest.mark.parametrize("step", [0.05, 0.5, 1.0])
def test_the_step_is_halved_until_the_figures_hardly_change(step: float) -> None:
    """The stated change is that between the returned simulation and one with half its step."""
    flown, error = resolved(
        lambda parts: swing(parts, step), lambda x: {"the largest x": (x, 0.0)}, step
    )
    parts = round(step / error.step)
    assert error.change == pytest.approx(abs(swing(2 * parts, step) / flown - 1.0), rel=1e-2)
    assert flown == swing(parts, step)
    assert error.is_resolved
    assert (parts == 1) == (step == 0.05)
    if parts > 1:
        coarser = swing(parts // 2, step)
        assert abs(coarser - flown) > RESOLVED * flown


def test_figures_that_do_not_settle_are_named() -> None:
    """A figure that doubles with each half of the step ends at an eighth of the step."""
    flown, error = resolved(lambda parts: parts, lambda x: {"a": (1.0, 0.0), "b": (x, 0.0)}, 1.0)
    assert (flown, error.step, error.figure) == (4, 0.25, "b")
    assert error.change == pytest.approx(0.5)
    assert (
        error.text() == "Not resolved: with half the integration step of 250 ms, b changes by 50 %."
    )


def test_a_figure_of_one_simulation_alone_is_not_resolved() -> None:
    _, error = resolved(
        lambda parts: parts, lambda x: {"the departure": (1.0, 0.0)} if x in (2, 8) else {}, 1.0
    )
    assert not error.is_resolved
    assert math.isinf(error.change)
    assert error.figure == "the departure"
    assert "is another" in error.text()


def test_changes_of_small_figures_are_relative_to_the_least() -> None:
    _, error = resolved(lambda parts: 1e-9 * parts, lambda x: {"a": (x, 1e-3)}, 1.0)
    assert error.change == pytest.approx(1e-6)
    _, none = resolved(lambda parts: 0.0, lambda x: {"a": (x, 1e-3)}, 1.0)
    assert none.figure == ""
    assert none.is_resolved
