"""Search for the smallest delta, also with wrong or undecided results, and reasons for refusals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from game_samples import game_models, random_game
from reference_riccati import reference_solution

from controller import minimum_delta
from controller.riccati.certificate import CLEAR_REACH, carefully_certified
from controller.riccati.delta_search import Answer, smallest_delta
from controller.riccati.existence import existence, shown_gain
from controller.riccati.normal_form import RANK, NormalForm
from controller.riccati.reach import least_reach, loses_rank, not_decaying
from hfa import Game, NoSolutionError, solve

EXACT = 0.6823938


def truth(delta: float) -> Answer:
    return Answer(True) if delta > EXACT else Answer(False, "shown", "of it")


def test_the_bracket_has_the_requested_width() -> None:
    """The bracket of the smallest delta is as narrow as requested, for each initial delta."""
    for begin in (0.1, 1.0, 3e5):
        value, refused, ending = smallest_delta(truth, begin, 1e-6)
        assert refused <= EXACT < value <= refused * (1.0 + 1e-6)
        assert (ending.exists, ending.condition) == (False, "of it")


def _deltas_evaluated(excess: Callable[[float], float]) -> int:
    """Return the number of deltas of a search with this excess, whose bracket is right."""
    evaluated = []

    def existence_at(delta: float) -> Answer:
        evaluated.append(delta)
        return truth(delta)._replace(excess=excess(delta))

    value, refused, _ = smallest_delta(existence_at, 20.0, 1e-6)
    assert refused <= EXACT < value <= refused * (1.0 + 1e-6)
    return len(evaluated)


def test_a_continuous_excess_shortens_the_search() -> None:
    """A search with the excess of each delta takes two thirds of the deltas of a bisection."""
    bisected = _deltas_evaluated(lambda _: math.nan)
    assert _deltas_evaluated(lambda delta: 1.0 - EXACT / delta) < 2.0 / 3.0 * bisected


@pytest.mark.parametrize("power", [0.1, 3.0, 9.0])
def test_a_bent_excess_leaves_the_bracket_right(power: float) -> None:
    """An excess far from linear takes at most twice the deltas of a bisection."""

    def bent(delta: float) -> float:
        return math.copysign(abs(delta / EXACT - 1.0) ** power, delta - EXACT)

    assert _deltas_evaluated(bent) <= 2 * _deltas_evaluated(lambda _: math.nan)


def test_wrong_refusals_above_a_solution_are_ignored() -> None:
    """The search ignores wrong refusals from 8 to 11.38, because a smaller delta has a solution."""

    def existence_at(delta: float) -> Answer:
        return Answer(False, "rounding") if 8.0 < delta < 11.379426 else truth(delta)

    value, refused, _ = smallest_delta(existence_at, 20.0, 1e-6)
    assert refused <= EXACT < value <= refused * (1.0 + 1e-6)


def test_the_bracket_contains_undecided_deltas() -> None:
    """If existence is undecided for deltas from 0.4 to 2, the bracket of the smallest delta
    contains this interval.
    """

    def existence_at(delta: float) -> Answer:
        return Answer(None, "rounding") if 0.4 < delta < 2.0 else truth(delta)

    value, refused, ending = smallest_delta(existence_at, 20.0, 1e-6)
    assert 2.0 <= value <= 2.0 * (1.0 + 1e-6)
    assert 0.4 * (1.0 - 1e-6) <= refused <= 0.4
    assert ending == Answer(None, "rounding")


def test_the_smallest_delta_is_found_despite_undecided_deltas() -> None:
    """The smallest delta is found although existence is undecided for larger deltas, from 1 to
    9.
    """

    def existence_at(delta: float) -> Answer:
        return Answer(None, "rounding") if 1.0 < delta < 9.0 else truth(delta)

    value, refused, _ = smallest_delta(existence_at, 20.0, 1e-6)
    assert refused <= EXACT < value <= refused * (1.0 + 1e-6)


def test_the_bracket_is_zero_if_all_deltas_solve() -> None:
    """If every delta has a solution, the bracket is (0, 0).

    If no delta has a solution, the error states the reason.
    """
    assert smallest_delta(lambda _: Answer(True), 1.0, 1e-6)[:2] == (0.0, 0.0)
    with pytest.raises(
        NoSolutionError, match=r"^the game has no solution for any delta up to 2\.749e\+11: shown; "
    ):
        smallest_delta(lambda _: Answer(False, "shown"), 1.0, 1e-6)
    with pytest.raises(NoSolutionError, match=r"^rounding hides whether any delta up to 2\.7"):
        smallest_delta(lambda _: Answer(None, "near the axis"), 1.0, 1e-6)


def test_no_delta_below_the_stated_gain_solves() -> None:
    """No delta below the gain that a refusal states has a solution, according to a 60-digit
    reference.
    """
    rng = np.random.default_rng(3)
    shown = 0
    for number in range(3):
        game = random_game(rng, scaled=number % 2 == 0)
        smallest = minimum_delta(game)
        gain, frequency = shown_gain(NormalForm.of(game.with_delta(0.9 * smallest.value)))
        assert gain <= smallest.value
        assert frequency >= 0.0
        if gain > 0.0:
            assert not reference_solution(game.with_delta(gain * (1.0 - 1e-9))).exists
            shown += 1
    assert shown >= 2


def test_a_refusal_states_its_evidence() -> None:
    """The refusal of a delta states its evidence: the least gain from the disturbance, or an
    indefinite P.
    """
    game = game_models()["published-15"]
    low = existence(NormalForm.of(game.with_delta(80.0)))
    near = existence(NormalForm.of(game.with_delta(113.55)))
    assert low.exists is False
    assert "for every input, the gain from the disturbance is at least 113.306" in low.reason
    assert near.exists is False
    assert near.reason == "P is indefinite by more than rounding"
    assert near.excess < 0.0


def chain(rates: list[float], coupling: float) -> Game:
    """Return a game on a chain of states with these rates, driven at its first state.

    Each state drives the next. The input therefore affects every mode.
    """
    n = len(rates)
    A = np.diag(rates) + np.diag(np.full(n - 1, coupling), -1)
    return Game(A, np.eye(n)[:, :1], np.eye(n), np.eye(n), np.eye(1), math.inf)


@pytest.mark.parametrize(
    ("rates", "coupling"),
    [([-1e8, 1e-2, -3.0], 1e-6), ([-1e7, -2.0, 1e-3], 1e-4), ([-1e9, 1e-4], 1e-8)],
)
def test_a_stiff_controllable_plant_is_not_called_uncontrollable(
    rates: list[float], coupling: float
) -> None:
    """A stiff plant whose modes are all controllable is solved, or refused because of rounding.

    No message calls a mode unreachable or states the eigenvalue 0.
    """
    game = chain(rates, coupling)
    refusals = refusal_of(lambda: solve(game)) + refusal_of(lambda: minimum_delta(game))
    assert "is not stabilizable" not in refusals
    assert not re.search(r"eigenvalue 0\b(?!\.)", refusals)
    assert "for any delta" not in refusals


def test_a_slow_decaying_mode_is_not_called_undamped() -> None:
    """A slowly decaying mode is not called undamped, although rounding exceeds its rate."""
    game = Game(
        np.diag([-1e8, -1e-6, 100.0]),
        np.array([[60.0], [1.0], [1e-3]]),
        np.eye(3)[:, :1],
        np.diag([1e3, 0.0, 100.0]),
        np.eye(1),
        math.inf,
    )
    assert "undamped" not in refusal_of(lambda: solve(game))


@pytest.mark.parametrize(("reach", "unreached"), [(1e-4, False), (0.0, True)])
def test_a_slow_controllable_mode_is_not_called_uncontrollable(
    reach: float, unreached: bool
) -> None:
    """In rotated coordinates, a slow mode counts as unreachable only if the input does not affect
    it.

    An effect of 1e-4 of the input is detected beside fast modes.
    """
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    A = turn @ np.diag([1e7, -300.0, 0.03, -1e-2]) @ turn.T
    B = turn @ np.array([[1.0], [30.0], [reach], [10.0]])
    slow = min(np.linalg.eigvals(A), key=lambda value: abs(value - 0.03))
    assert loses_rank(A, B.T, complex(slow), not_decaying) is unreached


@pytest.mark.parametrize("length", [2, 5, 30])
def test_the_last_input_affects_every_chained_integrator(length: int) -> None:
    """An input at the last integrator of a chain affects every state.

    An input at the first integrator does not.
    """
    A = np.diag(np.ones(length - 1), 1)
    end = np.eye(length)[:, [-1]]
    begin = np.eye(length)[:, [0]]
    assert least_reach(np.stack([A, A]), np.stack([end, begin])).tolist() == [1.0, 0.0]


@pytest.mark.parametrize("seed", [3, 24, 46])
def test_an_uncontrollable_unstable_mode_is_refused(seed: int) -> None:
    """A game with an uncontrollable unstable mode is refused.

    Rounding of the entries makes the mode slightly controllable. The units of the states differ by
    factors up to 1e8.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    A = rng.standard_normal((n, n))
    A[0] = np.eye(n)[0]
    B = rng.standard_normal((n, 1))
    B[0] = 0.0
    T = rng.standard_normal((n, n)) * 10.0 ** rng.uniform(-4.0, 4.0, n)
    A = T @ A @ np.linalg.inv(T)
    for _ in range(4):
        bits = 1.0 + np.finfo(float).eps * rng.integers(-1, 2, A.shape)
        game = Game(A * bits, T @ B, np.eye(n), np.eye(n), np.eye(1), math.inf)
        with pytest.raises(NoSolutionError, match="no input reaches the mode with eigenvalue 1"):
            solve(game)


