"""Checks of critics against the exact game solution, and of linear models against printed
matrices."""

from .critic_errors import relative_error as relative_error
from .figures import verdict_figure as verdict_figure
from .plant import nonlinear_plant as nonlinear_plant
from .regeneration import regenerate_all as regenerate_all
from .reports import verdict_report as verdict_report
