"""Is it true: the exact game solution with its certificate, and what else is held against it or against the print."""
