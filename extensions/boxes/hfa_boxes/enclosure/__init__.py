"""Enclosures of functions over many boxes at once, in double precision with rounding errors."""
