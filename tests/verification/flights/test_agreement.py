"""Flights at the edge of what can be checked: at rest, from outside the envelope, through a singularity."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from cli import hfa

from controller.flight.closed_loop import CompiledLoop
from hfa_cli.main import BAD_INPUT, DONE
from hfa_model.support.errors import NoSolutionError
from hfa_model.vectors import STATE_SCALES, STATES
from verification.flights.agreement import AT_REST, INTEGRATION, adaptive_states, integration_checks

FLY = ("fly", "--dihedral", "15", "--law", "exact")


def test_a_flight_at_rest_passes_its_checks() -> None:
    said = hfa(*FLY, "--duration", "2", "--check", "--json")
    assert said.code == DONE
    assert all(check["ok"] for check in json.loads(said.out)["checks"])


@pytest.mark.parametrize("index", range(len(STATES)))
def test_what_counts_at_rest_is_small_and_not_more(index: int) -> None:
    still, moved = np.zeros((5, len(STATES))), np.zeros((5, len(STATES)))
    allowed = INTEGRATION * AT_REST * STATE_SCALES[index]
    for size, failed in ((0.9 * allowed, []), (1.1 * allowed, [f"integration_{STATES[index]}"])):
        moved[-1, index] = size
        assert [check.name for check in integration_checks(moved, still) if not check.ok] == failed


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--initial", "speed=-70"), "begins with speed -2, beyond the limit of 34 ft/s"),
        (("--initial", "pitch=-70", "--check"), "begins with pitch -67.2"),
        (
            ("--to", "16", "--over", "1", "--initial", "dihedral=-90"),
            "begins with dihedral -75, beyond the limit of -60 deg",
        ),
    ],
)
def test_a_start_outside_the_envelope_is_refused(words: tuple[str, ...], told: str) -> None:
    said = hfa(*FLY, *words)
    assert (said.code, said.out) == (BAD_INPUT, "")
    assert told in said.err
    assert said.err.count("\n") == 1


def test_an_adaptive_integrator_that_stops_says_where() -> None:
    """y' = y² from 1 ends at t = 1."""

    def rate(t: float, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        return y**2

    loop: Any = SimpleNamespace(rate=rate, loop=SimpleNamespace(gust=None, policy=SimpleNamespace(memory_size=0)))
    with (
        np.errstate(all="ignore"),
        pytest.raises(NoSolutionError, match=r"stopped after 1 s: Required step") as refusal,
    ):
        adaptive_states(cast(CompiledLoop, loop), np.ones(1), lambda tick: np.zeros(1), tick=0.1, ticks=20)
    assert "\n" not in str(refusal.value)
