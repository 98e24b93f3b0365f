"""Proved regions of the pendulum in the examples, as data for tests of the checker."""

from __future__ import annotations

import contextlib
import io
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from forged_regions import forgeries
from nominal import nominal_game

import hfa
from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_prove.certificate import read_content, write_certificate
from hfa_prove.check.region_boxes import check_region as check_on_boxes
from hfa_prove.check.region_squares import check_region
from hfa_prove.fields import NOT_PROVED
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.problem import loop_at
from hfa_prove.search.clock import Clock
from hfa_prove.search.invariant import EdgeSearch
from hfa_prove.search.level import LevelSearch, Setting, accepted, holding_ball
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.plant import Subject
from hfa_prove.statements.region import BoxWitness

EXAMPLES = Path(__file__).parents[4] / "examples"
PENDULUM = f"{EXAMPLES / 'pendulum.py'}:PENDULUM"
VAN_DER_POL = f"{EXAMPLES / 'pendulum.py'}:VAN_DER_POL"
#: V of a region of the pendulum, found by a search.
V = PolynomialFunction.quadratic(np.array([[2.648, 0.1393], [0.1393, 0.06878]]))


@pytest.fixture(scope="module")
def model() -> Model:
    """Return the pendulum."""
    return load_model(PENDULUM)


def proved(path: Path, aircraft: str, *words: str) -> str:
    """Prove a region by the command, write its certificate to `path`, and return the output.

    aircraft: argument of --aircraft
    words: further arguments
    """
    command = ["prove", "region", "--aircraft", aircraft, "-q", "-o", str(path), *words]
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main(command) == 0
    return printed.getvalue()


def quickly_proved(path: Path, aircraft: str, *words: str) -> str:
    """Prove a region quickly, with V of degree 2, as `proved` does."""
    return proved(path, aircraft, "--degree", "2", "--seconds", "20", "--prover", "squares", *words)


def pendulum_loop(model: Model) -> Loop:
    """Return the closed loop of the pendulum with the LQR that `hfa prove region` uses."""
    linear = hfa.linearize(model, hfa.trim(model))
    return loop_at(linear, Gain(hfa.solve(nominal_game(linear)).K))


def certified(path: Path, loop: Loop, rho: float) -> Path:
    """Write the certificate of one level rho of V, proved without a search, and return its path."""
    search = EdgeSearch if loop.disturbances else LevelSearch
    T = holding_ball(V, rho, V.coordinates(), Clock(600.0))
    assert T is not None
    level = accepted(search(loop, V, rho, T, Setting(8, 4, 2), Clock(600.0)))
    assert level is not None
    origin = {"version": "0.3.0", "command": "a test", "date": "2026-01-01"}
    write_certificate(path, level.statement, level.witness, origin)
    return path


def read_and_check(content: dict[str, Any], model: Model) -> int:
    """Return the number of proved parts in the content of a certificate.

    The digest is not tested. Raises one of `NOT_PROVED` if the checker refuses the content.
    """
    closing = dict.fromkeys(("schema", "toolchain", "digest", "provenance", "checksum"))
    statement, witness = read_content(closing | content, Subject(model))
    check = check_on_boxes if isinstance(witness, BoxWitness) else check_region
    return check(statement, witness)


def passes(content: dict[str, Any], model: Model) -> bool:
    """Return whether the checker accepts the content, without a test of its digest."""
    try:
        read_and_check(content, model)
    except NOT_PROVED:
        return False
    return True


def accepted_forgeries(
    certificate: Path, model: Model, count: int, seed: int = 0
) -> tuple[set[str], list[str]]:
    """Return the kinds of forgeries that were tried, and the name of each accepted forgery.

    certificate: a valid certificate
    count: number of forgeries
    """
    content = json.loads(certificate.read_text())
    assert passes(content, model)
    tried: Counter[str] = Counter()
    wrong = []
    for name, forged in forgeries(content, count, seed):
        tried[name] += 1
        if passes(forged, model):
            wrong.append(name)
    return set(tried), wrong
