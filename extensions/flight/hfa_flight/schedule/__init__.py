"""Gains and controllers scheduled on a measured variable, and their files."""
