"""A proof that is terminated by a signal and resumed writes the same certificate."""

from __future__ import annotations

from pathlib import Path

import pytest
from ended_runs import assert_resumed_bits_equal, proc


@proc
@pytest.mark.slow
def test_a_resumed_run_gives_identical_bits(tmp_path: Path) -> None:
    """A proof that is terminated at random times and resumed writes the same bytes."""
    words = ("prove", "schedule", "--dihedral", "12:15", "-o", "a.json")
    assert_resumed_bits_equal(tmp_path, words)
