"""Words of the command line as numbers, and the hostile ones among them: one line, exit code 2."""

from __future__ import annotations

import math
from argparse import ArgumentTypeError
from pathlib import Path

import pytest
from cli import assert_refused, hfa

from hfa_cli.main import BAD_INPUT, COMMANDS
from hfa_cli.options.argument_types import angle, quantity, whole
from hfa_cli.options.ranges import Span, array_of, value_range
from trim import Steps

DIGITS = "9" * 5000


def test_degrees_become_radians_and_nothing_else_does() -> None:
    assert angle("180") == quantity("dihedral", "180") == quantity("pitch_rate", "180") == math.pi
    assert (quantity("speed", "68"), quantity("panel_mass", "2")) == (68.0, 2.0)


def test_a_large_whole_number_is_not_rounded() -> None:
    assert (whole(0)("9007199254740993"), whole(0)("1e3")) == (9007199254740993, 1000)
    with pytest.raises(ArgumentTypeError, match="give a whole number from 1 to 5"):
        whole(1, 5)("6")


def test_ranges_of_every_form() -> None:
    assert value_range("speed", "60,70") == (60.0, 70.0)
    assert value_range("speed", "60:70") == Span(60.0, 70.0)
    assert value_range("speed", "60:70:4") == Steps(60.0, 4.0, 3)
    assert value_range("dihedral", "0:180:90") == Steps(0.0, math.pi / 2, 3)
    assert array_of("speed", value_range("speed", "60:70:5"), 3).tolist() == [60.0, 65.0, 70.0]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        # "--" is where options end, and no value of one.
        ("sweep --dihedral 0:5:1 --samples=--", "--samples is '--'; give a value"),
        ("sweep --dihedral 0:5:1 --picture=--", "--picture is '--'"),
        ("trim --dihedral=--", "--dihedral is '--'"),
        ("trim --dihedral 15 --hold=--", "--hold is '--'"),
        ("trim --dihedral 15 -o--", "-o is '--'"),
        ("fly --dihedral 15 --duration=--", "--duration is '--'"),
        ("trim --dihedral 15 -- --speed", "unrecognized arguments: "),
        # Numbers that no computer has.
        (f"trim --dihedral {DIGITS}", "--dihedral is 9999"),
        (f"identify --seed {DIGITS}", "--seed is 9999"),
        (f"sweep --dihedral 0:{DIGITS}:1", "--dihedral stop is 9999"),
        (f"learn --dihedral 15 --set samples={DIGITS}", "samples is 9999"),
        ("identify --seed 1e308", "--seed is 1e308; give a whole number from 0 to 1e+18"),
        ("sweep --dihedral 0:5:1 -o a.zarr --workers 1e308", "--workers is 1e308; give a whole number from 1 to 1000"),
        ("sweep --dihedral 0:5 -o a.zarr --samples 1e308", "--samples is 1e308; give a whole number from 1"),
        ("learn --dihedral 15 --set samples=1e308", "samples is 1e308; give a whole number"),
        ("learn --dihedral 15 --set tick=1e-320", "a number is too large or too small to compute with"),
        # Names that nobody wants to read, or that a terminal would obey.
        (f"trim --dihedral {'x' * 5000}", "--dihedral is 'xxxx"),
        (f"trim --{'x' * 5000}", "unknown option --xxxx"),
        ("x" * 5000, "unknown command 'xxxx"),
        ("trim --dihedral \x1b[31m", "--dihedral is '\\x1b[31m'"),
        ("trim --\x1b[31m", "unknown option --\\x1b[31m"),
        ("trim --dihedral 15 -o \x1b[31m.json/a.json", "the folder \\x1b[31m.json does not exist"),
    ],
)
def test_hostile_words(folder: Path, words: str, named: str) -> None:
    result = hfa(*words.split())
    assert_refused(result, BAD_INPUT, named)
    assert result.err.rstrip("\n").isprintable()
    assert len(result.err) < 300
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("trim --dihedrl 15", "unknown option --dihedrl; did you mean --dihedral?"),
        ("trim --dihedrl=15", "unknown option --dihedrl; did you mean --dihedral?"),
        ("trim --dihedral abc --quite", "unknown option --quite; did you mean --quiet?"),
        ("sweep --worker 2", "unknown option --worker; did you mean --workers?"),
        ("trim -d 15", "unknown option -d (see `hfa trim --help`)"),
        ("trim --dihedral", "--dihedral expected one argument"),
        ("trim", "the following arguments are required: --dihedral (see `hfa trim --help`)"),
    ],
)
def test_an_unknown_option_is_named_before_a_missing_one(words: str, line: str) -> None:
    assert hfa(*words.split()) == (BAD_INPUT, "", f"hfa: {line}\n")


@pytest.mark.parametrize(
    ("option", "name", "text"),
    [
        ("--parameters", "digits.toml", f"[chord]\nvalue = {DIGITS}\n"),
        ("--parameters", "brackets.toml", f"x = {'[' * 100_000}"),
        ("--start", "digits.json", f'{{"speed": {DIGITS}}}'),
        ("--start", "brackets.json", "[" * 100_000),
    ],
)
def test_files_of_digits_or_brackets_without_end(folder: Path, option: str, name: str, text: str) -> None:
    (folder / name).write_text(text, encoding="utf-8")
    assert_refused(hfa("trim", "--dihedral", "15", option, name), BAD_INPUT, f"{option} {name}: ")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_can_be_quiet(command: str) -> None:
    assert "-q, --quiet" in hfa(command, "--help").out
