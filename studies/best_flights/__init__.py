"""Policies compared with the best flight found, for the nonlinear HFA from the paper's x(0)."""
