"""The command `hfa prove cost`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from hfa.main import main
from hfa_boxes.fields import COST_FIELDS
from hfa_proof.subject import entries_of

EXAMPLES = Path(__file__).parents[3] / "examples"
PENDULUM = f"{EXAMPLES / 'pendulum.py'}:PENDULUM"
AIRCRAFT = ("--aircraft", PENDULUM)


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cost") / "cost.json"
    assert main(["prove", "cost", *AIRCRAFT, "--degree", "4", "-o", str(path)]) == 0
    return path


def test_a_bound_is_proved_and_checked(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first line names what the user did not give."""
    assert main(["prove", *AIRCRAFT, "--check", str(certificate)]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.endswith("pendulum: proved, checked, of the weights in the certificate")
    words = ["prove", "cost", *AIRCRAFT, "--Q", "1,1", "--R", "1", "--check", str(certificate)]
    assert main([*words, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["proved"]
    assert data["pieces"][0]["c"] < data["pieces"][-1]["c"]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--Q", "1,2"), "another Q than --Q gives"),
        (("--R", "2"), "another R than --R gives"),
        (("--hold", "angle=0.1"), "another angle than --aircraft gives"),
    ],
)
def test_another_subject_is_named(
    words: tuple[str, ...], reason: str, certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["prove", *AIRCRAFT, *words, "--check", str(certificate)]) in (1, 2)
    assert reason in capsys.readouterr().err


def test_every_field_has_a_use(certificate: Path) -> None:
    content: dict[str, Any] = json.loads(certificate.read_text())["statement"]
    assert {name for name, _ in entries_of(content, COST_FIELDS)} == set(COST_FIELDS)


def test_a_margin_beyond_its_range_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prove", "cost", *AIRCRAFT, "--margin", "2"]) == 2
    assert "--margin must be between 0.0001 and 0.5" in capsys.readouterr().err
