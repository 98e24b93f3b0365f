"""Reasons of verdicts."""

from __future__ import annotations

import numpy as np
import pytest
from cli import answer
from game_files import AT_15, stored
from game_samples import failed_names
from planted_critics import gain, other_root, value, weights_of

from hfa import Game, from_gain, from_value, verify
from hfa.main import DONE, FAILED

pytestmark = pytest.mark.usefixtures("folder")


def test_the_reason_is_a_line_of_the_report(game: Game) -> None:
    """The reason of a verdict is in the JSON data and is a line of the report.

    For another root of the Riccati equation, the reason names this root.
    """
    near = verify(game, from_gain(game, 1.002 * gain(game)))
    assert (
        near.reason
        == near.to_dict()["diagnosis"]
        == "every entry of K is 1.002 times the exact one"
    )
    assert f"Reason: {near.reason}" in near.report().text().splitlines()
    root = verify(game, from_value(game, other_root(game)))
    assert "another root of the Riccati equation" in root.reason


def test_a_value_inaccurate_for_its_gain_is_named() -> None:
    """The reason states that a P with eight right digits is not accurate enough for its gain.

    The input moves both states equally. This motion costs almost nothing, and K = B'P is a small
    difference of large numbers.
    """
    A = np.array([[-1.0, 0.1], [0.1, -1.0]])
    Q = np.array([[1.0, -0.999], [-0.999, 1.0]])
    game = Game(A, [[1.0], [1.0]], np.zeros((2, 1)), Q, [[1.0]], np.inf)
    P = np.vectorize(lambda entry: float(f"{entry:.8g}"))(value(game))
    verdict = verify(game, from_value(game, P))
    failed = failed_names(verdict.checks)
    assert failed == {"K_rel_error", "K_balanced_error", "K_entry_error", "policy_rel_error"}
    assert verdict.reason.startswith(
        "P is right within the limit; the K that follows from it is off by 5.5e-06"
    )


# A file that holds more than one of W, P and K: each is judged, none hides another.


@pytest.mark.parametrize(
    ("held", "factors", "said"),
    [
        ("WPK", {}, ""),
        ("PK", {"K": -1.0}, "the gain has the wrong sign"),
        ("WK", {"K": 1.0 + 1e-4}, "every entry of K is 1.0001 times the exact one"),
        ("PK", {"P": 1.1}, "every entry of P is 1.1 times the exact one"),
    ],
)
def test_each_part_of_a_file_is_checked(
    game: Game, held: str, factors: dict[str, float], said: str
) -> None:
    """Each of W, P and K in a file is checked, and a wrong one is named."""
    parts = {"W": weights_of(value(game)), "P": value(game), "K": gain(game)}
    file = stored("all.npz", **{key: factors.get(key, 1.0) * parts[key] for key in held})
    data = answer("verify", *AT_15, "--weights", file, code=FAILED if said else DONE)
    assert data["diagnosis"].startswith(said)
    assert bool(data["diagnosis"]) == bool(said)
    for name in "PK":
        assert data[f"{name}_rel_error"] == pytest.approx(
            abs(factors.get(name, 1.0) - 1.0), rel=1e-6, abs=1e-12
        )
