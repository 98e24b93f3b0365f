"""Claims about the print are measured on the print, whatever is flown."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from hfa_model.published import published_models
from hfa_model.vectors import LINEAR_STATES
from verification.experiments.claims import PRINT, Claim, Evidence
from verification.experiments.configuration import default_reading
from verification.experiments.reproduction import EXPERIMENTS
from verification.experiments.setting import Setting, make_setting

OF_THE_PRINT = [
    (section, claim) for section, one in EXPERIMENTS.items() for claim in one.claims if claim.laws == (PRINT,)
]


@cache
def setting_of(matrices: str) -> Setting:
    return make_setting(default_reading(), matrices)


def test_there_are_claims_about_the_print() -> None:
    assert {claim.number for _, claim in OF_THE_PRINT} == {"5.1-8", "5.1-16", "5.3-1"}


@pytest.mark.parametrize(("section", "claim"), OF_THE_PRINT, ids=lambda value: getattr(value, "number", value))
def test_the_print_does_not_hang_on_what_is_flown(section: str, claim: Claim) -> None:
    one, other = (
        claim.measure(Evidence(setting_of(matrices), section, {}), PRINT) for matrices in ("regenerated", "printed")
    )
    assert one == other


def test_the_coupling_is_that_of_the_printed_rows() -> None:
    at_15, at_5 = published_models()
    row = LINEAR_STATES.index("pitch_rate")
    ratios = [np.linalg.norm(getattr(at_5, name)[row]) / np.linalg.norm(getattr(at_15, name)[row]) for name in "AB"]
    claim = next(claim for _, claim in OF_THE_PRINT if claim.number == "5.1-8")
    measured = claim.measure(Evidence(setting_of("regenerated"), "5.1", {}), PRINT)
    assert measured == pytest.approx(min(ratios), rel=1e-14)
