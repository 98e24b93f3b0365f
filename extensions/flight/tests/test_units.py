"""Flights with --units si."""

from __future__ import annotations

from pathlib import Path

import pytest
from units_of_outputs import assert_no_feet, assert_store_in_metres

FLIGHT = ("fly", "--dihedral", "12")


@pytest.mark.slow
def test_si_flights_contain_no_feet(tmp_path: Path) -> None:
    """With --units si, reports and pictures of a flight contain no English units."""
    gust = ("--law", "exact", "--duration", "0.5", "--gust", "60:1.5", "--command", "speed=0:0.003")
    assert_no_feet(*FLIGHT, *gust, folder=tmp_path)


@pytest.mark.slow
def test_stores_in_si_and_english_units_agree(tmp_path: Path) -> None:
    """With --units si, the store of a Monte Carlo plan contains the converted numbers."""
    members = ("--samples", "2", "--duration", "0.1", "--error", "chord=0.05")
    assert_store_in_metres(*FLIGHT, *members, name="final", folder=tmp_path)