@pytest.mark.parametrize("apart", [1.0, 1e-2, 1e-4, 1e-5])
def test_certificates_state_the_distance_to_uncontrollability(apart: float) -> None:
    """For two close unstable modes and one input, the certificate states the distance to
    uncontrollability.

    The stated distance is at most the least relative change found that makes a mode unreachable.
    """
    modes = np.diag([1.0, 1.0 + apart])
    game = Game(modes, np.ones((2, 1)), np.eye(2), np.eye(2), np.eye(1), math.inf)
    form = NormalForm.of(game)[None]
    least = least_reach(form.A, form.B)[0]
    checks = {check.name: check.value for check in solve(game).certificate.checks}
    assert 0.1 * apart < least < apart
    assert RANK < checks["reach"] <= least
    assert checks["reach"] == least or checks["reach"] > CLEAR_REACH


def test_both_derivations_agree_near_the_smallest_delta() -> None:
    """Games with a delta 1e-5 above the smallest delta are certified. Both derivations agree."""
    rng = np.random.default_rng(5)
    for _ in range(4):
        n = 4
        parts = [rng.standard_normal((n, columns)) for columns in (n, 1, 1)]
        game = Game(*parts, np.eye(n), np.eye(1), math.inf)
        near = game.with_delta(minimum_delta(game).value * (1.0 + 1e-5))
        form = NormalForm.of(near)
        checks = carefully_certified(form).certificate.checks
        assert {"second_derivation", "gain_change"} <= {check.name for check in checks}


def refusal_of(call: Callable[[], object]) -> str:
    """Return the message of a NoSolutionError with a line end, or "" if none is raised."""
    try:
        call()
    except NoSolutionError as refusal:
        return f"{refusal}\n"
    return ""


def test_an_uncontrollable_mode_is_named_in_any_units() -> None:
    """The message names an unreachable mode in any units, also if the plant has a fast mode."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        units = np.exp2(rng.integers(-8, 9, 3).astype(float))
        T = units[:, None] * turn
        back = turn.T / units
        A = T @ np.diag([0.5, -1.0, -200.0]) @ back
        B = T @ np.array([[0.0], [1.0], [1.0]])
        game = Game(A, B, np.eye(3), np.eye(3), np.eye(1), math.inf)
        with pytest.raises(
            NoSolutionError, match=r"no input reaches the mode with eigenvalue 0\.5;"
        ):
            solve(game)
