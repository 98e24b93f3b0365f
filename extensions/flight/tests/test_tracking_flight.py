"""`hfa fly --reference`: errors with and without the exact feedforward, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from cli import answer, hfa

AT_15 = ("fly", "--dihedral", "15", "--dynamics", "newton")


@pytest.mark.slow
def test_errors_of_a_small_command_are_those_of_the_linear_model() -> None:
    """With feedforward, the late errors of a slow sine are predicted, and smaller than without."""
    data = answer(*AT_15, "--reference", "dihedral=0.5sin(0.3141592653589793t)")
    flown = np.array(data["late_rms_errors"])
    plain = np.array(data["late_rms_errors_without_feedforward"])
    # The second half of 20 s is half a period; after the transients, this is a mean over periods.
    predicted = np.array(data["tracking"]["rms_errors"])
    assert flown == pytest.approx(predicted, rel=0.1, abs=3e-5)
    assert np.all(flown < plain)
    assert data["tracking"]["reachable"] is True


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_a_policy_of_weights_flies_and_is_refused_with_a_reference() -> None:
    answer("solve", "--dihedral", "15", "--order", "3", "-o", "value.npz")
    words = ("fly", "--dihedral", "15", "--weights", "value.npz", "--duration", "1")
    assert answer(*words, "--initial", "alpha=0.1")["departure"] is None
    result = hfa(*words, "--reference", "dihedral=1")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "requires a policy u = -K z" in result.err


@pytest.mark.parametrize(
    "words", [("--law", "none"), ("--command", "dihedral=1:2"), ("--reference", "gamma=1")]
)
def test_other_requests_are_refused(words: tuple[str, ...]) -> None:
    result = hfa(*AT_15, "--reference", "dihedral=1", *words)
    assert (result.code, result.out, result.err.count("\n")) == (2, "", 1)
