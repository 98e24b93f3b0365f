"""Integration error of the flights of `assess`."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from policy_cases import aircraft, gtm_deployment, stored_deployment, trims

from hfa_aircraft.march.refinement import RESOLVED, IntegrationError
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_policy.assess import assess
from hfa_policy.assessment import Assessment
from hfa_policy.assessor import Assessor
from hfa_policy.recorded_flights import recorded_flights, resolved_flight


@pytest.mark.parametrize("dt", [0.02, 0.5])
def test_the_steps_of_a_sample_are_halved_until_flights_are_resolved(dt):
    """With the returned steps, deviations agree with those of four times as many.

    With one integration step a sample of 0.5 s, they are wrong by more than 0.1 %.
    """
    o = ca.SX.sym("o", 4)
    weak = ca.Function("policy", [o], [ca.vertcat(0.0 * o[0], 0.0 * o[1])])
    deployed = Deployed(gtm_deployment({"file": weak}, timing={"dt": dt}), aircraft("ppo_gtm"))
    assessor = Assessor(deployed, trims("ppo_gtm")[1:2])
    flight = assessor.flight()
    places = assessor.places(flight)
    found, error = resolved_flight(flight, places, 3)
    assert error.is_resolved
    assert error.step == dt / found.parts

    def largest(parts):
        flown = recorded_flights(replace(flight, parts=parts), places, 3, 2)
        trim = flown.trims[:, None, : flown.states.shape[2]]
        away = np.maximum(flown.highest - trim, trim - flown.lowest)
        return np.where(flown.inside[:, :, None], away, 0.0).max(axis=(0, 1))

    np.testing.assert_allclose(largest(found.parts), largest(4 * found.parts), rtol=2.0 * RESOLVED)
    if dt == 0.5:
        assert (np.abs(largest(1) / largest(found.parts) - 1.0) > RESOLVED).any()


def test_an_assessment_states_the_integration_error():
    """The error is in the report and in the data, and a finding if flights are not resolved."""
    points = trims("ppo_gtm")[1:2]
    found = assess(aircraft("ppo_gtm"), stored_deployment("ppo_gtm"), points, samples=1, best=0)
    (point,) = found.points
    assert point.integration.is_resolved
    assert point.integration.text() in " ".join(str(found.report()).split())
    assert found.as_data()["points"][0]["integration"]["step"] <= 0.02
    wrong = IntegrationError(0.02, 0.4, "the largest deviation of pitch")
    coarse = Assessment(found.deployed, (replace(point, integration=wrong),))
    assert wrong.text() in [finding.text for finding in coarse.findings]
    assert wrong.text() in " ".join(str(coarse.report()).split())
