"""Randomly changed certificates of regions. No false region is accepted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from mutations import accepted_claims
from proofs import certificate
from tank import LIMITS, TANK

from hfa_prove.certificate import read_content
from hfa_prove.check.region_boxes import check_region
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Subject
from hfa_prove.statements.region import RegionStatement

#: V and its level at |level| = 0.9.
SQUARE = Polynomial(1, ((1.0, (2,)),)), 0.81
QUARTIC = Polynomial(1, ((1.0, (2,)), (0.25, (4,)))), 0.81 + 0.25 * 0.6561
#: Deviations at which a claim is tested, densest near 0.
DEVIATIONS = np.sinh(np.linspace(-12.0, 12.0, 200_001)) * 1e-2
WEIGHTS = np.array([[1.5, -0.75], [-1.0, 2.0]])


def network(z: Any, tanh: Callable[[Any], Any]) -> Any:
    """Return the command of a network with two hidden units at the deviation z."""
    return sum(out * tanh(weight * z) for weight, out in zip(*WEIGHTS.tolist(), strict=True))


def deployed(z: Any, level: Any, clip: Callable[[Any], Any]) -> Any:
    """Return the command of a deployed policy at z, relative to its command at the trim.

    level: level at the trim. The policy observes z + level.
    clip: saturation
    """
    return 1.5 * clip(1.25 * (z + level)) - 1.5 * clip(1.25 * level)


def policy_of(kind: str) -> ca.Function | None:
    """Return the user's policy as a function, or None for a gain. A certificate contains the gain
    itself.

    kind: "network", "deployment" or a kind of gain
    """
    z = ca.SX.sym("z")
    trim = ca.SX.sym("trim", 4)
    if kind == "network":
        return ca.Function("u", [z], [network(z, ca.tanh)])
    if kind == "deployment":
        command = deployed(z, trim[0], lambda each: ca.fmin(ca.fmax(-each, -0.75), 0.75))
        return ca.Function("u", [z, trim], [command])
    return None


def content(kind: str) -> dict[str, Any]:
    """Return a true certificate of the region |level| <= 0.9.

    kind: kind of policy, or "quadratic" or "quartic" for the kind of V
    """
    W, c = QUARTIC if kind == "quartic" else SQUARE
    policy = policy_of(kind)
    gain = Gain(np.array([[2.0]]), {"valve": ((-0.25, (3,)),)})
    at = {"level": 0.0}
    loop = Loop(TANK, {"inflow": 0.5}, at, {"valve": 0.0}, {"slope": 0.25}, LIMITS, policy or gain)
    statement = RegionStatement(loop, at, Piece(np.eye(1), W, c), {"level": (-0.91, 0.91)})
    return certificate("region", statement, {"multipliers": [[0.4, 0.4]], "boxes": 500})


def command(statement: RegionStatement, kind: str, z: np.ndarray) -> np.ndarray:
    """Return the command of the statement's policy at deviations z from the trim, (N,), by
    NumPy.
    """
    if kind == "network":
        return np.asarray(network(z, np.tanh))
    if kind == "deployment":
        level = np.array(statement.loop.trim["level"])
        return np.asarray(deployed(z, level, lambda each: np.clip(-each, -0.75, 0.75)))
    assert isinstance(statement.loop.policy, Gain)
    terms = statement.loop.policy.terms.get("valve", ())
    return -statement.loop.policy.K[0, 0] * z + sum(
        value * z ** powers[0] for value, powers in terms
    )


def rates(statement: RegionStatement, kind: str, x: np.ndarray) -> np.ndarray:
    """Return the rate of the tank's level at levels x."""
    loop = statement.loop
    u = loop.inputs["valve"] + command(statement, kind, x - loop.trim["level"])
    return np.asarray(loop.parameters["inflow"] * x + np.clip(u, -1.0, 1.0))


def is_true(statement: RegionStatement, kind: str) -> bool:
    """Return whether the claim of a statement holds at `DEVIATIONS` from the equilibrium.

    Points within 1e-4 of the equilibrium are not compared. The set must end before the faces of its
    cube.
    """
    loop = statement.loop
    level = np.array([loop.trim["level"]])
    for _ in range(20):  # the closed loop's slope is about -1.5
        level = level + rates(statement, kind, level) / 1.5
    if not abs(level[0] - statement.equilibrium["level"]) < 1e-5:
        return False
    z = DEVIATIONS
    y = statement.piece.M[0, 0] * z
    V = statement.piece.W.at(y[:, None])
    slope = np.gradient(V, z)
    is_in_cube = np.abs(y) < 1.0
    inside = (statement.rho >= V) & is_in_cube
    at_faces = (statement.rho >= V) & ~is_in_cube & (np.abs(y) < 1.001)
    falls = slope * rates(statement, kind, level + z) < 0.0
    low, high = statement.extents["level"]
    holds = (low <= z) & (z <= high) & (falls | (np.abs(z) < 1e-4))
    x = level + z
    limited = {"level": x, "load": 2.0 * x, "slope": np.full_like(x, loop.held["slope"])}
    for name, signal in limited.items():
        least, most = loop.limits[name]
        holds &= (least <= signal) & (signal <= most)
    return bool(np.all(holds[inside])) and not at_faces.any()


@pytest.mark.parametrize("count", [16, pytest.param(250, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["quadratic", "quartic", "network", "deployment"])
def test_no_false_region_is_accepted(kind: str, count: int) -> None:
    """The claim of every changed certificate that is accepted is true.

    At least one and less than half of the changed certificates are accepted.
    """
    subject = Subject(TANK, policy_of(kind))
    found = accepted_claims(
        content(kind), subject, check_region, partial(is_true, kind=kind), count
    )
    assert 0 < found < count / 2


def test_false_claims_about_the_tank_are_rejected() -> None:
    """`is_true` rejects a level that is too high, extents that are too narrow, and a negative V.

    Levels of V above 1.2 exceed the limits.
    """
    statement, _ = read_content(content("quadratic"), Subject(TANK))
    piece = statement.piece
    assert is_true(statement, "quadratic")
    assert not is_true(
        replace(statement, piece=piece._replace(c=1.5, M=0.5 * piece.M)), "quadratic"
    )
    assert not is_true(replace(statement, extents={"level": (-0.8, 0.91)}), "quadratic")
    negative = piece._replace(W=piece.W._replace(terms=((-1.0, (2,)),)))
    assert not is_true(replace(statement, piece=negative), "quadratic")
