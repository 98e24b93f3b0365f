"""The aircraft in examples/ and their trims."""

import sys
from dataclasses import replace
from pathlib import Path

from hfa import trim
from trim import release, usual_condition

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
import navion as navion
from f16 import F16 as F16
from gtm import GTM as GTM
from navion import NAVION as NAVION


def trimmed(model, hold=None, rates=None):
    """Return the trim of a model with held values and with rates that are not 0, as in a pull-up."""
    usual = usual_condition(model)
    # The pull-up of the F-16 in the book that its file names requires more than full throttle.
    condition = release(
        usual, hold=hold, limits={"throttle": (0.0, 1.1), "power": (0.0, 120.0)} if rates else {}
    )
    return trim(model, replace(condition, rates={**usual.rates, **(rates or {})}))
