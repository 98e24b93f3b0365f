"""Flights of the nonlinear HFA from the paper's x(0): policies compared with the best flight
found.
"""
