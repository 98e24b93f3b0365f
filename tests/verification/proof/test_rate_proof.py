"""How fast the dihedral may move."""

from __future__ import annotations

import numpy as np
import pytest
from known_models import model_at
from proof_cases import exact_table, family, unstable_between

from hfa_support import BadInputError
from verification import prove_rate
from verification.proof.scheduled_loop import segments


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_the_lyapunov_function_decreases_at_every_rate(dynamics: str) -> None:
    table = exact_table(14.0, 14.5, dynamics=dynamics)
    found = prove_rate(family(dynamics), table, 14.0, 14.5)
    assert found.rate > 60.0
    angles, fastest = found.places, []
    for i, share in ((0, 0.0), (1, 0.3), (2, 0.7), (3, 1.0)):
        angle = angles[i] + share * (angles[i + 1] - angles[i])
        model, along = model_at(angle, dynamics), (angle - 14.0) / 0.5
        P = found.P[i] + share * (found.P[i + 1] - found.P[i])
        slope = (found.P[i + 1] - found.P[i]) / np.radians(angles[i + 1] - angles[i])
        loop = model.A - model.B @ (table.K[0] + along * (table.K[1] - table.K[0]))
        for sign in (-1.0, 1.0):
            growth = loop.T @ P + P @ loop + sign * np.radians(found.rate) * slope
            assert np.linalg.eigvalsh(growth)[-1] < 0.0
            fastest.append(np.linalg.eigvalsh(growth + sign * np.radians(found.rate) * slope)[-1])
    # Twice as fast, the same function grows somewhere: the rate is not far from what it can prove.
    assert max(fastest) > 0.0


def test_a_rate_that_the_search_is_wrong_about_is_not_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half as fast again as the same function allows."""
    monkeypatch.setattr("verification.proof.rate_proof._SHARES", (1.5,))
    assert prove_rate(family(), exact_table(14.0, 14.5), 14.0, 14.5).rate == 0.0


def test_an_unstable_loop_has_no_rate() -> None:
    assert prove_rate(family(), unstable_between(15.0, 15.06), 15.0, 15.06).rate == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_the_whole_range(dynamics: str) -> None:
    table = exact_table(*np.linspace(0.0, 20.0, 11).tolist(), dynamics=dynamics)
    assert prove_rate(family(dynamics), table, 0.0, 20.0).rate > 60.0


def test_a_table_is_cut_at_its_angles_and_reaches_to_its_last() -> None:
    table = exact_table(13.0, 14.0, 15.0)
    assert [(each.low, each.high) for each in segments(table, 13.5, 15.0)] == [(13.5, 14.0), (14.0, 15.0)]
    with pytest.raises(BadInputError, match=r"the table covers 13 to 15, not 13 to 15.5"):
        segments(table, 13.0, 15.5)
