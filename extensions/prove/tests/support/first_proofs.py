"""Searches that end at the first proof, whatever time it takes."""

from __future__ import annotations

from collections.abc import Callable

from hfa_prove.search.clock import Clock
from hfa_prove.search.region import PROVERS
from hfa_prove.search.region_search import Region, RegionProblem, Settings
from hfa_prove.statements.loop import Loop


def first_region(
    loop: Loop, prover: str, is_enough: Callable[[Region], bool] = lambda region: True
) -> Region:
    """Return the first region with V of degree 2 that a prover proves.

    is_enough: whether the search may end with a region
    """

    def stop(region: Region) -> None:
        if is_enough(region):
            raise KeyboardInterrupt

    return PROVERS[prover](RegionProblem(loop), Settings(2, Clock(60.0), stop))
