"""A policy as it is deployed: observations, actions, timing, and its assessment in flight."""
