"""Checks of critics against the exact game solution, and of linear models against printed
matrices."""

from .box import nonlinear_plant as nonlinear_plant
from .critic_errors import relative_error as relative_error
from .regeneration import regenerate_all as regenerate_all
from .reports import verdict_figure as verdict_figure, verdict_report as verdict_report
