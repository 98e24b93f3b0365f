"""The checker of certificates. It shares nothing with the prover."""
