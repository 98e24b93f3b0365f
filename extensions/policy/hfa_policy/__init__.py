"""Policies as they are deployed: observations, actions, timing, and assessment by simulation."""
