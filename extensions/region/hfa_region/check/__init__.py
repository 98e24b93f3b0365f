"""Checker of a region, which uses only numbers of the search."""
