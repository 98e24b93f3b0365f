"""Refusals of `hfa fly` and `hfa export`: one line with cause and remedy."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from cli import assert_refused, hfa

from hfa.main import BAD_INPUT


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (
            "fly --dihedral 15 --law exact --seed 3",
            "--seed applies only to --turbulence, --samples and --draws; remove this option",
        ),
        ("fly --dihedral 15 --gust 400:10 --turbulence own:5:1750", "cannot be combined"),
        ("fly --dihedral 15 --fault 0.2:0.5", "--fault requires actuators"),
        ("fly --dihedral 15 --command gamma=1:1", "a gain cannot follow a command of 'gamma'"),
        (
            "fly --dihedral 15 --duration 1e8",
            "duration is 1e+08 s; give at most 10000 s with a step of 0.001 s",
        ),
        ("fly --dihedral 15 --delay 1e-9", "delay is 1e-09 s; give a multiple of the tick"),
        ("fly --dihedral 15 --resume", "--resume applies only to --samples"),
        (
            "fly --dihedral 15 -o a.zarr",
            "a.zarr is a store for the flights of --samples or --draws; add --samples N",
        ),
        ("fly --dihedral 15 --samples 2 --resume", "-o FILE.zarr"),
        ("fly --dihedral 15 --samples 2 -o a.json", "are written to a Zarr store"),
        (
            "fly --dihedral 15 --samples 2 --picture a.png",
            "--picture applies only to a single flight or --draws",
        ),
        ("export -o 1st.m", "1st.m: the file name is not a name of a function"),
        ("export ", "the following arguments are required: --output"),
        (
            "export -o aircraft.zip",
            "aircraft.zip: the suffix '.zip' is unknown; use .fmu, .m, or a folder",
        ),
        (
            "export -o out --set activation=tanh",
            "--set applies only to a network",
        ),
        (
            "export -o out --actuators 0.5:60",
            "--actuators applies only to --controller; remove this option",
        ),
    ],
)
def test_wrong_options_of_fly_and_export_are_refused(folder: Path, words: str, named: str) -> None:
    """Wrong options of `hfa fly` and `hfa export` are refused in one line, and no file is written."""
    assert_refused(hfa(*words.split()), BAD_INPUT, named)
    assert list(folder.iterdir()) == []


def test_the_matlab_function_is_written_under_its_name(folder: Path) -> None:
    result = hfa("export", "-o", "models.m")
    assert (result.code, result.err) == (0, "")
    assert "models.m" in result.out
    assert (folder / "models.m").read_text().lstrip().startswith("function")


def test_an_export_does_not_replace_a_fifo(folder: Path) -> None:
    """An export to a path that is a named pipe is refused, and the pipe remains."""
    os.mkfifo("a.fmu")
    refused = hfa("export", "--dihedral", "15", "-o", "a.fmu")
    assert_refused(refused, BAD_INPUT, "is not a regular file; choose another")
    assert (folder / "a.fmu").is_fifo()
