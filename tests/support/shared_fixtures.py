"""Fixtures of all rooms: what follows from its arguments alone is made once, and what several test
files fly."""

from __future__ import annotations

import os
import pickle
from collections import Counter
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import FlownCase, case_at, exact_gain, game_at, model_at

import hfa_model
from controller import Game
from controller.game.training_run import TrainingRun
from hfa_aircraft.model import Model
from hfa_model import VARIANTS, Parameters, default_parameters
from hfa_model.parameters import ParameterSet
from trim import OperatingPoint


class _Shared:
    """A function computed once for the same key; once more where a test asks a second time, since
    it may compare."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._known: dict[Hashable, tuple[Any, Counter[str]]] = {}

    def __call__(self, key: Hashable, *arguments: Any, **options: Any) -> Any:
        test = os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" ")[0]
        known = self._known.get(key)
        asks_again = known is not None and known[1][test] == 1
        result = self._function(*arguments, **options) if known is None or asks_again else known[0]
        self._known.setdefault(key, (result, Counter()))[1][test] += 1
        return result


def share(patched: pytest.MonkeyPatch) -> None:
    """`learn`, as commands call it."""
    from controller.learning import certified as module

    learn = _Shared(module.learn)

    def learned(game: Game, law: str = "certified", seed: int = 0, **options: Any) -> TrainingRun:
        if options.get("progress") is not None:
            return learn._function(game, law, seed, **options)
        return learn(
            (law, seed, pickle.dumps(sorted(options.items())), *_key(game)),
            game,
            law,
            seed,
            **options,
        )

    patched.setattr(module, "learn", learned)


def _key(game: Game) -> tuple[Hashable, ...]:
    return (
        game.delta,
        game.B.shape,
        *(each.tobytes() for each in (game.A, game.B, game.E, game.Q, game.R)),
    )


@pytest.fixture(autouse=True, scope="session")
def made_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patched:
        share(patched)
        yield


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty one, in which the test runs."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def parameter_set() -> ParameterSet:
    return default_parameters()


@pytest.fixture(scope="session")
def parameters(parameter_set: ParameterSet) -> Parameters:
    return parameter_set.values


@pytest.fixture(scope="session", params=sorted(VARIANTS))
def aircraft(request: pytest.FixtureRequest, parameters: Parameters) -> Model:
    """The identified aircraft, once with each set of equations."""
    return hfa_model.aircraft(request.param, parameters)


@pytest.fixture(scope="session")
def published_aircraft(parameters: Parameters) -> Model:
    return hfa_model.aircraft("published", parameters)


@pytest.fixture(scope="session")
def point() -> OperatingPoint:
    """What `--dihedral 15` means: the trim, and below its game and the exact gain."""
    return model_at(15.0).point


@pytest.fixture(scope="session")
def game() -> Game:
    return game_at(15.0)


@pytest.fixture(scope="session")
def gain() -> np.ndarray:
    return exact_gain(15.0)


@pytest.fixture(scope="session", params=["published", "newton"])
def at_15(request: pytest.FixtureRequest, parameters: Parameters) -> FlownCase:
    """The exact gain at 15 degrees, on each set of equations."""
    return case_at(parameters, request.param, 15.0)


@pytest.fixture(scope="session")
def newton(parameters: Parameters) -> FlownCase:
    return case_at(parameters, "newton", 15.0)
