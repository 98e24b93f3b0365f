"""Fixture that runs each test of the command line in a new empty folder."""

import pytest
from project import ROOT


@pytest.fixture(autouse=True)
def _in_a_folder(folder):
    """Run every test in the empty folder that the fixture `folder` creates."""


@pytest.fixture(scope="session")
def uav(tmp_path_factory):
    """Return the path of the small aircraft with a largest lift coefficient."""
    path = tmp_path_factory.mktemp("uav") / "uav.toml"
    text = (ROOT / "examples/uav.toml").read_text("utf-8")
    path.write_text(f"CL_max = 1.0\n{text}", "utf-8")
    return str(path)
