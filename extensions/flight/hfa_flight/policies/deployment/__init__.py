"""Policies as they are deployed: observations, network, actions and timing."""
