"""The aircraft from the front: where its panels are, and that the arrows are the loads, to one scale."""

from __future__ import annotations

import numpy as np
import pytest
from known_models import model_at

from hfa_model import Aircraft
from trim import OperatingPoint, trim_figure
from trim.point.hfa_report import panels_from_the_front


def test_the_lift_stands_across_each_panel_and_carries_the_weight(
    published_aircraft: Aircraft, point: OperatingPoint
) -> None:
    panels = panels_from_the_front(published_aircraft, point)
    loads = published_aircraft.loads(point.states, point.inputs)
    for panel, lift in zip(panels, (loads.outer.lift, loads.center.lift, loads.outer.lift), strict=True):
        assert np.linalg.norm(panel.lift) == pytest.approx(lift)
        assert panel.lift @ (panel.ends[1] - panel.ends[0]) == pytest.approx(0.0, abs=1e-9)
    lift, weight = (sum(getattr(panel, name) for panel in panels) for name in ("lift", "weight"))
    # What is missing to the whole weight is the lift's tilt by alpha, drag and thrust: a few thousandths.
    np.testing.assert_allclose(lift, -weight, rtol=5e-3, atol=1e-9)


@pytest.mark.parametrize("degrees", [-20.0, 0.0, 30.0])
def test_arrows_are_to_scale(published_aircraft: Aircraft, degrees: float) -> None:
    point = model_at(degrees).point
    panels = panels_from_the_front(published_aircraft, point)
    axes = trim_figure(published_aircraft, point).axes[0]
    drawn = [np.subtract(each.xy, each.xyann) for each in axes.texts if each.arrow_patch is not None]
    forces = [force for panel in panels for force in (panel.lift, panel.weight)]
    scale = np.linalg.norm(drawn[0]) / np.linalg.norm(forces[0])
    np.testing.assert_allclose(drawn, np.array(forces) * scale, atol=1e-9)
    assert f"{1 / scale:.3g} lbf to the foot" in axes.get_title()
    moment = published_aircraft.loads(point.states, point.inputs).hinge_moment
    label = f"{moment:.1f} ft lbf" if degrees else "0.0 ft lbf"
    assert [each.get_text() for each in axes.texts].count(label) == 2
