"""Checkers of certificates proved on boxes.

They repeat the proof and trust no result of the search.
"""
