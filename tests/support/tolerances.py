"""Relative tolerances for two floating-point computations of one number, with reasons.

Other tolerances in tests follow from the digits of a printed value or are explained by a comment.
"""

#: A few operations without much cancellation: some tens of rounding errors of 1e-16.
FEW_ROUNDINGS = 1e-14
#: One formula in another order, in other units or compiled. Sums of matrices with up to a dozen
#: rows have some thousand rounding errors, which cancellation may amplify ten times.
SAME_FORMULA = 1e-12
#: Two solutions of one Riccati equation, each refined to rounding. They differ by rounding errors
#: times the condition of the equation, below 1e4 here.
SAME_SOLUTION = 1e-12
#: Two largest gains, each computed to 1e-9 (`controller.riccati.frequency_response.TOLERANCE`). The
#: error due to a peak between two frequencies of a sweep is smaller.
TWO_GAINS = 1e-8
#: Two smallest deltas, each bracketed to 1e-6 (`controller.riccati.smallest_delta.TOLERANCE`).
TWO_BRACKETS = 2e-6
