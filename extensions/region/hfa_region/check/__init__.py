"""Checker of regions of attraction.

The checker repeats the proof and trusts no result of the search.
"""
