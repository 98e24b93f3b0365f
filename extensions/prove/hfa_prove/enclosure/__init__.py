"""Enclosures of functions in balls."""
