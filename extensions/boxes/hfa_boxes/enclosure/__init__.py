"""Enclosures of functions over many boxes at once, in double precision, including rounding
errors.
"""
