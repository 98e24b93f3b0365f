"""Optimal flights of a nonlinear aircraft to its trim: proposed by collocation, then simulated."""
