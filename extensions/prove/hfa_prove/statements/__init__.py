"""Statements of certificates and the data of their proofs."""

# Refuses a missing python-flint before any module imports it, and sets the precision of balls.
import verification.enclosure.precision  # noqa: F401
