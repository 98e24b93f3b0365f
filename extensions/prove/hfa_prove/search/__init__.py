"""Search for what the checkers prove."""

# Refuses a missing python-flint before any module imports it, and sets the precision of balls.
import hfa_prove.enclosure.precision  # noqa: F401
