"""Flights of the nonlinear aircraft under linear policies: how far from trim they hold, and what gives way first."""
