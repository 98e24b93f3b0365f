"""Proof by branch and bound over boxes: regions of attraction of policies, and lower cost bounds.
"""
