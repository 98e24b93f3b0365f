"""Critics over time: planted histories whose settling is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from planted_critics import gain, value, weights_of

from controller import Game, History, basis, learn
from hfa_support import BadInputError
from verification import check_history
from verification.critic.check_result import check_figure

TIMES = 0.25 * np.arange(41)
SETTLES = np.where(TIMES < 4.1, 0.1, 1e-9)


def planted(game: Game, sizes: np.ndarray, of: str = "W") -> History:
    """The exact critic times 1 + sizes at each time."""
    exact = {"W": weights_of(value(game)), "P": value(game), "K": gain(game)}[of]
    return History(TIMES, **{of: np.multiply.outer(1.0 + sizes, exact)})


@pytest.mark.parametrize(
    ("sizes", "of", "predefined_time", "settled"),
    [
        *((SETTLES, of, predefined_time, 4.25) for of in "WPK" for predefined_time in (4.25, 4.0)),
        # it leaves the band again
        (np.where(TIMES < 2.0, 1.0, np.where(TIMES == 7.5, 1e-3, 1e-10)), "W", 5.0, 7.75),
        # it ends wrong
        (np.where(TIMES == 10.0, 1e-2, 1e-10), "W", None, math.inf),
    ],
)
def test_a_history_passes_where_it_settles_in_time(
    game: Game, sizes: np.ndarray, of: str, predefined_time: float | None, settled: float
) -> None:
    check = check_history(game, planted(game, sizes, of), predefined_time=predefined_time)
    assert check.history is not None
    assert check.history.settling_time == settled
    assert check.history.errors["K_rel_error"] == pytest.approx(sizes, rel=1e-4, abs=1e-15)
    assert np.isnan(check.history.errors["P_rel_error"]).all() == (of == "K")
    data = check.report().data["history"]
    if predefined_time is None:
        assert not check.ok
        assert "settling_time" not in [row.name for row in check.checks]
        assert (data["settling_time"], data["predefined_time_kept"]) == (None, None)
    else:
        in_time = settled <= predefined_time
        assert check.ok == data["predefined_time_kept"] == in_time
        assert [row.name for row in check.checks if not row.ok] == ([] if in_time else ["settling_time"])


def test_an_error_beyond_the_quadratic_weights_counts(game: Game) -> None:
    """P and K are exact throughout; V is not until 5 s."""
    functions = basis("quadratic+quartic", 6)
    weights = np.tile(functions.weights(value(game)), (len(TIMES), 1))
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
    figure = check_figure(check, ("x",) * 6, ("u",) * 5)
    assert [line.get_label() for line in figure.axes[-1].lines[:2]] == ["limit 1e-06", "error of P"]
    assert len(check.report().records.rows) == 41


def test_the_last_row_is_judged_with_the_gain_that_belongs_to_it(game: Game) -> None:
    history = History(TIMES, W=np.tile(weights_of(value(game)), (len(TIMES), 1)), K=1.01 * gain(game))
    assert not check_history(game, history).ok


def test_rows_of_another_length_are_refused(game: Game) -> None:
    with pytest.raises(BadInputError, match="there are 20 weights; basis 'quadratic' on 6 states has 21"):
        check_history(game, History(TIMES, W=np.ones((len(TIMES), 20))))
