"""Checker of regions, which repeats the proof and trusts no result of the search."""
