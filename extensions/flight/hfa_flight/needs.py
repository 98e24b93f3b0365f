"""The share of flights that must succeed for a PASS, in `fly`, `optimize` and `assess`."""

from __future__ import annotations

from hfa.options.argument_types import number
from hfa_support.errors import BadInputError, is_finite, shown

#: Name of the requirement after --need, and its default: every flight.
SHARE = "share"
ALL = 1.0
#: A count that is smaller than the required one by less is enough, because shares are rounded.
_ROUNDING = 1e-9


def refuse_share(share: float) -> None:
    """Raise BadInputError unless a share is a number above 0 and at most 1."""
    if not (is_finite(share) and 0.0 < share <= 1.0):
        raise BadInputError(f"share is {shown(share)}; give a number above 0 and at most 1")


def needed_share(name: str, text: str) -> float:
    """Return the share that is typed after `--need share=`."""
    if name != SHARE:
        raise BadInputError(f"is unknown; use {SHARE}=X, such as {SHARE}=0.95")
    share = number(text)
    if not 0.0 < share <= 1.0:
        raise BadInputError(f"is {text}; give a number above 0 and at most 1")
    return share


def is_enough(count: int, flights: int, share: float) -> bool:
    """Return whether so many of some flights are the required share."""
    return count >= share * flights - _ROUNDING


def need_text(share: float) -> str:
    """Return the requirement as the end of a sentence, or "" if every flight must succeed."""
    return "" if share == ALL else f" ({100.0 * share:g} % required)"
