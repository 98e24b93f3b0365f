"""Optimal flights of a nonlinear aircraft to a trim, found by collocation and checked by
simulation.
"""
