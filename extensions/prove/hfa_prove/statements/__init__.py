"""Statements of certificates and the data of their proofs."""

# Sets the precision of balls.
import hfa_prove.enclosure.precision  # noqa: F401
