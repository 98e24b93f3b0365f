"""Checker of regions. It repeats the proof and trusts no result of the search."""
