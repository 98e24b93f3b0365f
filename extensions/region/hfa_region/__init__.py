"""Proof of regions of attraction of nonlinear loops with saturated inputs, by sums of squares."""
