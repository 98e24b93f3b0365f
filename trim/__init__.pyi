"""Operating points, exact linear models, modes and sweeps, for any aircraft."""

from .hfa.front_view import trim_figure as trim_figure
from .hfa.level_flight import load_condition as load_condition
from .hfa.printed import compare as compare, entry_bands as entry_bands, regenerate as regenerate
from .linear.frequency import transfers as transfers
from .linear.levels import Airplane as Airplane, graded as graded
from .linear.modes import modes_of as modes_of
from .linear.transfer import Transfer as Transfer
from .point.condition import release as release, usual_condition as usual_condition
from .point.solve import TrimError as TrimError
from .point.trim_report import levels_of as levels_of, trim_report as trim_report
from .sweeps.interpolated import InterpolatedModel as InterpolatedModel
from .sweeps.points import trim_points as trim_points
