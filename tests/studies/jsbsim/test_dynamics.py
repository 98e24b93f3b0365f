"""A, B and thrust of models read from JSBSim files, compared with JSBSim."""

from __future__ import annotations

import pytest

pytest.importorskip("jsbsim")

from studies.jsbsim.dynamics import slopes, thrust_miss, trimmed


@pytest.mark.slow
def test_slopes_and_thrust_agree_with_jsbsim() -> None:
    """For the T38, 67 of 72 entries of A and B agree within 1e-6, and the thrust within 1e-12.

    At four others the equations have a kink, where JSBSim's differences are means of both sides.
    """
    model, point = trimmed("T38")
    agree, entries, _ = slopes("T38", model, point)
    assert (agree, entries) == (67, 72)
    assert thrust_miss("T38", model, point) < 1e-12


@pytest.mark.slow
def test_other_fuel_changes_the_linear_model() -> None:
    """With half of the fuel in one tank, more than ten entries of A and B differ from JSBSim's."""
    model, _ = trimmed("T38")
    fuel = dict(zip(model.parameters, model.p, strict=True))["tank0"]
    lighter, point = trimmed("T38", tank0=0.5 * fuel)
    agree, entries, _ = slopes("T38", lighter, point)
    assert entries - agree > 10
