"""Checkers of certificates.

The checkers repeat the proof and trust no result of the search.
"""

# Refuses a missing python-flint before any module imports it, and sets the precision of balls.
import verification.enclosure.precision  # noqa: F401
