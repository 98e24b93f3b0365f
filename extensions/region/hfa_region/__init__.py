"""Proved regions of attraction of nonlinear loops with saturated inputs."""
