"""Search for what the checkers prove."""

# Sets the precision of balls.
import hfa_prove.enclosure.precision  # noqa: F401
