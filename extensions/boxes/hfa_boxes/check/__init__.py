"""Checkers of certificates proved on boxes.

The checkers repeat the proof and trust no result of the search.
"""
