"""The learning laws by name."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from cli import answer, hfa

import hfa as package
from controller.learning.laws import LAWS
from hfa.learning import LEARNING_LAWS


def test_the_command_offers_every_law() -> None:
    """The names of the option --law are those of `learn`, and every law has settings."""
    assert tuple(LAWS) == LEARNING_LAWS
    for law in LAWS.values():
        assert fields(law.settings)


@pytest.mark.parametrize("name", ["certified", "integral-rl"])
def test_a_law_that_settles_finds_the_exact_gain(name: str) -> None:
    """The command learns, and its verdict is that of the comparison with the exact solution."""
    data = answer("learn", "--dihedral", "5", "--law", name)
    assert data["law"] == name
    assert data["converged"] is True


def test_the_law_of_the_paper_overflows_in_its_first_steps() -> None:
    """As printed, the weights overflow; the message says when, and which step would be stable."""
    result = hfa("learn", "--dihedral", "5", "--law", "published")
    assert (result.code, result.out) == (1, "")
    assert result.err.startswith("hfa: the published law overflowed at step ")
    assert result.err.count("\n") == 1


@pytest.mark.slow
def test_the_modified_law_is_bounded_and_wrong() -> None:
    """With the modifications, the weights stay bounded, and the first lines say how wrong it is."""
    game = package.paper.published_game(
        package.paper.level_model(package.aircraft(), np.radians(5))
    )
    run = package.learn(game, "modified", predefined_time=1.0)
    assert np.isfinite(run.weights).all()
    assert not run.settled
    verdict = package.verify(game, run)
    assert not verdict.ok
    assert verdict.K_rel_error > 0.1
