"""The stated error of simulations with fixed steps."""

import pytest

from hfa_aircraft.batch_simulation import ReportedFigure, resolved


def test_the_integration_error_is_the_change_with_half_the_step():
    """The step is divided into 1, 2, 4, ... parts until halving it changes the figure by at most 0.1 %; this
    change is the error. The flight is replaced by a figure that is a function of the parts.

    1 + 4e-3 / parts is 1.004, 1.002, 1.001: 2 parts suffice, as 4 parts change it by 0.1 %. 1 / parts,
    which halves each time, is not resolved.
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
