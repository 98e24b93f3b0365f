"""Benchmarks of speed against other software, run by `make bench`."""
