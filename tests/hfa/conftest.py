"""Fixture that runs each test of the command line in a new empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _in_a_folder(folder: Path) -> None:
    """Run every test in the empty folder that the fixture `folder` creates."""
