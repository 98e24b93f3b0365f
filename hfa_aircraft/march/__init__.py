"""Simulation of closed loops, and the cost of their flights."""
