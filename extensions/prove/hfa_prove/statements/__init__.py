"""Statements of certificates and the data of their proofs."""
