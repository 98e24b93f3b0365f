"""Options of `hfa prove` that contradict each other or the certificate are refused in one line."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from cli import assert_refused, hfa
from stored_certificates import ROOT, read, stored

import hfa as package
from hfa import BadInputError
from hfa_prove.commands import given
from hfa_prove.commands.request import CheckRequest
from hfa_prove.statements.schedule import FixedActuators

PENDULUM = ("--aircraft", f"{ROOT / 'examples' / 'pendulum.py'}:PENDULUM")
GTM = ("--aircraft", f"{ROOT / 'examples' / 'gtm.py'}:GTM")
CERTIFICATES = ROOT / "tests" / "nets" / "certificates"
GAINS = ("--weights", "K.npz")
DEPLOYED = ("--policy", "D.toml")

#: Words after `hfa prove` of each command that proves.
COMMANDS = (
    ("schedule", "--dihedral", "14:14.1"),
    ("solution", "--dihedral", "14"),
    ("critic", "--dihedral", "14", "K.npz"),
    ("region", *PENDULUM),
    ("cost", *PENDULUM),
    ("value", *PENDULUM),
)

#: Words after `hfa prove`, and what the refusal names.
REFUSED: list[tuple[tuple[str, ...], str]] = [
    *(((*words, "-o", "proof.npz"), "must be a .json file") for words in COMMANDS),
    (("schedule", "--dihedral", "14:14.1", "--resume"), "--resume requires"),
    (("region", *PENDULUM, "--resume"), "--resume requires"),
    (("schedule", "--dihedral", "15:14"), "LOW < HIGH"),
    (("schedule", "--dihedral", "14:14"), "LOW < HIGH"),
    (("schedule", "--dihedral", "13:14:15"), "LOW < HIGH"),
    (("schedule", "--dihedral", "14:15", "--bandwidth", "0:9"), "positive"),
    (("schedule", "--dihedral", "14:15", "--delay", "-1", "--bandwidth", "1:9"), "-1"),
    (("schedule", "--dihedral", "14:15", "--delay", "1"), "--bandwidth"),
    (("schedule", "--dihedral", "14:15", "--rate", "--bandwidth", "1:9"), "--rate and --bandwidth"),
    (("schedule", *GTM, "--at", "40:41", "--error", "2"), "remove --error"),
    (("schedule", "--dihedral", "14"), "the interval of dihedral is missing"),
    (("solution", "--dihedral", "14:15"), "one value"),
    (("solution", *PENDULUM), "no scheduling variable"),
    (("region", *PENDULUM, *GAINS, *DEPLOYED), "cannot be combined with --policy"),
    (("region", *PENDULUM, "--basis", "quadratic"), "--basis applies only to W"),
    (("region", *PENDULUM, "--disturbance", "wind=1"), "no disturbance"),
    (("region", *PENDULUM, "--disturbance", "push=-1"), "push"),
    (("region", "--model", "K.npz"), "--model"),
    (("--check", str(CERTIFICATES / "region.json"), *PENDULUM, "--design", "paper"), "--design"),
    (("--check", str(CERTIFICATES / "cost.json"), *PENDULUM, *GAINS), "--weights"),
    (("--check", str(CERTIFICATES / "cost.json"), *PENDULUM, "--delta", "2"), "delta"),
    (("--check", str(CERTIFICATES / "solution.json"), "--basis", "quadratic"), "--basis"),
    (("--check", str(CERTIFICATES / "solution.json"), "--model", "K.npz"), "--model"),
    (("--check", str(CERTIFICATES / "schedule.json"), *DEPLOYED), "--policy"),
    (("--check", str(CERTIFICATES / "schedule.json"), "--design", "paper"), "--design"),
    (("--check", str(CERTIFICATES / "schedule.json"), "--N", "1"), "N"),
    (
        ("region", *PENDULUM, "--check", str(CERTIFICATES / "region.json"), "--degree", "2"),
        "degree",
    ),
    (("cost", *PENDULUM, "--check", str(CERTIFICATES / "cost.json"), "--margin", "0.1"), "margin"),
]


@pytest.mark.parametrize("index", range(len(REFUSED)))
def test_contradicting_options_are_refused(index: int, folder: Path) -> None:
    """A run with options that contradict each other names the option and proves nothing."""
    words, named = REFUSED[index]
    np.savez(folder / "K.npz", K=np.ones((5, 6)))
    (folder / "D.toml").write_text("")
    assert_refused(hfa("prove", *words), 2, named)


def test_each_command_requires_ball_arithmetic(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without python-flint, each command ends in one line before it computes anything."""
    np.savez(folder / "K.npz", K=np.ones((5, 6)))

    def refuse() -> None:
        raise BadInputError("python-flint is missing")

    monkeypatch.setattr("hfa_prove.enclosure.precision.flint_or_refusal", refuse)
    for words in (*COMMANDS, ("--check", str(CERTIFICATES / "solution.json"))):
        assert_refused(hfa("prove", *words), 2, "python-flint is missing")


@pytest.mark.parametrize("stated", [True, False])
def test_actuators_are_given_and_stated_or_neither(
    stated: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gains without actuators are refused for a statement with actuators, and the other way."""
    statement, _ = read(stored("schedule"))
    fixed = FixedActuators((1,) * 5, np.ones(5), np.ones(5), np.ones(5))
    object.__setattr__(statement, "actuators", fixed if stated else None)
    own = SimpleNamespace(controller=statement.controller, actuators=None if stated else fixed)
    monkeypatch.setattr(given, "loop_of_file", lambda *arguments: own)
    request = CheckRequest.parsed(package.aircraft(), {"weights": Path("K.npz")})
    with pytest.raises(BadInputError, match="actuators"):
        given.given_for(statement, request)
    own.actuators = statement.actuators
    entries = given.given_for(statement, request)
    assert ("actuators.order" in entries) is stated
    assert "controller.D" in entries
    assert not any(path.startswith(("flight", "loop", "modes")) for path in entries)


def test_one_scheduling_value_is_read_in_the_unit_of_the_model() -> None:
    """A check about one trim reads one value, an angle in degrees, and refuses an interval."""
    model = package.aircraft()
    request = CheckRequest.parsed(model, {"trim.at": (90.0,)})
    assert given.at_one_value(request).trim.at == pytest.approx(np.pi / 2.0)
    assert given.at_one_value(CheckRequest.parsed(model, {})).trim.at is None
    with pytest.raises(BadInputError, match="give one value"):
        given.at_one_value(CheckRequest.parsed(model, {"trim.at": (14.0, 15.0)}))
