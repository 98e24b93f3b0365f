"""Damaged stores are repaired or refused, and values of files come back short and spelled in a refusal."""

from __future__ import annotations

import json
import random
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from cli import Result, hfa
from hostile import damaged, said_wrongly

#: Warnings are what the command makes of them, as they are for its users.
pytestmark = pytest.mark.filterwarnings("default")
STORED = ("monte-carlo", "--dihedral", "15", "--law", "exact", "--samples", "5", "--duration", "0.1")


def _numbers(result: Result) -> dict[str, Any]:
    """Everything but where it is and when it was made."""
    return {name: value for name, value in json.loads(result.out).items() if name not in ("store", "provenance")}


@pytest.mark.parametrize("cases", [range(12), pytest.param(range(20, 640), marks=pytest.mark.slow)])
def test_a_damaged_store_is_repaired_or_refused(tmp_path: Path, cases: range) -> None:
    """A finished store with one damaged, emptied or removed file, continued with --resume."""
    whole, broken = tmp_path / "whole.zarr", tmp_path / "broken.zarr"
    made = hfa(*STORED, "--json", "-o", str(whole))
    assert made.code == 0
    files = sorted(path.relative_to(whole) for path in whole.rglob("*") if path.is_file())
    outcomes = Counter[str]()
    for case in cases:
        chance = random.Random(case)
        shutil.copytree(whole, broken)
        file = broken / chance.choice(files)
        match chance.randrange(4):
            case 0:
                file.unlink()
            case 1:
                file.write_bytes(b"")
            case _:
                file.write_bytes(damaged(file.read_bytes(), chance))
        result = hfa(*STORED, "--json", "--resume", "-o", str(broken))
        assert said_wrongly(result) is None, (case, file)
        if result.out:
            assert _numbers(result) == _numbers(made), (case, file)
            assert hfa(*STORED, "--resume", "-o", str(broken)).err == "", "repaired once, and for good"
        outcomes["refused" if result.code == 2 else "repaired" if result.err else "as before"] += 1
        shutil.rmtree(broken)
    assert min(outcomes["repaired"], outcomes["refused"]) > 0
