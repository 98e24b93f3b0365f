"""Randomly changed certificates by sums of squares. No false region is accepted."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mutations import mutate
from tank import LIMITS, TANK

from hfa_prove.certificate import read_content
from hfa_prove.check.region_squares import check_region
from hfa_prove.fields import NOT_PROVED
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search.clock import Clock
from hfa_prove.search.level import LevelSearch, Setting, accepted, holding_ball
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.plant import Subject
from hfa_prove.statements.region import RegionStatement

#: Quadratic and quartic V with the level that is proved.
FUNCTIONS = {
    "quadratic": ([[1.0, (2,)]], 0.81, Setting(6, 3, 2)),
    "quartic": ([[1.0, (2,)], [0.25, (4,)]], 0.81 + 0.25 * 0.6561, Setting(7, 4, 4)),
}
#: Deviations at which a claim is tested, densest near 0.
DEVIATIONS = np.sinh(np.linspace(-12.0, 12.0, 40_001)) * 1e-2


def content(kind: str) -> dict[str, Any]:
    """Return a true certificate of the region |level| <= 0.9.

    kind: kind of V, "quadratic" or "quartic"
    """
    terms, rho, setting = FUNCTIONS[kind]
    loop = Loop(
        TANK,
        {"inflow": 0.5},
        {"level": 0.0},
        {"valve": 0.0},
        {"slope": 0.25},
        LIMITS,
        Gain(np.array([[2.0]]), {"valve": ((-0.25, (3,)),)}),
    )
    V = PolynomialFunction.of_terms([(value, powers) for value, powers in terms])
    T = holding_ball(V, rho, V.coordinates(), Clock(600.0))
    assert T is not None
    level = accepted(LevelSearch(loop, V, rho, T, setting, Clock(600.0)))
    assert level is not None
    closing = dict.fromkeys(("schema", "toolchain", "digest", "provenance", "checksum"))
    claims = {"statement": level.statement.content(), "witness": level.witness}
    return {**closing, "kind": "region", **copy.deepcopy(claims)}


def is_true(statement: RegionStatement) -> bool:
    """Return whether the claim of a statement is true at `DEVIATIONS` from the equilibrium.

    Points within 1e-4 of the equilibrium are not compared.
    """
    loop = statement.loop
    x0 = loop.trim["level"]
    x = x0
    for _ in range(20):  # the closed loop's slope is about -1.5
        x += float(_rates(loop, np.array(x))) / 1.5
    z = DEVIATIONS
    M = statement.piece.M[0, 0]
    V = sum(value * (M * z) ** powers[0] for value, powers in statement.terms)
    slope = sum(
        value * powers[0] * M * (M * z) ** (powers[0] - 1) for value, powers in statement.terms
    )
    inside = (np.asarray(V) <= statement.rho) & (statement.piece.whole | (np.abs(M * z) < 1.0))
    falls = np.asarray(slope) * _rates(loop, x + z) < 0.0
    low, high = statement.extents["level"]
    holds = (low <= z) & (z <= high) & (falls | (np.abs(z) < 1e-4))
    limited = {"level": x + z, "load": 2.0 * (x + z), "slope": np.full_like(z, loop.held["slope"])}
    for name, signal in limited.items():
        least, most = loop.limits[name]
        holds &= (least <= signal) & (signal <= most)
    is_near = abs(x - statement.equilibrium["level"]) < 1e-5
    return is_near and bool(np.all(holds[inside]))


def _rates(loop: Loop, x: np.ndarray) -> np.ndarray:
    """Return the rate of the tank's level at levels x."""
    z = x - loop.trim["level"]
    curved = sum(value * z ** powers[0] for value, powers in loop.gain.terms.get("valve", ()))
    u = loop.inputs["valve"] - loop.gain.K[0, 0] * z + curved
    return np.asarray(loop.parameters["inflow"] * x + np.clip(u, -1.0, 1.0))


@pytest.mark.parametrize("count", [60, pytest.param(1000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", FUNCTIONS)
def test_no_false_region_of_squares_is_accepted(kind: str, count: int) -> None:
    """The claim of every accepted mutated certificate is true.

    At least one mutated certificate is accepted, and at least one is refused.
    """
    rng = np.random.default_rng(0)
    original = content(kind)
    statement, witness = read_content(copy.deepcopy(original), Subject(TANK))
    assert check_region(statement, witness) > 0
    assert is_true(statement)
    accepted_claims = 0
    for _ in range(count):
        certificate = copy.deepcopy(original)
        mutate(certificate, rng)
        try:
            statement, witness = read_content(certificate, Subject(TANK))
            check_region(statement, witness)
        except NOT_PROVED:
            continue
        accepted_claims += 1
        assert is_true(statement), certificate
    assert 0 < accepted_claims < count


def test_false_claims_about_the_tank_are_rejected() -> None:
    """`is_true` rejects a level that is too high, extents that are too narrow, and a negative V.

    Levels of V above 1.2 exceed the limits.
    """
    statement, _ = read_content(content("quadratic"), Subject(TANK))
    piece = statement.piece
    assert not is_true(replace(statement, piece=piece._replace(c=1.5)))
    assert not is_true(replace(statement, extents={"level": (-0.8, 0.91)}))
    negative = piece._replace(W=piece.W._replace(terms=((-1.0, (2,)),)))
    assert not is_true(replace(statement, piece=negative))
