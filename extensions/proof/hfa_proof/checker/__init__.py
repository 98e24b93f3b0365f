"""Checker of certificates, which shares only the model and the arithmetic with the prover."""
