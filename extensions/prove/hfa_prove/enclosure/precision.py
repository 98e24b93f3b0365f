"""Precision of the balls of proofs, which importing this module sets."""

from flint import ctx

#: Bits of a midpoint. Doubles have 53 bits; the other bits absorb the rounding of about ten
#: thousand operations.
PRECISION = 192

ctx.prec = PRECISION
