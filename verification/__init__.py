"""Is it true: the exact game solution with its certificate, and everything else held against it or against the print."""
