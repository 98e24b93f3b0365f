"""Certificates of the nets, one of each kind."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_prove.certificate import read_content
from hfa_prove.statements.plant import Subject

ROOT = Path(__file__).parents[4]
STORED = (
    *("schedule", "solution", "critic", "cost", "value"),
    *("region", "region_boxes", "region_disturbed"),
)


@cache
def stored(name: str) -> dict[str, Any]:
    """Return the content of a certificate. It is shared and must not be changed."""
    path = ROOT / "tests" / "nets" / "certificates" / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8"))


@cache
def pendulum() -> Model:
    return load_model(f"{ROOT / 'examples' / 'pendulum.py'}:PENDULUM")


def read(content: dict[str, Any]) -> Any:
    own = pendulum() if content["kind"] in ("region", "cost", "value") else None
    return read_content(content, Subject(own))
