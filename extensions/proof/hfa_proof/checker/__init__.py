"""Checker of certificates, which imports nothing from the prover."""
