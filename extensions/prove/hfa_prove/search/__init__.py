"""Search for what the checkers prove."""

# Refuses a missing python-flint before any module imports it, and sets the precision of balls.
import verification.enclosure.precision  # noqa: F401
