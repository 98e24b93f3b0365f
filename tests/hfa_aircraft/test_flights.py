"""The stated error of simulations with fixed steps."""

import pytest

from hfa_aircraft.batch_simulation import ReportedFigure, resolved


def test_the_stated_change_is_that_with_half_the_step():
    """The step of a figure 1 + 4e-3 / parts is halved until it changes by at most 0.1 %.

    A figure 1 / parts, which always changes by its own size, is not resolved.
    """
    flown, error = resolved(
        lambda parts: 1.0 + 4e-3 / parts, lambda value: {"it": ReportedFigure(value)}, step=0.2
    )
    assert flown == 1.002
    assert error.step == 0.1
    assert error.change == pytest.approx(0.001 / 1.001, rel=1e-9)  # from 2 to 4 parts
    assert error.is_resolved
    _, coarse = resolved(
        lambda parts: 1.0 / parts, lambda value: {"it": ReportedFigure(value)}, step=0.2
    )
    assert not coarse.is_resolved
    assert coarse.change == pytest.approx(1.0)
