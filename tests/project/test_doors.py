"""The front doors: complete, lazy, and enough for a notebook."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest
from import_graph import LAYERS

PACKAGES = LAYERS[:4]


@pytest.mark.parametrize("name", PACKAGES)
def test_every_name_of_a_door_is_there(name: str) -> None:
    package = importlib.import_module(name)
    assert dir(package) == sorted(package.__all__)
    assert package.__all__
    for export in package.__all__:
        assert getattr(package, export) is not None


@pytest.mark.parametrize("name", PACKAGES)
def test_a_name_that_is_not_there_is_said(name: str) -> None:
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nonsense'; it offers "):
        importlib.import_module(name).nonsense  # noqa: B018


@pytest.mark.parametrize("name", PACKAGES)
def test_a_room_is_not_hidden_by_a_name(name: str) -> None:
    """A room and a name of the same door would replace each other, depending on who is imported first."""
    package = importlib.import_module(name)
    rooms = {path.name for path in Path(package.__path__[0]).iterdir() if path.is_dir()}
    assert rooms & set(package.__all__) == set()


def test_opening_the_doors_loads_nothing_heavy() -> None:
    heavy = "casadi", "scipy", "numpy", "control"
    code = f"import sys, {', '.join(PACKAGES)}; print([name for name in {heavy} if name in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.strip() == "[]"
