"""The checker of certificates: it shares nothing with the prover."""
