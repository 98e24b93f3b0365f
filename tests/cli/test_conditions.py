"""One flight condition, named the same way in every command that trims."""

from __future__ import annotations

import json
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


def test_a_named_condition_can_be_changed() -> None:
    peer = answer("linearize", "--dihedral", "10", "--condition", "simvfa-64")["operating_point"]["states"]
    faster = answer("linearize", "--dihedral", "10", "--condition", "simvfa-64", "--speed", "66")["operating_point"][
        "states"
    ]
    assert (peer["speed"], faster["speed"]) == (64.0, 66.0)
    assert peer["alpha"] == faster["alpha"] == pytest.approx(0.05157, abs=1e-5)


def test_the_paper_s_condition_changes_nothing() -> None:
    plain, named = (
        answer("linearize", "--dihedral", "12"),
        answer("linearize", "--dihedral", "12", "--condition", "paper"),
    )
    assert plain["A"] == named["A"]


def test_a_held_alpha_that_is_in_the_way_is_said() -> None:
    refused = hfa("solve", "--dihedral", "10", "--speed", "50")
    assert refused.code == 1
    assert refused.err.rstrip().endswith("alpha is held at 2.8 deg, free it trims at 5.21893 deg: add --free alpha")
    given = hfa("trim", "--dihedral", "10", "--speed", "50", "--alpha", "2")
    assert given.err.rstrip().endswith("leave --hold alpha out and add --free alpha")
    assert hfa("trim", "--dihedral", "10", "--speed", "50", "--free", "alpha").code == 0
    hopeless = hfa("trim", "--dihedral", "10", "--speed", "5", "--altitude", "60000")
    assert "alpha is held" not in hopeless.err


def test_options_of_the_aircraft_do_not_go_with_a_plant(tmp_path: Path) -> None:
    plant = tmp_path / "plant.json"
    plant.write_text(json.dumps({"A": [[-1.0]], "B": [[1.0]], "Q": [[1.0]], "R": [[1.0]]}), encoding="utf-8")
    for words in (("--free", "alpha"), ("--hold", "alpha=2"), ("--condition", "paper")):
        refused = hfa("solve", "--model", str(plant), *words)
        assert refused.code == 2
        assert f"{words[0]} belongs to the aircraft; leave it out with --model" in refused.err
