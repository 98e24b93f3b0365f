"""Verdicts on equivalent copies of a game, which must not differ from those on the game.

The copies differ in the last bits, the order of the states, their units (powers of two), or by an
orthogonal change of coordinates. The number of threads also varies.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest
from copies import KINDS, copies
from game_samples import game_models, random_game
from tolerances import TWO_BRACKETS

from controller import minimum_delta
from controller.riccati.existence import existence
from controller.riccati.normal_form import NormalForm
from hfa import Game, NoSolutionError, solve

#: Relative distances from delta_min: far, and so near that a wrong digit changes the verdict.
NEAR = (1e-1, 1e-4, -1e-4, -1e-1)


def random_games(number: int) -> Iterator[Game]:
    for seed in range(number):
        rng = np.random.default_rng([4, seed])
        yield random_game(rng, scaled=seed % 2 == 0)


def verdict(game: Game) -> bool | None:
    """Return whether a game has a value, or None if the existence is undecided."""
    return existence(NormalForm.of(game)).exists


def is_solved(game: Game) -> bool:
    try:
        return solve(game).certificate.ok
    except NoSolutionError:
        return False


def changed_verdicts(games: Iterator[Game], count: int) -> Counter[str]:
    """Return the number of copies, of changed verdicts ("changed"), and of undecided ones ("open").

    Each game is copied just below and just above its smallest delta.

    count: number of copies of each game
    """
    counts: Counter[str] = Counter()
    for seed, game in enumerate(games):
        smallest = minimum_delta(game)
        assert not smallest.uncertain
        for share in NEAR:
            at = game.with_delta(smallest.value * (1.0 + share))
            expected = share > 0.0
            assert verdict(at) is expected
            for copy in copies(at, seed, count):
                answer = verdict(copy.problem)
                counts["copies"] += 1
                counts["changed"] += answer is (not expected)
                counts["open"] += answer is None
    return counts


def test_copies_agree_on_existence() -> None:
    """For 128 copies of games near delta_min, existence is decided as for the original games."""
    changed = changed_verdicts(random_games(8), 4)
    assert changed["copies"] == 128
    assert (changed["changed"], changed["open"]) == (0, 0)


@pytest.mark.slow
def test_ten_thousand_copies_agree_on_existence() -> None:
    """For none of 20,000 copies of games near delta_min, the verdict changes.

    At most 20 verdicts are undecided.
    """
    changed = changed_verdicts(random_games(250), 20)
    assert changed["copies"] == 20_000
    assert changed["changed"] == 0
    assert changed["open"] <= 20  # 0.1 %, where rounding decides


@pytest.mark.parametrize(
    "name", ["published-5", pytest.param("published-15", marks=pytest.mark.slow)]
)
def test_copies_have_the_same_smallest_delta(name: str) -> None:
    """All copies of a game have the same smallest delta.

    They have a solution 0.1 % above the smallest delta, and none 0.1 % below it.
    """
    game = game_models()[name]
    smallest = minimum_delta(game)
    for copy in copies(game, 1, 4):
        counts = minimum_delta(copy.problem)
        assert counts.value == pytest.approx(smallest.value, rel=TWO_BRACKETS), copy.kind
        assert is_solved(copy.problem.with_delta(1.001 * smallest.value)), copy.kind
        assert not is_solved(copy.problem.with_delta(0.999 * smallest.value)), copy.kind


def test_a_copy_differs_and_has_converted_solution() -> None:
    """Each copy has another A than the original game, and the converted solution of the original
    game.

    The kinds of the copies are those of `KINDS`.
    """
    game = game_models()["published-15"]
    P = solve(game).P
    for copy in copies(game, 0, 8, {"P": P}):
        assert not np.array_equal(copy.problem.A, game.A), copy.kind
        assert is_solved(copy.problem)
        # P is computed in two ways: rounding times the condition number of the game, about 1e4.
        error = np.abs(solve(copy.problem).P - copy.critic["P"])
        assert error.max() <= 1e-10 * np.abs(copy.critic["P"]).max(), copy.kind
    assert {copy.kind for copy in copies(game, 0, 4)} == set(KINDS)


IN_ONE_THREAD = """
import json, os, sys
if sys.argv[1] == "one":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import numpy as np
from hfa import Game
from controller import minimum_delta
rng = np.random.default_rng(7)
found = []
for n in (6, 40):
    A, C = rng.standard_normal((2, n, n))
    B = rng.standard_normal((n, 3))
    game = Game(A, B, np.eye(n), C.T @ C, np.eye(3), 1.0)
    found.append(minimum_delta(game).value)
print(json.dumps(found))
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processors cannot be chosen")
def test_smallest_delta_is_the_same_with_one_thread() -> None:
    """The smallest delta is the same with one BLAS thread as with one for each processor."""
    values = []
    for threads in ("one", "all"):
        command = [sys.executable, "-c", IN_ONE_THREAD, threads]
        run = subprocess.run(command, capture_output=True, text=True, check=True)
        values.append(json.loads(run.stdout))
    assert values[0] == pytest.approx(values[1], rel=TWO_BRACKETS)
