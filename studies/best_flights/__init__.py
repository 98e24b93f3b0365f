"""Comparison of policies with the best flight found, on the nonlinear HFA and from the paper's
x(0).
"""
