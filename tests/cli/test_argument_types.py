"""Words of the command line as numbers."""

from __future__ import annotations

import math
from argparse import ArgumentTypeError

import pytest
from cli import hfa

from hfa_cli.main import COMMANDS
from hfa_cli.options.argument_types import angle, quantity, whole
from hfa_cli.options.ranges import Span, array_of, value_range
from trim import Steps


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


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_can_be_quiet(command: str) -> None:
    assert "-q, --quiet" in hfa(command, "--help").out


@pytest.mark.parametrize("words", ["-4:4:4", "-4,4"])
def test_a_range_may_begin_with_a_minus(words: str) -> None:
    assert hfa("sweep", "--dihedral", words, "-q").code == 0


def test_of_an_option_that_comes_twice_the_last_value_holds() -> None:
    assert hfa("trim", "--dihedral", "5", "--dihedral", "15").out == hfa("trim", "--dihedral", "15").out.replace(
        "hfa trim --dihedral 15", "hfa trim --dihedral 5 --dihedral 15"
    )
