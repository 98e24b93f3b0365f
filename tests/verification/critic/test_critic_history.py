"""Critics over time: planted histories whose settling is known."""

from __future__ import annotations

import numpy as np
import pytest
from planted_critics import weights_of

from controller import Game, History, basis, learn
from hfa_support import BadInputError
from verification import check_history, solve_game
from verification.critic.check_result import CriticCheck, check_figure

NAMES = ("x",) * 6, ("u",) * 5
TIMES = 0.25 * np.arange(41)


def planted(game: Game, sizes: np.ndarray, of: str = "W") -> History:
    """The exact critic times 1 + sizes at each time."""
    exact = solve_game(game)
    value = {"W": weights_of(exact.P), "P": exact.P, "K": exact.K}[of]
    return History(TIMES, **{of: np.multiply.outer(1.0 + sizes, value)})


def row_of(check: CriticCheck, name: str) -> tuple[float, bool]:
    row = next(row for row in check.checks if row.name == name)
    return row.value, row.ok


@pytest.mark.parametrize("of", ["W", "P", "K"])
def test_a_history_that_settles_in_time_passes_and_late_fails(game: Game, of: str) -> None:
    history = planted(game, np.where(TIMES < 4.1, 0.1, 1e-9), of)
    for predefined_time, ok in ((4.25, True), (4.0, False)):
        check = check_history(game, history, predefined_time=predefined_time)
        assert check.history is not None
        assert row_of(check, "settling_time") == (4.25, ok)
        assert check.ok == ok
        assert [row.name for row in check.checks if not row.ok] == ([] if ok else ["settling_time"])
        assert check.history.to_dict()["predefined_time_kept"] == ok
    assert check.history.errors["K_rel_error"] == pytest.approx(np.where(TIMES < 4.1, 0.1, 1e-9), rel=1e-4)
    assert np.isnan(check.history.errors["P_rel_error"]).all() == (of == "K")
    assert "stays within 1e-06 from 4.25 s on; T_w is 4 s" in check.report().text()


def test_a_history_that_leaves_the_band_again_settles_after_that(game: Game) -> None:
    sizes = np.where(TIMES < 2.0, 1.0, 1e-10)
    sizes[TIMES == 7.5] = 1e-3
    check = check_history(game, planted(game, sizes), predefined_time=5.0)
    assert check.history is not None
    assert row_of(check, "settling_time") == (7.75, False)


def test_a_history_that_ends_wrong_never_settles(game: Game) -> None:
    sizes = np.full(len(TIMES), 1e-10)
    sizes[-1] = 1e-2
    check = check_history(game, planted(game, sizes))
    assert check.history is not None
    assert not check.ok
    data = check.report().data["history"]
    assert (data["settling_time"], data["predefined_time_kept"]) == (None, None)
    assert "settling_time" not in [row.name for row in check.checks]


def test_an_error_beyond_the_quadratic_weights_counts(game: Game) -> None:
    """P and K are exact throughout; V is not until 5 s."""
    functions = basis("quadratic+quartic", 6)
    weights = np.tile(functions.weights(solve_game(game).P), (len(TIMES), 1))
    weights[TIMES < 5.0, -1] = 1e6
    check = check_history(game, History(TIMES, W=weights, basis=functions.name))
    assert check.history is not None
    assert check.history.errors["P_rel_error"].max() < 1e-12
    assert check.history.settling_time == 5.0
    assert check.ok


def test_a_run_of_our_own_is_a_history_that_keeps_its_time(game: Game) -> None:
    """The judge of histories and the judge of runs agree on when the law settles."""
    result = learn(game, predefined_time=2.0, tick=0.05)
    told: list[tuple[int, int]] = []
    history = History(result.times, W=result.weights, K=result.K)
    check = check_history(game, history, predefined_time=2.0, progress=lambda *now: told.append(now))
    assert check.ok
    assert check.history is not None
    assert check.history.settling_time == pytest.approx(result.settling_time)
    assert told[-1] == (41, 41)
    figure = check_figure(check, *NAMES)
    assert [line.get_label() for line in figure.axes[-1].lines[:2]] == ["limit 1e-06", "error of P"]
    assert figure.axes[-1].get_ylim()[0] == 1e-17
    assert len(check.report().records.rows) == 41


def test_the_last_row_is_judged_with_the_gain_that_belongs_to_it(game: Game) -> None:
    exact = solve_game(game)
    history = History(TIMES, W=np.tile(weights_of(exact.P), (len(TIMES), 1)), K=1.01 * exact.K)
    assert not check_history(game, history).ok


def test_rows_of_another_length_are_refused(game: Game) -> None:
    with pytest.raises(BadInputError, match="there are 20 weights; basis 'quadratic' on 6 states has 21"):
        check_history(game, History(TIMES, W=np.ones((len(TIMES), 20))))
