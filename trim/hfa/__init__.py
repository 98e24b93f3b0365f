"""Trims and linear models of the paper's aircraft: bands of the print, loads on its panels."""
