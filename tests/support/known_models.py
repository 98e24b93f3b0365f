"""The identified aircraft at an angle: its linear model about the trim, its game, its exact gain, each made once."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from controller import Game, published_game
from hfa_model import Aircraft
from trim import LinearModel, level_model
from verification import solve_game


@lru_cache(maxsize=64)
def model_at(degrees: float, dynamics: str = "published") -> LinearModel:
    aircraft = Aircraft(dynamics=dynamics)
    return level_model(aircraft, math.radians(degrees))


@lru_cache(maxsize=64)
def game_at(degrees: float, dynamics: str = "published") -> Game:
    return published_game(model_at(degrees, dynamics))


@lru_cache(maxsize=64)
def exact_gain(degrees: float, dynamics: str = "published") -> np.ndarray:
    return solve_game(game_at(degrees, dynamics)).K
