"""Plans: when they are the same, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from member_plans import EVERYTHING, PARAMETERS, with_scenario

from controller import MonteCarlo, OneMinusCosine, Uncertainty, flight_envelope, gain_law
from controller.policy.signals import zero
from hfa_support import BadInputError
from studies.section5.critic_policy import critic_law


def test_plans_are_equal_when_they_give_the_same_results(plan: MonteCarlo, gain: np.ndarray, critic) -> None:
    assert replace(plan) == plan
    assert hash(replace(plan)) == hash(plan)
    others = [
        replace(plan, seed=8),
        replace(plan, plant="linear"),
        replace(plan, law=gain_law("exact", 1.01 * gain)),
        replace(plan, law=critic_law("published", critic)),
        with_scenario(plan, uncertainty=replace(EVERYTHING, turbulence=None)),
        with_scenario(plan, uncertainty=replace(EVERYTHING, errors=dict(reversed(EVERYTHING.errors.items())))),
        with_scenario(plan, step=0.0005),
        with_scenario(plan, reference=zero(6)),
        with_scenario(plan, gust=OneMinusCosine(100.0, 1.0, 68.0), uncertainty=replace(EVERYTHING, turbulence=None)),
        replace(plan, envelope=flight_envelope(PARAMETERS, plan.point, {"alpha": (-0.1, 0.2)})),
    ]
    assert len({plan, *others}) == 1 + len(others)


def test_an_error_of_nothing_is_refused(plan: MonteCarlo, gain: np.ndarray) -> None:
    no_moment = PARAMETERS._replace(zero_lift_moment=0.0)
    with pytest.raises(BadInputError, match="does nothing"):
        replace(with_scenario(plan, uncertainty=Uncertainty({"zero_lift_moment": 1.0})), parameters=no_moment)
    with pytest.raises(BadInputError, match="5 x 6"):
        gain_law("wide", np.zeros((6, 5)))


def test_what_a_monte_carlo_cannot_repeat_is_refused(plan: MonteCarlo) -> None:
    class Spike:
        size = 6

        def at(self, t: Any) -> Any:
            return np.zeros(6)

    with pytest.raises(BadInputError, match="the noise of a Monte Carlo must be a Signal"):
        with_scenario(plan, noise=Spike())
    with pytest.raises(BadInputError, match="drawn already"):
        replace(plan, scenario=plan.member(0))
