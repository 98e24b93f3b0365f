"""The front view of the HFA at a trim, compared with the computed loads."""

import numpy as np
import pytest
from known_models import model_at

import hfa_model
from trim import trim_figure


@pytest.mark.parametrize("degrees", [-20.0, 0.0])
def test_lift_is_normal_to_panels_and_balances_weight(published_aircraft, degrees):
    """In the front view of a trim, each arrow of lift is normal to its panel, and the lifts balance the
    weights. Arrows have the scale of the title; both hinges are labeled with the hinge moment.
    """
    point = model_at(degrees).point
    loads = hfa_model.loads(published_aircraft, point.states, point.inputs)
    p = hfa_model.parameters_of(published_aircraft)
    axes = trim_figure(point).axes[0]
    panels = [line.get_xydata() for line in axes.lines if line.get_linewidth() == 4.0]
    arrows = np.array(
        [np.subtract(text.xy, text.xyann) for text in axes.texts if text.arrow_patch is not None]
    )
    lifts, weights = arrows[::2], arrows[1::2]  # drawn panel by panel: its lift, then its weight
    scale = np.linalg.norm(lifts[0]) / loads.outer.lift
    for (left, right), lift, weight, size in zip(
        panels,
        lifts,
        weights,
        (loads.outer.lift, loads.center.lift, loads.outer.lift),
        strict=True,
    ):
        assert np.linalg.norm(lift) == pytest.approx(scale * size)
        assert lift @ (right - left) == pytest.approx(0.0, abs=1e-9 * scale)
        np.testing.assert_allclose(weight, [0.0, -scale * p.panel_mass * p.gravity], atol=1e-9)
    # The difference from the weight is due to the tilt of the lift by alpha, drag and thrust: a few
    # thousandths.
    np.testing.assert_allclose(lifts.sum(axis=0), -weights.sum(axis=0), rtol=5e-3, atol=1e-9)
    assert f"{1 / scale:.3g} lbf per foot" in axes.get_title()
    sense = "up" if loads.hinge_moment > 0.0 else "down"
    label = f"{abs(loads.hinge_moment):.1f} ft lbf, tips {sense}" if degrees else "0.0 ft lbf"
    assert [text.get_text() for text in axes.texts].count(label) == 2
