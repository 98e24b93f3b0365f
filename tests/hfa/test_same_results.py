"""A command prints, its file contains, and a function in Python returns the same numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa as command
from known_models import game_at

import hfa

ANGLE = np.radians(10.0)


def trimmed():
    """Return the trim at 10 deg."""
    return hfa.trim(hfa.aircraft(), dihedral=ANGLE)


def swept():
    """Return the sweep over 0, 10 and 20 deg."""
    return hfa.sweep(hfa.aircraft(), {"dihedral": np.radians([0.0, 10.0, 20.0])})


def verified():
    """Return the verdict on the gain in K.npz at 10 deg."""
    game = game_at(10.0)
    return hfa.verify(game, hfa.read_critic("K.npz", game))


#: Command line -> function that returns the same result in Python.
RESULTS = {
    "trim --dihedral 10": trimmed,
    "linearize --dihedral 10": lambda: trimmed().linearize(),
    "sweep --dihedral 0:20:10": swept,
    "solve --dihedral 10": lambda: hfa.solve(game_at(10.0)),
    "learn --dihedral 10 --seed 3": lambda: hfa.learn(game_at(10.0), seed=3),
    "verify --dihedral 10 --weights K.npz": verified,
}


@pytest.mark.parametrize("words", RESULTS)
def test_command_file_and_python_have_the_same_numbers(words):
    """Every entry of the result in Python, of the function `RESULTS[words]`, is that which the command
    prints and writes, bit by bit.
    """
    if "K.npz" in words:
        assert command("solve", "--dihedral", "10", "-o", "K.npz").code == 0
    printed = answer(*words.split(), "-o", "result.json")
    assert json.loads(Path("result.json").read_text("utf-8")) == printed
    in_python = json.loads(RESULTS[words]().report().json())
    assert len(in_python) > 5
    assert {name: printed[name] for name in in_python} == in_python
