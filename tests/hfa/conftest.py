"""Fixture that runs each test of the command line in a new empty folder."""

import pytest


@pytest.fixture(autouse=True)
def _in_a_folder(folder):
    """Run every test in the empty folder that the fixture `folder` creates."""
