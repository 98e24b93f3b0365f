"""Readers of aircraft files."""
