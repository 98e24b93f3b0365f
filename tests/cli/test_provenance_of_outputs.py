"""Which aircraft an output is about: read back from every format that a command writes."""

from __future__ import annotations

import csv
import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from cli import hfa
from scipy.io import loadmat

from hfa_model import default_parameters, save_parameters
from hfa_model.provenance import parameter_hash


@pytest.fixture(scope="module")
def heavy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The identified aircraft with heavier panels."""
    from dataclasses import replace

    known = default_parameters()
    path = tmp_path_factory.mktemp("heavy") / "heavy.toml"
    heavier = replace(known, values=known.values._replace(panel_mass=10.5), covariance=np.zeros((0, 0)))
    save_parameters(heavier, path, "Heavier panels.")
    return path


def hash_of(path: Path) -> str:
    from hfa_model.parameters import load_parameters

    return parameter_hash(load_parameters(path).values)


@pytest.mark.parametrize("command", ["trim", "verify"])
def test_text_says_which_aircraft(command: str, heavy: Path) -> None:
    plain, edited = (
        hfa(command, "--dihedral", "12").out,
        hfa(command, "--dihedral", "12", "--parameters", str(heavy)).out,
    )
    assert f"parameters identified ({parameter_hash(default_parameters().values)})" in plain.splitlines()[-1]
    assert f"({hash_of(heavy)})" in edited.splitlines()[-2]
    assert edited.splitlines()[-1] == "not the identified aircraft: panel_mass 10.5 slug (identified: 9.32593)"


def test_json_has_the_whole_condition(heavy: Path) -> None:
    words = ("--dihedral", "12", "--hold", "speed=66", "--free", "alpha", "--hold", "aileron_outer=1")
    found = json.loads(hfa("linearize", *words, "--parameters", str(heavy), "--json").out)["provenance"]
    assert found["parameter_hash"] == hash_of(heavy)
    assert found["changed"]["panel_mass"]["value"] == 10.5
    assert found["condition"]["imposed"]["speed"] == 66.0
    assert found["condition"]["imposed"]["aileron_outer"] == pytest.approx(np.radians(1.0))
    assert "alpha" in found["condition"]["free"]
    assert set(found["condition"]["limits"]) == set(found["condition"]["free"])
    assert found["command"].startswith("hfa linearize --dihedral 12 --hold speed=66")
    assert found["date"] == "2026-09-21T14:13:20Z"
    assert found["dynamics"] == "published"


@pytest.mark.parametrize(
    ("command", "suffix"),
    [*product(("linearize",), (".json", ".npz", ".mat", ".csv")), ("fly", ".npz"), ("solve", ".mat")],
)
def test_every_file_has_it(command: str, suffix: str, heavy: Path, tmp_path: Path) -> None:
    path = tmp_path / f"out{suffix}"
    more = ("--duration", "0.1") if command == "fly" else ()
    hfa(command, "--dihedral", "12", "--parameters", str(heavy), "-o", str(path), *more)
    assert provenance_of(path) == hash_of(heavy)


def provenance_of(path: Path) -> str:
    """The parameter hash in a file."""
    if path.suffix == ".json":
        return str(json.loads(path.read_text("utf-8"))["provenance"]["parameter_hash"])
    if path.suffix == ".npz":
        with np.load(path) as data:
            return str(data["provenance.parameter_hash"])
    if path.suffix == ".mat":
        return str(loadmat(path, simplify_cells=True)["provenance"]["parameter_hash"])
    with path.open(encoding="utf-8", newline="") as stream:
        first = next(csv.DictReader(stream))
    return str(json.loads(first["about"])["provenance"]["parameter_hash"])


def test_a_plant_of_the_user_s_own_is_named(tmp_path: Path) -> None:
    plant = tmp_path / "plant.json"
    plant.write_text(json.dumps({"A": [[-1.0]], "B": [[1.0]], "Q": [[1.0]], "R": [[1.0]]}), encoding="utf-8")
    found = json.loads(hfa("solve", "--model", str(plant), "--json").out)["provenance"]
    assert (found["model"], found["parameters"]) == (str(plant), "")


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
