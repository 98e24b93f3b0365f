"""Aircraft files that call sys.exit() or are not regular files."""

import os

import pytest
from cli import assert_refused, hfa

AIRCRAFT = """
import sys
from hfa import Model, Signal

calls = []

def equations(x, u, p, w):
    calls.append(1)
    {in_equations}
    return {{"v": u.thrust - x.v}}, {{}}

CAR = Model(
    name="car",
    states={{"v": Signal(nominal=1.0, start=1.0)}},
    inputs={{"thrust": Signal(nominal=1.0)}},
    equations=equations,
    trim={{"v": 1.0}},
)
{at_the_end}
"""


def write_aircraft(path, in_equations="pass", at_the_end=""):
    path.write_text(AIRCRAFT.format(in_equations=in_equations, at_the_end=at_the_end))


@pytest.mark.parametrize("earlier_calls", [0, 1])
def test_equations_that_end_the_program_are_refused(earlier_calls, tmp_path, monkeypatch):
    """sys.exit() in the equations is reported in one line, at their first call, which loads the
    file, or at the second.
    """
    monkeypatch.chdir(tmp_path)
    ends = f"len(calls) > {earlier_calls} and sys.exit()"
    write_aircraft(tmp_path / "late.py", in_equations=ends)
    assert_refused(hfa("trim", "--aircraft", "late.py:CAR"), 2, "sys.exit")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFO on this system")
def test_a_fifo_is_refused_as_aircraft(tmp_path, monkeypatch):
    """A FIFO is refused as an aircraft file without waiting for its content."""
    monkeypatch.chdir(tmp_path)
    for name in ("pipe.py", "pipe.xml"):
        os.mkfifo(name)
    assert_refused(hfa("trim", "--aircraft", "pipe.py:CAR"), 2, "not a regular file")
    pytest.importorskip("hfa_jsbsim")
    assert_refused(hfa("trim", "--aircraft", "pipe.xml"), 2, "not a regular file")
