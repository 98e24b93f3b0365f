"""Readers of files with arrays."""
