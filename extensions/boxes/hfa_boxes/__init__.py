"""Proof by branch and bound over boxes: regions of attraction and lower bounds of the cost."""
