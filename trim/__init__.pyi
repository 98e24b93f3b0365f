"""Operating points, exact linear models, modes and sweeps, for any aircraft."""

from .hfa.level_flight import load_condition as load_condition
from .hfa.printed import compare as compare, entry_bands as entry_bands
from .hfa.reports import (
    linear_model_report as linear_model_report,
    trim_figure as trim_figure,
    trim_report as trim_report,
)
from .linear.frequency import draw_bode as draw_bode
from .linear.linear_model import LinearModel as LinearModel
from .linear.linearize import linearize as linearize
from .linear.modes import Mode as Mode, modes_of as modes_of
from .point.condition import release as release, usual_condition as usual_condition
from .point.solve import TrimError as TrimError
from .reports.levels import Airplane as Airplane, graded as graded
from .reports.sheet import sheet_of as sheet_of
from .sweeps.points import trim_points as trim_points
from .sweeps.sweep import sweep as sweep
