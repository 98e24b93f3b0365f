"""What the command-line tests of the game share: its answers, and the game at 15 degrees."""

from __future__ import annotations

import json
from typing import Any

import pytest
from cli import hfa

from hfa_cli.main import DONE

AT_15 = ("--dihedral", "15")
#: A certified run of a tenth of a second.
QUICK = ("--set", "tick=0.1")
LABELS = {"plant", "states", "inputs", "state_units", "input_units", "delta"}
HISTORY = {"times", "weights", "residual_norm", "law_residual_norm"}


def answer(*words: str, code: int = DONE) -> dict[str, Any]:
    """What `hfa words... --json` prints: one JSON object; on standard error stand its warnings, nothing else."""
    result = hfa(*words, "--json")
    assert result.code == code, result.err
    data = json.loads(result.out, parse_constant=pytest.fail)
    assert isinstance(data, dict)
    notes = data.get("warnings", []) if "--model" in words else []
    assert result.err == "".join(f"hfa: note: {note}\n" for note in notes)
    return data


def checks_of(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {check["name"]: check for check in data["checks"]}
