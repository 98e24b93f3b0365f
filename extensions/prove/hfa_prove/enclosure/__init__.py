"""Enclosures of functions: over many boxes in doubles with rounding errors, and in balls."""
