"""The study of trained policies: its deployments, its counts and its stored results."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

from studies.gap.__main__ import rows_of
from studies.gap.judging import SEED, STARTS, Outcome, flight_results, summary
from studies.gap.tasks import TASKS, deployment_of
from studies.gap.training import BUDGETS, Run

pytestmark = pytest.mark.slow

STORED = ROOT / "studies" / "gap" / "results" / "gap.json"


def test_actions_stay_within_the_nearer_limit() -> None:
    """At the ends of the action range, all inputs are within the limits, and one end is at a
    limit.
    """
    point = TASKS[1].point()
    deployment = deployment_of(point)
    inputs = point.model.inputs
    for name, entry in deployment.action.items():
        trim = float(getattr(point.inputs, name))
        ends = [eval(entry["map"], {"trim": trim, "a": a}) for a in (-1.0, 1.0)]
        signal = inputs[name]
        assert signal.min <= min(ends) + 1e-12
        assert max(ends) <= signal.max + 1e-12
        assert min(ends) == pytest.approx(signal.min) or max(ends) == pytest.approx(signal.max)


def test_a_departed_flight_is_not_counted_as_staying() -> None:
    """A flight that leaves the envelope is not counted as staying. It is excluded from the cost
    ratios.

    A flight from an initial condition without a best flight is compared only with the LQR.
    """
    column = [
        Outcome(stays=True, converges=True, cost=2.0),
        Outcome(stays=False, converges=False, cost=9.0),
        Outcome(stays=True, converges=False, cost=6.0),
    ]
    lqr = [Outcome(stays=True, converges=True, cost=1.0)] * 3
    counted = summary(column, [0.5, 0.5, None], lqr)
    assert counted["stay"] == 2
    assert counted["end_at_trim"] == 1
    assert counted["over_best"] == {"median": 4.0, "worst": 4.0}
    assert counted["over_lqr"] == {"median": 4.0, "worst": 6.0}


def test_incomplete_training_is_not_finished(tmp_path: Path) -> None:
    """A training run does not count as finished if its policy is missing or its record is not
    valid.
    """
    run = Run(TASKS[0], "PPO", 1, tmp_path)
    assert run.trained() is None
    run.policy.write_bytes(b"")
    run.record.write_text("{}")
    assert run.trained() is None


def test_stored_results_contain_every_aircraft() -> None:
    """The stored results contain every aircraft and algorithm, with consistent counts."""
    data = json.loads(STORED.read_text(encoding="utf-8"))
    assert [one["aircraft"] for one in data["aircraft"]] == [task.name for task in TASKS]
    for one in data["aircraft"]:
        assert one["starts"] == STARTS
        assert one["found"] + sum(one["refused"].values()) == STARTS
        assert {each["algorithm"] for each in one["policies"]} == set(BUDGETS)
        assert all(0 <= each["end_at_trim"] <= each["stay"] <= STARTS for each in one["policies"])
        assert len(rows_of(one)) == 1 + len(BUDGETS)
    assert max(each["seed"] for one in data["aircraft"] for each in one["policies"]) < SEED


def test_new_lqr_simulations_give_the_stored_costs() -> None:
    """New simulations of the LQR on the pendulum give the stored cost ratios."""
    data = json.loads(STORED.read_text(encoding="utf-8"))
    again = flight_results(TASKS[0], [])
    stored = data["aircraft"][0]
    assert again["found"] == stored["found"]
    for which in ("median", "worst"):
        np.testing.assert_allclose(
            again["lqr"]["over_best"][which], stored["lqr"]["over_best"][which], rtol=1e-3
        )
