"""Precision of the balls of proofs."""

from typing import Any

from hfa_support.errors import missing_package

#: Bits of a midpoint. Doubles have 53 bits; the other bits absorb the rounding of about ten
#: thousand operations.
PRECISION = 192


def flint_or_refusal() -> Any:
    """Return the module `flint` with its precision set.

    Raises BadInputError if python-flint is not installed.
    """
    try:
        import flint
    except ImportError as error:
        raise missing_package("proofs require", "python-flint") from error
    flint.ctx.prec = PRECISION
    return flint


flint_or_refusal()
