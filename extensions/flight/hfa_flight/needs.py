"""Numbers of flights, and the share of them that must succeed for a PASS."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from hfa.options.argument_types import number
from hfa_support.errors import BadInputError, choice_of, shown
from hfa_support.files import Number
from hfa_support.reporting.text import percent

#: Name of the requirement after --need, and its default: every flight.
SHARE = "share"
ALL = 1.0
_SHARE = Number(0.0, 1.0, above=True)
#: Default number of flights of an assessment from each trim.
SAMPLES = 300
#: A count that is smaller than the required one by less is enough, because shares are rounded.
_ROUNDING = 1e-9


def refuse_share(share: float) -> None:
    """Raise BadInputError unless a share is a number above 0 and at most 1."""
    if _SHARE.of(share) is None:
        raise BadInputError(f"share is {shown(share)}; give {_SHARE}")


class Need(NamedTuple):
    """Requirement: the sentence if it is not satisfied, and the permitted values."""

    unmet: str
    values: Number


#: Name of a requirement of `hfa assess` -> requirement.
NEEDS = {
    "delay": Need("a delay of {:g} s is not tolerated", Number(0.0)),
    "margin": Need("the disk margin is not at least {:g}", Number(0.0)),
    "cost": Need("the median cost is not within {:g} % of the exact gain's", Number(0.0)),
    SHARE: Need("fewer than the share {:g} of the flights converge", _SHARE),
}


def needed(names: tuple[str, ...], name: str, text: str) -> float:
    """Return the value that is typed after `--need NAME=`, of a command with these names."""
    if name not in names:
        raise BadInputError(f"is unknown; {choice_of(name, names)}")
    return number(text, NEEDS[name].values)


needed_share = partial(needed, (SHARE,))


def is_enough(count: int, flights: int, share: float) -> bool:
    """Return whether `count` of all flights are at least the required share of them."""
    return count >= share * flights - _ROUNDING


def outside_band(outside: int, members: int) -> tuple[float, float]:
    """Return the ends of the 95 % band of the probability that a flight does not stay inside.

    The band is that of Clopper and Pearson (1934), one-sided if none or every one does not.
    """
    from scipy.special import betaincinv

    tail = 0.05 if outside in (0, members) else 0.025
    low = 0.0 if outside == 0 else betaincinv(outside, members - outside + 1, tail)
    high = 1.0 if outside == members else betaincinv(outside + 1, members - outside, 1.0 - tail)
    return float(low), float(high)


def band_text(outside: int, members: int, verb: str) -> str:
    """Return `outside_band` with its confidence of 95 % as text, such as "27.2 to 72.9 %, 95 %".

    The upper end is rounded up. If all stay, the text is "fewer than" this end.

    verb: what the others do, such as "leave"
    """
    low, high = (100.0 * end for end in outside_band(outside, members))
    if not outside:
        return f"fewer than {percent(high, up=True)} {verb} (95 %)"
    return f"{low:.3g} to {percent(high, 3, up=True)}, 95 %"


def need_text(share: float) -> str:
    """Return the requirement as the end of a sentence, or "" if every flight must succeed."""
    return "" if share == ALL else f" ({100.0 * share:g} % required)"
