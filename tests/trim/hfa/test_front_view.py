"""The front view of the HFA at a trim, compared with the computed loads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known_models import model_at
from units_of_outputs import assert_no_feet

import hfa_model
from hfa import Model
from trim import trim_figure
from trim.hfa.front_view import panels_from_the_front


@pytest.mark.parametrize("degrees", [-20.0, 0.0, 30.0])
def test_lift_is_normal_to_panels_and_balances_weight(
    published_aircraft: Model, degrees: float
) -> None:
    """Each lift is normal to its panel, the lifts balance the weight, and arrows are to scale.

    The hinge moments are printed.
    """
    point = model_at(degrees).point
    panels = panels_from_the_front(published_aircraft, point)
    loads = hfa_model.loads(published_aircraft, point.states, point.inputs)
    for panel, lift in zip(
        panels, (loads.outer.lift, loads.center.lift, loads.outer.lift), strict=True
    ):
        assert np.linalg.norm(panel.lift) == pytest.approx(lift)
        assert panel.lift @ (panel.ends[1] - panel.ends[0]) == pytest.approx(0.0, abs=1e-9)
    lift, weight = (sum(getattr(panel, name) for panel in panels) for name in ("lift", "weight"))
    # The difference from the weight is due to the tilt of the lift by alpha, drag and thrust: a few
    # thousandths.
    np.testing.assert_allclose(lift, -weight, rtol=5e-3, atol=1e-9)
    axes = trim_figure(published_aircraft, point).axes[0]
    lines = [line.get_xydata() for line in axes.lines if line.get_linewidth() == 4.0]
    np.testing.assert_array_equal(lines, [panel.ends for panel in panels])
    drawn = [
        np.subtract(text.xy, text.xyann) for text in axes.texts if text.arrow_patch is not None
    ]
    forces = [force for panel in panels for force in (panel.lift, panel.weight)]
    scale = np.linalg.norm(drawn[0]) / np.linalg.norm(forces[0])
    np.testing.assert_allclose(drawn, np.array(forces) * scale, atol=1e-9)
    assert f"{1 / scale:.3g} lbf per foot" in axes.get_title()
    sense = "up" if loads.hinge_moment > 0.0 else "down"
    label = f"{abs(loads.hinge_moment):.1f} ft lbf, tips {sense}" if degrees else "0.0 ft lbf"
    assert [text.get_text() for text in axes.texts].count(label) == 2


def test_si_text_and_pictures_contain_no_feet(tmp_path: Path) -> None:
    """`hfa trim --units si --picture` prints and draws no English unit."""
    assert_no_feet("trim", "--dihedral", "12", folder=tmp_path)
