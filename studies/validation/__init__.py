"""Comparison of the model with published and released data of the same aircraft."""
