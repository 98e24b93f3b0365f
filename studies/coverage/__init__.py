"""Bands of `hfa identify` on simulated records, and planted faults."""
