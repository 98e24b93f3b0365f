"""Which trims a statement may be about."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from proof_cases import family

from hfa_support import BadInputError
from hfa_support.linear_table import LinearTable
from trim import LEVEL_FLIGHT, release


def test_the_paper_s_flights_are_taken() -> None:
    flights = family()
    flights.check(0.0, 20.0)
    assert len(flights.condition(10.0).free) == 4


def test_what_changes_with_the_dihedral_is_to_be_held() -> None:
    table = LinearTable([0.0, np.radians(20.0)], [68.0, 60.0])
    changing = replace(family(), flights=release(LEVEL_FLIGHT, hold={"speed": table}))
    with pytest.raises(BadInputError, match="speed changes with the dihedral in this condition; --hold it"):
        changing.check(0.0, 20.0)
    replace(changing, flights=release(changing.flights, hold={"speed": 64.0})).check(0.0, 20.0)


@pytest.mark.parametrize("settings", [{"free": ("alpha",)}, {"hold": {"dihedral_rate": 0.1}}, {"free": ("dihedral",)}])
def test_other_trims_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(BadInputError, match="a proof takes trims at a given dihedral"):
        replace(family(), flights=release(LEVEL_FLIGHT, **settings)).check(0.0, 20.0)
