"""Operating points, exact linear models, modes, sweeps, and the aircraft's identification."""

from hfa_flight.along import models_along as models_along
from hfa_flight.export.interpolated import InterpolatedModel as InterpolatedModel

from .hfa.front_view import trim_figure as trim_figure
from .hfa.level_flight import level_flight as level_flight, load_condition as load_condition
from .hfa.printed import compare as compare, entry_bands as entry_bands, regenerate as regenerate
from .linear.level_model import level_model as level_model
from .linear.linear_model import (
    LinearModel as LinearModel,
    linearize as linearize,
)
from .linear.modes import modes_of as modes_of
from .point.condition import (
    TrimCondition as TrimCondition,
    release as release,
)
from .point.operating_point import OperatingPoint as OperatingPoint
from .point.solve import TrimError as TrimError, find_operating_point as find_operating_point
from .point.trim_report import trim_report as trim_report
from .sweeps.points import trim_points as trim_points
from .sweeps.sweep import sweep as sweep
