"""Checks and limits of nonlinear flights."""
