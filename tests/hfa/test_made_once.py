"""A command builds the equations and the condition of a trim only once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from cli import answer

from hfa.options import trim as trim_options
from trim.point.condition import release
from trim.point.system import TrimSystem


def _counted(make: Callable[..., Any], calls: list[str], name: str) -> Callable[..., Any]:
    """Return a function that calls `make` after appending `name` to `calls`."""

    def called(*arguments: Any, **options: Any) -> Any:
        calls.append(name)
        return make(*arguments, **options)

    return called


@pytest.mark.parametrize("options", [["--dihedral", "10"], ["--dihedral", "5", "--free", "gamma"]])
def test_one_trim_makes_one_system_and_one_condition(
    options: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`hfa trim` builds one trim condition, and a TrimSystem for the trim and each of the two
    neighbors of which the sheet shows the change per knot.
    """
    calls: list[str] = []
    begin = _counted(TrimSystem.__init__, calls, "system")
    # Only a count of the calls shows how often it is built.
    monkeypatch.setattr(TrimSystem, "__init__", begin)
    monkeypatch.setattr(trim_options, "release", _counted(release, calls, "condition"))
    assert answer("trim", *options)["status"] == "trimmed"
    assert sorted(calls) == ["condition", "system", "system", "system"]
