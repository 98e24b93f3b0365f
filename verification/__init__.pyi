"""Checks of critics against the exact game solution, and of linear models against printed
matrices."""

from .critic_errors import relative_error as relative_error
from .regeneration import regenerate_all as regenerate_all
from .scope import Scope as Scope
