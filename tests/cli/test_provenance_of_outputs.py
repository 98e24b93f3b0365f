"""Which aircraft an output is about, and the condition; test_files.py has that a file has what the JSON has."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa

from hfa_model import default_parameters, load_parameters, save_parameters
from hfa_model.provenance import parameter_hash


@pytest.fixture(scope="module")
def heavy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The identified aircraft with heavier panels."""
    known = default_parameters()
    path = tmp_path_factory.mktemp("heavy") / "heavy.toml"
    heavier = replace(known, values=known.values._replace(panel_mass=10.5), covariance=np.zeros((0, 0)))
    save_parameters(heavier, path, "Heavier panels.")
    return path


def hash_of(path: Path) -> str:
    return parameter_hash(load_parameters(path).values)


@pytest.mark.parametrize("command", ["trim", "verify"])
def test_text_says_which_aircraft(command: str, heavy: Path) -> None:
    plain, edited = hfa(command, "--dihedral", "12"), hfa(command, "--dihedral", "12", "--parameters", str(heavy))
    assert f"parameters identified ({parameter_hash(default_parameters().values)})" in plain.out.splitlines()[-1]
    assert f"({hash_of(heavy)})" in edited.out.splitlines()[-2]
    assert edited.out.splitlines()[-1] == "not the identified aircraft: panel_mass 10.5 slug (identified: 9.32593)"


def test_json_has_the_whole_condition(heavy: Path) -> None:
    words = ("--dihedral", "12", "--hold", "speed=66", "--free", "alpha", "--hold", "aileron_outer=1")
    found = answer("linearize", *words, "--limit", "throttle=0:60", "--parameters", str(heavy))["provenance"]
    assert found["parameter_hash"] == hash_of(heavy)
    assert found["changed"]["panel_mass"]["value"] == 10.5
    assert found["condition"]["imposed"]["speed"] == 66.0
    assert found["condition"]["imposed"]["aileron_outer"] == pytest.approx(np.radians(1.0))
    assert "alpha" in found["condition"]["free"]
    assert set(found["condition"]["limits"]) == set(found["condition"]["free"])
    assert found["condition"]["limits"]["throttle"] == [0.0, 60.0]
    assert found["command"].startswith("hfa linearize --dihedral 12 --hold speed=66")
    assert (found["date"], found["dynamics"]) == ("2026-09-21T14:13:20Z", "published")


@pytest.mark.parametrize("command", ["sweep", pytest.param("monte-carlo", marks=pytest.mark.slow)])
def test_a_store_has_it(command: str, heavy: Path, tmp_path: Path) -> None:
    import zarr

    path = tmp_path / "out.zarr"
    words = {
        "sweep": ("--dihedral", "0:10:5"),
        "monte-carlo": ("--dihedral", "12", "--samples", "2", "--duration", "0.1"),
    }
    assert hfa(command, *words[command], "--parameters", str(heavy), "-o", str(path)).code == 0
    assert zarr.open_group(str(path), mode="r").attrs["provenance"]["parameter_hash"] == hash_of(heavy)
