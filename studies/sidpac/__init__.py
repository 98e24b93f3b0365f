"""Confidence bands of `hfa identify` compared with those of NASA's program SIDPAC."""
