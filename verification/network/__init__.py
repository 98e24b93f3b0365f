"""Errors of networks over a box of states, found by a search."""
