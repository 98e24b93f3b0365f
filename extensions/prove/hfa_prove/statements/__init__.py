"""Statements of certificates and the data of their proofs."""

# Refuses a missing python-flint before any module imports it, and sets the precision of balls.
import hfa_prove.enclosure.precision  # noqa: F401
