"""Where the aircraft flies: trim, exact linear models, modes, sweeps, and the aircraft's identification."""

from trim.condition import TrimCondition, level_flight, release
from trim.linearize import LinearModel, linearize
from trim.modes import Mode, modes_of
from trim.operating_point import OperatingPoint, load_operating_point, save_operating_point
from trim.solve import TrimError
from trim.solve import trim as solve_trim
from trim.sweep import Sweep, sweep

__all__ = [
    "LinearModel",
    "Mode",
    "OperatingPoint",
    "Sweep",
    "TrimCondition",
    "TrimError",
    "level_flight",
    "linearize",
    "load_operating_point",
    "modes_of",
    "release",
    "save_operating_point",
    "solve_trim",
    "sweep",
]
