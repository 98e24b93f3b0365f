"""Damaged files of every kind: a result, or one line and exit code 2; no traceback and nothing left behind."""

from __future__ import annotations

import json
import shutil
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import Result, assert_refused, hfa
from damage import damaged
from game_files import small
from ways_in import CONDITION

from hfa_model import default_parameters, save_parameters

#: Warnings are what the command makes of them, as they are for its users.
pytestmark = pytest.mark.filterwarnings("default")

WORDS = {
    "parameters.toml": ("trim", "--dihedral", "15", "--parameters"),
    "condition.toml": ("trim", "--dihedral", "15", "--condition"),
    "point.json": ("trim", "--dihedral", "15", "--start"),
    "plant.json": ("solve", "--model"),
    "plant.npz": ("solve", "--model"),
    "plant.mat": ("solve", "--model"),
    "critic.json": ("verify", "--dihedral", "15", "--weights"),
    "critic.npz": ("verify", "--dihedral", "15", "--weights"),
    "critic.mat": ("verify", "--dihedral", "15", "--weights"),
}
STORED = ("monte-carlo", "--dihedral", "15", "--law", "exact", "--members", "5", "--duration", "0.1")


def _write(path: Path) -> None:
    if path.name == "parameters.toml":
        save_parameters(default_parameters(), path, "a copy")
    elif path.name == "condition.toml":
        path.write_text(CONDITION, encoding="utf-8")
    elif path.name == "point.json":
        assert hfa("trim", "--dihedral", "14", "-o", str(path)).code == 0
    elif path.stem == "plant":
        small(path)
    else:
        critic = path.with_name(f"gain{path.suffix}")
        assert hfa("solve", "--dihedral", "15", "-o", str(critic)).code == 0
        critic.rename(path)


def _check(result: Result, case: object) -> None:
    """Exit 0 or 1 and a result, with notes; or exit 2 and one line."""
    lines = result.err.splitlines()
    assert "Traceback" not in result.err, case
    if result.out:
        assert result.code in (0, 1), case
        assert all(line.startswith("hfa: ") for line in lines), (case, lines)
    else:
        assert result.code in (1, 2), case
        assert len(lines) == 1, (case, lines)
        assert len(lines[0]) < 1200, case
        assert all(letter.isprintable() for letter in lines[0]), case


def _try(folder: Path, name: str, cases: range) -> Counter[int]:
    """Exit codes of the command of a file for damage number `cases`."""
    path = folder / name
    _write(path)
    content, codes = path.read_bytes(), Counter[int]()
    for case in cases:
        path.write_bytes(damaged(content, np.random.default_rng((zlib.crc32(name.encode()), case))))
        result = hfa(*WORDS[name], str(path))
        _check(result, (name, case))
        codes[result.code] += 1
    assert [left.name for left in folder.iterdir()] == [name]
    return codes


@pytest.mark.parametrize("name", WORDS)
def test_a_damaged_file_is_a_result_or_one_line(tmp_path: Path, name: str) -> None:
    assert _try(tmp_path, name, range(12))[2] > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", WORDS)
def test_many_damaged_files(tmp_path: Path, name: str) -> None:
    assert _try(tmp_path, name, range(30, 1530))[2] > 0


def _numbers(result: Result) -> dict[str, Any]:
    """Everything but where it is and when it was made."""
    return {name: value for name, value in json.loads(result.out).items() if name not in ("store", "provenance")}


def _try_stores(folder: Path, cases: range) -> Counter[str]:
    """What became of a finished store with one damaged, emptied or removed file, continued with --resume."""
    whole, broken = folder / "whole.zarr", folder / "broken.zarr"
    told = hfa(*STORED, "--json", "-o", str(whole))
    assert told.code == 0
    expected = _numbers(told)
    files = sorted(path.relative_to(whole) for path in whole.rglob("*") if path.is_file())
    outcomes = Counter[str]()
    for case in cases:
        rng = np.random.default_rng(case)
        shutil.copytree(whole, broken)
        file = broken / files[rng.integers(len(files))]
        match int(rng.integers(4)):
            case 0:
                file.unlink()
            case 1:
                file.write_bytes(b"")
            case _:
                file.write_bytes(damaged(file.read_bytes(), rng))
        result = hfa(*STORED, "--json", "--resume", "-o", str(broken))
        _check(result, (case, file))
        if result.out:
            assert _numbers(result) == expected, (case, file)
            assert hfa(*STORED, "--resume", "-o", str(broken)).err == "", "repaired once, and for good"
        outcomes["refused" if result.code == 2 else "repaired" if result.err else "as before"] += 1
        shutil.rmtree(broken)
    return outcomes


def test_a_damaged_store_is_repaired_or_refused(tmp_path: Path) -> None:
    outcomes = _try_stores(tmp_path, range(12))
    assert outcomes["repaired"] > 2
    assert outcomes["refused"] > 2


@pytest.mark.slow
def test_many_damaged_stores(tmp_path: Path) -> None:
    assert _try_stores(tmp_path, range(20, 640))["repaired"] > 100


def test_values_of_files_are_repeated_shortly_and_spelled(tmp_path: Path) -> None:
    path = tmp_path / "condition.toml"
    path.write_text(f'free = "{"long" * 2000}"', encoding="utf-8")
    result = hfa(*WORDS[path.name], str(path))
    assert_refused(result, 2, "free is 'longlong", "...; give a list of names")
    assert len(result.err) < 400
    path.write_text(f"x = {'9' * 5000}", encoding="utf-8")
    assert_refused(hfa(*WORDS[path.name], str(path)), 2, "is not a TOML file")
    path.write_text(f"free = 0x{'f' * 5000}", encoding="utf-8")
    assert_refused(hfa(*WORDS[path.name], str(path)), 2, "free is a number of thousands of digits")
    path.write_text('"\\u001b[31mred" = 1', encoding="utf-8")
    result = hfa(*WORDS[path.name], str(path))
    assert_refused(result, 2, "unknown entry")
    assert "\x1b" not in result.err
