"""`parameters_rival.toml`: its parameters belong to its own equations, so no command flies them with others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa

from hfa_cli.main import BAD_INPUT
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import save_parameters
from hfa_model.published import published_models
from hfa_model.variants import Rival
from trim.linear.bands import rival_parameters
from trim.linear.compare import compare, regenerate


@pytest.fixture
def rival_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "rival.toml"
    save_parameters(rival_parameters(), path, "")
    return path


@pytest.mark.parametrize("dynamics", ["published", "newton"])
@pytest.mark.parametrize(
    "command",
    [
        "trim --dihedral 10",
        "linearize --dihedral 10",
        "sweep --dihedral 0:2:1",
        "sweep --dihedral 0:2:1 -o sweep.zarr",
        "regenerate",
        "solve --dihedral 10",
        "learn --dihedral 10",
        "verify --dihedral 10",
        "fly --dihedral 10",
        "monte-carlo --dihedral 10 --members 2 -o members.zarr",
        "report -o report.html",
    ],
)
def test_every_command_refuses_it(rival_file: Path, command: str, dynamics: str) -> None:
    result = hfa(*command.split(), "--parameters", str(rival_file), "--dynamics", dynamics)
    assert_refused(result, BAD_INPUT, f"{rival_file}: its [structure] cosine_factor", "give the parameters.toml")
    assert list(rival_file.parent.iterdir()) == [rival_file]


def test_the_map_of_both_equations_refuses_it(rival_file: Path) -> None:
    result = hfa("fly", "--dihedral", "10", "--map", "map.png", "--parameters", str(rival_file))
    assert_refused(result, BAD_INPUT, "[structure] cosine_factor")
    assert list(rival_file.parent.iterdir()) == [rival_file]


def test_a_file_without_structure_is_flown(rival_file: Path) -> None:
    save_parameters(replace(rival_parameters(), structure={}, covariance=np.zeros((0, 0))), rival_file, "")
    assert hfa("trim", "--dihedral", "10", "--parameters", str(rival_file)).code == 0


def test_with_its_own_equations_it_regenerates_the_print_and_with_others_it_does_not() -> None:
    rival = rival_parameters()
    for variant, lowest, highest in ((Rival(**rival.structure), 1.0, 1.3), ("published", 1e4, 1e5)):
        aircraft = Aircraft(rival.values, variant)
        misses = [row.half_units for model in published_models() for row in compare(regenerate(aircraft, model), model)]
        assert lowest < np.abs(misses).max() < highest
