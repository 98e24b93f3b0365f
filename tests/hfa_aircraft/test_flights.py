"""The stated error of simulations with fixed steps."""

import pytest

from hfa_aircraft.batch_simulation import ReportedFigure, resolved


def test_the_integration_error_is_the_change_with_half_the_step():
    """The step is divided into 1, 2, 4, ... parts until halving changes the figure by at most 0.1 %.

    The figure 1 + 4e-3 / parts is 1.004, 1.002, 1.001: from 1 to 2 parts it changes by 0.2 %, and
    from 2 to 4 by 0.1 %. The figure 1 / parts, which halves at each halving, is not resolved.
    """

    def figures(value):
        return {"it": ReportedFigure(value)}

    flown, error = resolved(lambda parts: 1.0 + 4e-3 / parts, figures, step=0.2)
    assert flown == 1.002
    assert error.step == 0.1
    assert error.change == pytest.approx(0.001 / 1.001, rel=1e-9)
    assert error.is_resolved
    _, coarse = resolved(lambda parts: 1.0 / parts, figures, step=0.2)
    assert not coarse.is_resolved
    assert coarse.change == pytest.approx(1.0)
