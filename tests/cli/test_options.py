"""Options: words as numbers, long work announced, too little memory."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cli import assert_refused, hfa

from hfa_cli import output
from hfa_cli.options.argument_types import quantity
from hfa_cli.options.ranges import array_of, value_range
from hfa_cli.output import ProgressLine
from trim.sweeps.sweep_plan import Steps


def test_degrees_become_radians_and_nothing_else_does() -> None:
    assert quantity("dihedral", "180") == quantity("pitch_rate", "180") == math.pi
    assert (quantity("speed", "68"), quantity("panel_mass", "2")) == (68.0, 2.0)


def test_ranges_of_every_form() -> None:
    assert value_range("speed", "60,70") == (60.0, 70.0)
    assert value_range("speed", "60:70:4") == Steps(60.0, 4.0, 3)
    assert value_range("dihedral", "0:180:90") == Steps(0.0, math.pi / 2, 3)
    assert array_of("speed", value_range("speed", "60:70:5"), 3).tolist() == [60.0, 65.0, 70.0]


def test_what_takes_more_than_a_minute_is_announced_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter(range(0, 1000, 2))
    monkeypatch.setattr(output.time, "monotonic", lambda: float(next(clock)))
    long, short = ProgressLine("fly"), ProgressLine("fly")
    for done in range(1, 10):
        long(done, 183)
    assert capsys.readouterr().err == "hfa: note: fly: about 6 minutes more; Ctrl-C ends it\n"
    for done in range(1, 10):
        short(done, 20)
    assert capsys.readouterr().err == ""


def test_too_little_memory_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trim.sweeps.points._newton", lambda *_, **__: np.empty(10**15))
    assert_refused(hfa("sweep", "--dihedral", "0:5:1"), 2, "not enough memory")
