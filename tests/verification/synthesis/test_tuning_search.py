"""A search begins with its design, makes as many evaluations as it is asked for, and finds what chance does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo_cases import write_tuning

from hfa_model import Aircraft
from verification.synthesis import tuning_search
from verification.synthesis.design_evaluation import LOST, DesignEvaluation
from verification.synthesis.tuning import Evaluation, Tuning, Variable
from verification.synthesis.tuning_file import load_tuning

Cost = Callable[[np.ndarray], float]


@pytest.fixture
def searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, published_aircraft: Aircraft
) -> Callable[..., list[float]]:
    """The costs that a search over many variables sees, of a cost of its own that ends early as an evaluation does."""

    def costs(cost: Cost, variables: int, evaluations: int, seed: int) -> list[float]:
        def at(_: object, values: np.ndarray, below: float) -> Evaluation:
            whole = cost(values)
            return Evaluation(whole if whole <= below else np.nextafter(below, np.inf), -1.0)

        monkeypatch.setattr(tuning_search.DesignEvaluation, "at", at)
        record = tmp_path / f"{seed}.record"
        found = tuning_search.tune(published_aircraft, many(tmp_path, variables, evaluations, seed), record)
        assert found.best_evaluation.cost == cost(found.best) == min(each.cost for each in found.seen)
        return [each.cost for each in found.seen]

    return costs


def many(folder: Path, count: int, evaluations: int, seed: int) -> Tuning:
    """The same entry under many names: only their numbers matter here."""
    tuning = load_tuning(str(write_tuning(folder)))
    variables = tuple(Variable(f"v{k}", tuning.variables[0].entries, 1e-3, 1e5) for k in range(count))
    return replace(tuning, variables=variables, evaluations=evaluations, seed=seed)


@pytest.mark.parametrize("asked", [1, 5, 12, 40])
def test_it_makes_as_many_evaluations_as_asked_and_begins_with_the_design(
    asked: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, published_aircraft: Aircraft
) -> None:
    monkeypatch.setattr(
        tuning_search.DesignEvaluation,
        "at",
        lambda _, values, below: Evaluation(float(np.log(values / 60.0) @ values), -1.0),
    )
    tuning = load_tuning(str(write_tuning(tmp_path, evaluations=asked)))
    found = tuning_search.tune(published_aircraft, tuning, tmp_path / "record")
    assert len(found.seen) == asked
    first = tuning.first_values()
    np.testing.assert_array_equal(found.first, first)
    assert found.seen[0] == found.first_evaluation
    assert found.first_evaluation.cost == pytest.approx(np.log(first / 60.0) @ first, rel=1e-12)
    assert found.best_evaluation.cost == min(each.cost for each in found.seen)


def narrow(values: np.ndarray) -> float:
    """A bent valley, 1 at its end, behind a step: most of the box is lost."""
    x = np.log(values / 7.0)
    cost = 1.0 + float(np.sum(3.0 * (x[1:] - 0.3 * x[:-1] ** 2) ** 2) + np.sum(x**2))
    return cost if cost < 2000.0 else LOST + cost


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_of_many_variables_it_finds_the_least_cost(searched: Callable[..., list[float]], seed: int) -> None:
    costs = searched(narrow, 12, 600, seed)
    assert costs[0] > 60.0
    assert min(costs) < 1.3


def test_it_is_better_than_chance_on_a_design(tmp_path: Path, published_aircraft: Aircraft) -> None:
    """From a design with an unstable corner: as many designs at random cost more than what the search finds."""
    tuning = load_tuning(str(write_tuning(tmp_path)))
    weights = {name: f"weights.states.{name}" for name in ("dihedral", "dihedral_integral", "pitch_rate", "alpha")}
    noises = {name: f"sensors.{name}" for name in ("pitch_rate", "dihedral_integral")}
    variables = tuple(Variable(entry, (entry,), 1e-6, 1e5) for entry in (*weights.values(), *noises.values()))
    tuning = replace(tuning, variables=(*tuning.variables, *variables), evaluations=40, abscissa=-0.1)
    found = tuning_search.tune(published_aircraft, tuning, tmp_path / "record")
    evaluation, chance = DesignEvaluation(published_aircraft, tuning), np.random.default_rng(7)
    lows, highs = np.log([(each.low, each.high) for each in tuning.variables]).T
    random = min(evaluation.at(np.exp(chance.uniform(lows, highs))).cost for _ in range(tuning.evaluations))
    assert found.best_evaluation.cost < min(found.first_evaluation.cost, random)
    assert evaluation.at(found.best) == found.best_evaluation


def test_more_evaluations_go_on_where_fewer_ended(tmp_path: Path, published_aircraft: Aircraft) -> None:
    record, told = tmp_path / "record", []
    for asked in (6, 15):
        tuning = load_tuning(str(write_tuning(tmp_path, evaluations=asked)))
        found = tuning_search.tune(published_aircraft, tuning, record, lambda *each: told.append(each))
        assert len(record.read_text(encoding="utf-8").splitlines()) - 1 <= asked
    again = tuning_search.tune(published_aircraft, tuning, tmp_path / "again")
    assert again.seen == found.seen
    assert (tmp_path / "again").read_bytes() == record.read_bytes()
    assert told == [(k, 6) for k in range(1, 7)] + [(k, 15) for k in range(1, 16)]
