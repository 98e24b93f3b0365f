"""`hfa solve --order`, and the files that it writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import hfa
from known_models import game_at, model_at

import hfa as package
from hfa import expand, solve

AT_15 = ("--dihedral", "15")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("order") / "cubic.json"
    result = hfa("solve", *AT_15, "--order", "3", "-o", str(path))
    assert result.code == 0
    return path


@pytest.mark.slow
def test_file_has_the_terms_of_the_function(written: Path) -> None:
    """The file has the schema of its format, which `hfa` of the tests checks."""
    expansion = expand(model_at(15.0), solve(game_at(15.0)), 3)
    data = json.loads(written.read_text())
    assert (data["order"], data["basis"]) == (3, "cubic")
    sizes = np.abs(expansion.weights).max()
    assert np.abs(np.array(data["W"]) - expansion.weights).max() <= 1e-9 * sizes
    assert np.array(data["policy_weights"]).shape == expansion.policy_weights.shape
    assert data["residual"] <= 1e-12
    quadratic, cubic = data["radii"]
    assert (quadratic["degree"], cubic["degree"]) == (2, 3)
    assert 0.0 < quadratic["c"] < cubic["c"]
    assert len(cubic["extents"]) == 6


@pytest.mark.slow
def test_written_weights_are_read_as_a_critic(written: Path) -> None:
    game = game_at(15.0)
    critic = package.read_critic(written, game)
    expansion = expand(model_at(15.0), solve(game), 3)
    z = np.linalg.solve(expansion.root.T, np.random.default_rng(1).standard_normal((6, 10)))
    assert critic.value is not None
    assert np.array(critic.value(z)) == pytest.approx(np.array(expansion.V(z)), rel=1e-8)
    assert critic.u(z.T) == pytest.approx(np.array(expansion.policy(z)).T, rel=1e-8)


@pytest.mark.slow
def test_report_shows_both_sizes() -> None:
    expansion = expand(model_at(15.0), solve(game_at(15.0)), 4)
    text = expansion.report().text()
    for radius in expansion.radii:
        assert f"{radius.c:.3g}" in text
    assert f"{expansion.share:.0%}".replace("%", " %") in text
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ((*AT_15, "--order", "6"), "--order"),
        ((*AT_15, "--picture", "errors.png"), "--picture"),
        (("--model", "plant.json", "--order", "3"), "--model"),
    ],
)
def test_wrong_requests_are_refused(words: tuple[str, ...], named: str, folder: Path) -> None:
    plant = {"A": [[0.0, 1.0], [0.0, 0.0]], "B": [[0.0], [1.0]]}
    (folder / "plant.json").write_text(json.dumps(plant))
    result = hfa("solve", *words)
    assert result.code == 2
    assert named in result.err
