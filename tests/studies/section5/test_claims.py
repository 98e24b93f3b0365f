"""Claims follow their numbers; claims about the print are measured on the print, whatever is simulated."""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np
import pytest
from experiment_configurations import COARSE, changed

from controller import basis
from hfa_model import LINEAR_STATES, published_models
from studies.section5.claims import (
    CONFIRMED,
    NOT_CONFIRMED,
    NOT_DECIDABLE,
    Claim,
    Evidence,
    check_claim,
)
from studies.section5.configuration import section5_configuration
from studies.section5.experiment_flights import FlightPlan, FlightRecord, simulate_plan
from studies.section5.flown_laws import EXACT, INTEGRAL, Critic
from studies.section5.measures import worst
from studies.section5.reproduction import EXPERIMENTS
from studies.section5.setting import Setting, make_setting
from verification import solve_game

#: The subject of statements about the printed numbers themselves.
PRINT = "the print"
OF_THE_PRINT = [
    (section, claim) for section, one in EXPERIMENTS.items() for claim in one.claims if claim.laws == (PRINT,)
]


@cache
def setting_of(matrices: str) -> Setting:
    return make_setting(section5_configuration(), matrices)


def test_there_are_claims_about_the_print() -> None:
    assert {claim.number for _, claim in OF_THE_PRINT} == {"5.1-8", "5.1-16", "5.3-1"}


@pytest.mark.parametrize(("section", "claim"), OF_THE_PRINT, ids=lambda value: getattr(value, "number", value))
def test_claims_about_the_print_do_not_depend_on_flights(section: str, claim: Claim) -> None:
    one, other = (
        claim.measure(Evidence(setting_of(matrices), section, {}), PRINT) for matrices in ("regenerated", "printed")
    )
    assert one == other


def test_the_coupling_is_that_of_the_printed_rows() -> None:
    at_15, at_5 = published_models()
    row = LINEAR_STATES.index("pitch_rate")
    ratios = [np.linalg.norm(getattr(at_5, name)[row]) / np.linalg.norm(getattr(at_15, name)[row]) for name in "AB"]
    claim = next(claim for _, claim in OF_THE_PRINT if claim.number == "5.1-8")
    measured = claim.measure(Evidence(setting_of("regenerated"), "5.1", {}), PRINT)
    assert measured == pytest.approx(min(ratios), rel=1e-14)


def test_a_state_is_named_with_its_number() -> None:
    said = [re.search(r": z(\d) \((\w+)\)", claim.says) for one in EXPERIMENTS.values() for claim in one.claims]
    numbers = {found[2]: int(found[1]) for found in said if found}
    assert numbers == {name: 1 + LINEAR_STATES.index(name) for name in numbers}
    assert len(numbers) == 3


def test_the_quoted_eigenvalues_are_those_of_the_printed_matrix_but_for_the_slow_pair() -> None:
    claim = next(claim for _, claim in OF_THE_PRINT if claim.number == "5.3-1")
    eigenvalues = np.linalg.eigvals(published_models()[1].A)
    slow = min(eigenvalues[eigenvalues.imag > 0.0], key=abs)
    measured = claim.measure(Evidence(setting_of("regenerated"), "5.3", {}), PRINT)
    assert measured == pytest.approx(np.hypot(abs(slow.real) - 0.016, slow.imag - 0.64), rel=1e-9)


def evidence_of(setting: Setting, section: str, *records: FlightRecord) -> Evidence:
    return Evidence(setting, section, {record.plan: record for record in records})


def test_the_gain_that_integral_learning_ends_with_is_its_last() -> None:
    setting = setting_of("regenerated")
    game = setting.case(5.0).game
    P, functions = solve_game(game).P, basis("quadratic", len(LINEAR_STATES))
    weights = np.array([0.0, 0.5, 1.0])[:, None] * functions.weights(P)
    plan, nothing = FlightPlan(5.0, INTEGRAL), np.zeros((1, 6))
    critic = Critic(functions, weights, np.zeros(3), {})
    record = FlightRecord(plan, np.zeros(1), *[nothing] * 4, critic, np.zeros(1), 0.0, np.inf, None, nothing)  # type: ignore[arg-type]
    (claim,) = [each for each in EXPERIMENTS["5.2"].claims if each.number == "5.2-13"]
    expected = np.linalg.eigvals(game.A - game.B @ game.gain(P)).real.max()
    assert claim.measure(evidence_of(setting, "5.2", record), INTEGRAL) == pytest.approx(expected, rel=1e-9)


def always(number: float) -> Any:
    return lambda evidence, law: number


def claim_on(plan: FlightPlan, relation: str, limit: float | str, **changes: Any) -> Claim:
    measure = worst(lambda setting, law: (plan,), lambda metrics: metrics.relative_error, of=("speed",))
    return Claim("0", "s", "w", measure, relation, limit, (plan.law,), plan.law, **changes)


@pytest.mark.parametrize("relation", ["<=", ">=", "<", ">"])
def test_a_claim_about_an_unstable_flight_is_not_confirmed(relation: str) -> None:
    """A plant of the opposite sign is unstable under the exact gain; its error is beyond every limit."""
    setting = make_setting(changed(COARSE))
    plan = FlightPlan(15.0, EXACT, uncertainty=-6.0)
    record = simulate_plan(setting, plan, "5.1")
    assert not record.held
    found = check_claim(claim_on(plan, relation, "close"), evidence_of(setting, "5.1", record))
    assert found.verdict == NOT_CONFIRMED
    assert not found.checks[EXACT].ok
    assert "lost at" in found.reason
    assert found.to_dict()["findings"][EXACT]["value"] is None


def test_a_claim_follows_its_number() -> None:
    setting = make_setting(changed(COARSE))
    plan = FlightPlan(15.0, EXACT)
    evidence = evidence_of(setting, "5.1", simulate_plan(setting, plan, "5.1"))
    value = evidence.record(plan).metrics.relative_error["speed"]
    verdicts = [check_claim(claim_on(plan, "<=", limit), evidence).verdict for limit in (1.01 * value, 0.99 * value)]
    assert verdicts == [CONFIRMED, NOT_CONFIRMED]
    assert check_claim(claim_on(plan, "<=", 1.01 * value, missing="a limit"), evidence).verdict == NOT_DECIDABLE
    named = check_claim(claim_on(plan, "<=", "close"), evidence)
    assert named.limit == section5_configuration().criteria.close


def test_a_number_that_is_none_confirms_nothing() -> None:
    claim = Claim("0", "s", "w", always(np.nan), "<=", 1.0, (PRINT,), PRINT)
    assert check_claim(claim, Evidence(setting_of("regenerated"), "5.1", {})).verdict == NOT_CONFIRMED
