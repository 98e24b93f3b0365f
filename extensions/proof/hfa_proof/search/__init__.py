"""Search for proofs, and their certificates and reports."""
