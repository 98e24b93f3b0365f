"""Errors of networks over a box of states: found by a search, and bounded by a proof."""
