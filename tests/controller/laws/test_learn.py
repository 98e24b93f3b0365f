"""One entry to all laws: the same bits from the same seed, plain results, samples enough for any plant, refusals."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from learning_samples import published
from reference_riccati import reference_solution, relative_error

from controller import Game, learn
from controller.game.learning_result import LearningResult
from controller.laws import certify
from hfa_model import INPUTS, LINEAR_STATES
from hfa_model.vectors import LINEAR_UNITS
from hfa_support import BadInputError


def short_run(seed: int = 4, **more: Any) -> LearningResult:
    return learn(published("published-5")[0], seed=seed, tick=0.1, predefined_time=8.0, **more)


def test_progress_rises_to_one_and_nothing_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    seen: list[tuple[float, str]] = []
    short_run(progress=lambda fraction, _, message: seen.append((fraction, message)))
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert 5 <= len(fractions) <= 100
    assert fractions[-1] == 1.0
    assert all("t = " in message and "residual" in message and "\n" not in message for _, message in seen)
    assert capsys.readouterr() == ("", "")


def test_the_seed_decides_every_bit() -> None:
    one, same, other = short_run(), short_run(), short_run(seed=2)
    for name in ("times", "weights", "residual_norm", "law_residual_norm", "P", "K"):
        assert getattr(one, name).tobytes() == getattr(same, name).tobytes(), name
    assert one.to_dict() == same.to_dict()
    assert one.weights.tobytes() != other.weights.tobytes()


def test_results_are_plain_json() -> None:
    result = short_run()
    plain = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert plain["law"] == "certified"
    assert plain["status"] == result.outcome
    assert np.array_equal(np.array(plain["P"]), result.P)
    assert plain["settings"]["basis"] == "quadratic"
    assert [row["ok"] for row in plain["certificates"]] == [row.ok for row in result.certificates]
    assert plain["excitation"]["rank"] == 21
    units = result.report(LINEAR_STATES, INPUTS, state_units=LINEAR_UNITS).data["weight_units"]
    assert (len(units), units[:2]) == (21, ["1/((ft/s) (ft/s))", "1/((ft/s) (rad))"])


def test_the_samples_taken_by_default_are_enough_for_the_plant() -> None:
    """A stable chain of ten states with an input and a disturbance at its end: 55 weights."""
    A, end = np.diag(-np.linspace(0.5, 5.0, 10)) + np.diag(np.ones(9), 1), np.eye(10)[:, -1:]
    game = Game(A=A, B=end, E=end, Q=np.eye(10), R=np.eye(1), delta=50.0)
    result = learn(game, tick=0.1)
    assert result.converged
    assert relative_error(result.P, reference_solution(game).P) < 1e-9
    assert (result.settings["samples"], result.settings["pool_samples"]) == (83, 500)
    with pytest.raises(BadInputError, match="54 samples cannot determine 55 weights"):
        learn(game, samples=54)


def test_rows_are_kept_evenly_with_the_start_and_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    every = short_run()
    assert every.times == pytest.approx(0.1 * np.arange(81))
    monkeypatch.setattr(certify, "MOST_ROWS", 30)
    kept, rows = short_run(), [*range(0, 80, 3), 80]
    assert np.array_equal(kept.times, every.times[rows])
    assert np.array_equal(kept.weights, every.weights[rows])
