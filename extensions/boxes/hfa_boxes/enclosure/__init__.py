"""Enclosures of functions over many boxes at once, in doubles with rounding errors included."""
