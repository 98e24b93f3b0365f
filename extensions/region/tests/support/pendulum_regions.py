"""Proved regions of the example's pendulum, and what the checker takes."""

from __future__ import annotations

import contextlib
import io
import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from forged_regions import forgeries

from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_proof.checker.reading import NOT_PROVED
from hfa_region.check.certificate import read_content
from hfa_region.check.checker import check_region

EXAMPLES = Path(__file__).parents[4] / "examples"
PENDULUM = f"{EXAMPLES / 'pendulum.py'}:PENDULUM"
VAN_DER_POL = f"{EXAMPLES / 'pendulum.py'}:VAN_DER_POL"


@pytest.fixture(scope="module")
def model() -> Model:
    """The pendulum."""
    return load_model(PENDULUM)


def proved(path: Path, aircraft: str, *words: str) -> str:
    """Write a new certificate; what was printed."""
    command = ["prove", "region", "--aircraft", aircraft, "-q", "-o", str(path), *words]
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main(command) == 0
    return printed.getvalue()


def quickly_proved(path: Path, *words: str) -> Path:
    """The certificate of a region of the pendulum, V of degree 2; what was printed is beside it in
    a file .printed."""
    printed = proved(path, PENDULUM, "--degree", "2", "--seconds", "0.1", *words)
    path.with_suffix(".printed").write_text(printed)
    return path


def accepted(content: dict[str, Any], model: Model) -> bool:
    """Whether the checker accepts content, a digest set aside."""
    try:
        check_region(*read_content(content, model))
    except NOT_PROVED:
        return False
    return True


def accepted_forgeries(
    certificate: Path, model: Model, count: int, seed: int = 0
) -> tuple[set[str], list[str]]:
    """The kinds of so many forgeries of a certificate, which the checker accepts itself; and the
    name of each forgery that it accepts too."""
    content = json.loads(certificate.read_text())
    assert accepted(content, model)
    tried: Counter[str] = Counter()
    wrong = []
    for name, forged in forgeries(content, count, seed):
        tried[name] += 1
        if accepted(forged, model):
            wrong.append(name)
    return set(tried), wrong
