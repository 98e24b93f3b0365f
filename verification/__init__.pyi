"""Is it true: the exact game solution with its certificate, and everything that is checked against
it."""

from .critic.history import check_history as check_history
from .critic_errors import relative_error as relative_error
from .regeneration import regenerate_all as regenerate_all
from .scope import Scope as Scope
