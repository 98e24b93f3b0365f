"""A learned critic compared with the exact solution."""
