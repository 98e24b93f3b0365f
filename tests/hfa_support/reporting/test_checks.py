"""One judged number."""

from __future__ import annotations

import math

from hfa_support import Check
from hfa_support.reporting.checks import at_least, at_most, below


def test_checks_judge_and_give_reasons() -> None:
    assert at_most("x", 1.0, 1.0, "too large") == Check("x", 1.0, 1.0, True, "")
    assert at_most("x", 1.1, 1.0, "too large") == Check("x", 1.1, 1.0, False, "too large")
    assert at_least("x", 1.0, 1.0, "small").ok
    assert not at_least("x", 0.9, 1.0, "small").ok
    assert not below("x", 1.0, 1.0, "not below").ok
    for judge in (at_most, at_least, below):
        assert not judge("x", math.nan, 1.0, "not a number").ok
    assert at_most("x", math.inf, 1.0, "infinite").to_dict()["value"] is None
