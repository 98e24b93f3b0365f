"""Checker of certificates. It shares only the model and the arithmetic with the prover."""
