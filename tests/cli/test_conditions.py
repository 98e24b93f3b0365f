"""One flight condition, named the same way in every command that trims."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli import answer, hfa

#: Commands that trim, in their shortest form.
TRIMMING = {"trim": (), "linearize": (), "solve": (), "learn": (), "verify": ()}


def test_it_matters_which_variable_is_held() -> None:
    """At 10 deg and 60 ft/s: alpha held as in the paper, or free with the outer aileron at 0."""
    words = ("--dihedral", "10", "--speed", "60")
    held, free = (
        answer("linearize", *words),
        answer("linearize", *words, "--free", "alpha", "--hold", "aileron_outer=0"),
    )
    short_periods = [
        next(mode for mode in found["modes"] if mode["name"] == "short period")["eigenvalue"] for found in (held, free)
    ]
    assert short_periods[0] == pytest.approx([-4.64, 9.13], abs=5e-3)
    assert short_periods[1] == pytest.approx([-3.64, 9.48], abs=5e-3)


@pytest.mark.parametrize("command", TRIMMING)
def test_every_command_takes_the_condition(command: str, tmp_path: Path) -> None:
    """A condition that cannot be trimmed is refused by each: so each has used it."""
    rest = TRIMMING[command]
    words = ("--dihedral", "10", *rest, "--speed", "60", "--free", "alpha", "--hold", "aileron_outer=0.5")
    assert hfa(command, *words).code == 0
    refused = hfa(command, *words, "--limit", "throttle=0:5")
    assert (refused.code, refused.out) == (1, "")
    assert refused.err.startswith("hfa: no trim: ")
    own = tmp_path / "own.toml"
    own.write_text("[impose]\nspeed = 5.0\n", encoding="utf-8")
    assert hfa(command, "--dihedral", "10", *rest, "--condition", str(own)).code == 1
    own.write_text("[impose]\nspeeed = 5.0\n", encoding="utf-8")
    wrong = hfa(command, "--dihedral", "10", *rest, "--condition", str(own))
    assert (wrong.code, wrong.err.count("\n")) == (2, 1)
    assert "unknown trim variable 'speeed'" in wrong.err


def test_a_held_alpha_that_is_in_the_way_is_said() -> None:
    refused = hfa("solve", "--dihedral", "10", "--speed", "50")
    assert refused.code == 1
    assert refused.err.rstrip().endswith("alpha is held at 2.8 deg, free it trims at 5.21893 deg: add --free alpha")
    given = hfa("trim", "--dihedral", "10", "--speed", "50", "--alpha", "2")
    assert given.err.rstrip().endswith("leave --hold alpha out and add --free alpha")
    assert hfa("trim", "--dihedral", "10", "--speed", "50", "--free", "alpha").code == 0
    hopeless = hfa("trim", "--dihedral", "10", "--speed", "5", "--altitude", "60000")
    assert "alpha is held" not in hopeless.err
