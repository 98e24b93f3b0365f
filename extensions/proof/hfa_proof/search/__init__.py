"""Statements, the search for their proofs, certificates and reports."""
