"""Errors of networks over a box of states: searched, and bounded with proof."""
