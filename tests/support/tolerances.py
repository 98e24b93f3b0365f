"""Relative tolerances for two floating-point computations of one number, with reasons.

Other tolerances in tests follow from the digits of a printed value or are explained by a comment.
"""

#: A few operations without much cancellation: some tens of rounding errors of 1e-16.
FEW_ROUNDINGS = 1e-14
#: One formula in another order, in other units or compiled. Sums of matrices with up to a dozen
#: rows have some thousand rounding errors, which cancellation may amplify ten times.
SAME_FORMULA = 1e-12
