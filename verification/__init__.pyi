"""Checks of critics against the exact game solution, and of linear models against printed
matrices."""

from .box import Box as Box
from .critic_errors import relative_error as relative_error
from .figures import verdict_figure as verdict_figure
from .regeneration import regenerate_all as regenerate_all
from .reports import verdict_report as verdict_report
from .scope import Scope as Scope, nonlinear_plant as nonlinear_plant
