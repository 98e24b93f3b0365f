"""Trims and linear models of the paper's aircraft: error bands of printed matrices, front view."""
