"""The published formats are valid and complete, and the document describes them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from cli import complaints_about, hfa
from extension import Extension
from jsonschema import Draft202012Validator
from project import project_sources

from hfa.formats import formats
from hfa_aircraft.model import Model
from hfa_support.reporting.data_files import jsonable

controllers = Extension("controllers")
servo = Extension("controller.schedule.scheduled_controller")


@pytest.fixture(scope="module")
def trim() -> dict[str, Any]:
    data: dict[str, Any] = json.loads(hfa("trim", "--dihedral", "15", "--json").out)
    return data


def test_the_schema_contains_every_format() -> None:
    """The published JSON Schema is valid and contains every format that the code writes."""
    Draft202012Validator.check_schema(formats())
    published = {
        each["properties"]["schema"]["const"]
        for each in formats()["$defs"].values()
        if "title" in each
    }
    sources = " ".join(project_sources().values())
    assert {name for name in published if f'"{name}"' not in sources} == set()
    properties = [each.get("properties", {}) for each in formats()["$defs"].values()]
    parts = {each["schema"]["const"] for each in properties if "schema" in each}
    parts.add(formats()["$id"])
    assert set(re.findall(r'"(hfa\.[a-z-]+/\d+)"', sources)) <= parts, (
        "declare it as a Result, and name it with its command"
    )
    outputs = {entry["$ref"] for entry in formats()["oneOf"]}
    assert {
        f"#/$defs/{name}" for name, each in formats()["$defs"].items() if "title" in each
    } == outputs


@pytest.mark.slow
def test_the_schema_is_printed_by_its_command_alone() -> None:
    """`python -m hfa.formats` prints the schema."""
    words = [sys.executable, "-m", "hfa.formats"]
    printed = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    assert json.loads(printed) == formats()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"news": 1}, "news is not published"),
        ({"dihedral_deg": "15"}, "$.dihedral_deg"),
        ({"schema": "hfa.other/1"}, "hfa.other/1 is not published"),
        ({"operating_point": {}}, "required property"),
    ],
)
def test_planted_faults_violate_the_schema(
    change: dict[str, Any], said: str, trim: dict[str, Any]
) -> None:
    """Unknown entries, wrong types, missing entries and an unknown schema are reported."""
    assert said in " ".join(complaints_about(trim | change))


def test_a_controller_and_attributes_of_store_are_published(
    tmp_path: Path, published_aircraft: Model
) -> None:
    """The schema accepts a controller file and the attributes of a store.

    With one wrong entry, each is rejected.
    """
    servo.save_controller(tmp_path / "a.npz", controllers.small_controller(published_aircraft))
    kept = jsonable(dict(np.load(tmp_path / "a.npz")))
    assert complaints_about(kept) == []
    assert complaints_about(kept | {"A": [[1.0]]}) != []
    assert hfa("sweep", "--dihedral", "5,15", "-o", str(tmp_path / "a.zarr")).code == 0
    attributes = dict(zarr.open_group(str(tmp_path / "a.zarr"), mode="r").attrs)
    assert complaints_about(attributes) == []
    assert complaints_about(attributes | {"rows": "2"}) != []
