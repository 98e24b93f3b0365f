"""Linear models, games and gains used by many tests, each computed once.

The aircraft of the SimVFA simulation is included.
"""

import math
from functools import lru_cache

from scipy.optimize import brentq
from standard_air import density

import hfa
from hfa import solve
from hfa.paper import level_model, published_game
from hfa_model import load_parameters

#: Density at 40,000 ft in SimVFA (B. Thomsen, 2018), the released simulation of the paper's aircraft,
#: slug/ft³. That of the standard atmosphere is larger by 1.6e-5 of it.
_RELEASED_DENSITY = 5.872675956988981e-4


def released_simulation():
    """Return the aircraft of the SimVFA simulation and its altitude in ft.

    At this altitude, the standard atmosphere has the air density of the simulation.
    """
    altitude = brentq(
        lambda height: float(density(height)) - _RELEASED_DENSITY, 39_000.0, 41_000.0, xtol=1e-9
    )
    return hfa.aircraft(parameters=load_parameters("gibson-2011-simulation").values), altitude


@lru_cache(maxsize=64)
def model_at(degrees, dynamics="published"):
    """Return the linear model of the HFA in level flight at a dihedral angle, deg."""
    aircraft = hfa.aircraft(dynamics)
    return level_model(aircraft, math.radians(degrees))


@lru_cache(maxsize=64)
def game_at(degrees, dynamics="published"):
    """Return the paper's game on `model_at`."""
    return published_game(model_at(degrees, dynamics))


@lru_cache(maxsize=64)
def exact_gain(degrees, dynamics="published"):
    """Return K of the exact solution of `game_at`."""
    return solve(game_at(degrees, dynamics)).K
