"""Flights of the nonlinear HFA from the paper's x(0): policies beside the best flight found."""
