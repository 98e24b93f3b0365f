"""Trims of a spring beyond the limits of its force."""

from __future__ import annotations

import pytest

import hfa

#: x'' = force - 2 x, with a force from -3 to 5 N.
SPRING = hfa.Model(
    "spring",
    {"x": hfa.Signal("m"), "v": hfa.Signal("m/s")},
    {"force": hfa.Signal("N", 1.0, -3.0, 5.0)},
    lambda x, u, p, w: ({"x": x.v, "v": u.force - 2.0 * x.x}, {}),
    trim={"x": 0.5},
)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (3.5, "v by -2 m/s^2 (active limits: force at maximum 5 N, 7 N required)"),
        (-2.0, "v by 1 m/s^2 (active limits: force at minimum -3 N, -4 N required)"),
    ],
)
def test_a_failed_trim_states_the_residual_and_the_force_required(place: float, words: str) -> None:
    """The force is at its limit, and what is missing has the sign of the rate."""
    with pytest.raises(hfa.NoSolutionError) as refused:
        hfa.trim(SPRING, x=place)
    assert words in str(refused.value)
    assert refused.value.attempt["force"] == (5.0 if place > 0.0 else -3.0)
