"""Checkers of certificates.

The checkers repeat the proof and trust no result of the search.
"""
