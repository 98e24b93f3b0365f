"""Relative tolerances for two floating-point computations of one number, with reasons.

Other tolerances in tests follow from the digits of a printed value or are explained by a comment.
"""

#: A few operations without much cancellation: some tens of roundings of 1e-16.
FEW_ROUNDINGS = 1e-14
#: The same formula in another order, in other units or compiled: the sums of matrices with up to a
#: dozen rows make some thousand roundings, which cancellation between terms may show ten times.
SAME_FORMULA = 1e-12
#: Two solutions of one Riccati equation, each refined until its residual is rounding: what is left
#: is rounding times the condition of the equation, below 1e4 here.
SAME_SOLUTION = 1e-12
#: Two largest gains, each sought to 1e-9 (`controller.riccati.frequency_response.TOLERANCE`) from
#: above; a smooth peak between two frequencies of a sweep adds less.
TWO_GAINS = 1e-8
#: Two smallest deltas, each in a bracket of 1e-6 (`controller.riccati.smallest_delta.TOLERANCE`).
TWO_BRACKETS = 2e-6
