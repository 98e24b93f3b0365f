"""Environments in which policies are trained."""
