"""Enclosures of functions over many boxes at once, in doubles, rounding included."""
