"""Randomly changed certificates of regions on boxes. No false region is accepted."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from mutations import mutate
from tank import LIMITS, TANK

from hfa_prove.certificate import SCHEMA, read_content
from hfa_prove.check.region_boxes import check_region
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Subject
from hfa_prove.statements.region import RegionStatement
from hfa_support.errors import BadInputError, NoSolutionError

SQUARE = Polynomial(1, ((1.0, (2,)),))
QUARTIC = Polynomial(1, ((1.0, (2,)), (0.25, (4,))))
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

    kind: kind of policy
    """
    W, c = (QUARTIC, 0.81 + 0.25 * 0.6561) if kind == "quartic" else (SQUARE, 0.81)
    policy = policy_of(kind)
    gain = Gain(np.array([[2.0]]), {"valve": ((-0.25, (3,)),)})
    at = {"level": 0.0}
    loop = Loop(TANK, {"inflow": 0.5}, at, {"valve": 0.0}, {"slope": 0.25}, LIMITS, policy or gain)
    statement = RegionStatement(loop, at, Piece(np.eye(1), W, c), {"level": (-0.91, 0.91)})
    return {
        **{"schema": SCHEMA, "toolchain": "", "digest": "", "provenance": {}, "checksum": ""},
        "kind": "region",
        "statement": statement.content(),
        "witness": {"prover": "boxes", "multipliers": [[0.4, 0.4]], "boxes": 500},
    }


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


def is_true(statement: RegionStatement, kind: str) -> bool:
    """Return whether the claim of a statement holds on a fine grid of the cube.

    Points within 1e-4 of the equilibrium are not compared.
    """
    loop = statement.loop
    y = np.linspace(-1.0, 1.0, 20_001)
    values = statement.piece.W.at(y[:, None])
    inside = values <= statement.piece.c
    z = y / statement.piece.M[0, 0]
    x = statement.equilibrium["level"] + z
    u = loop.inputs["valve"] + command(statement, kind, x - loop.trim["level"])
    rates = loop.parameters["inflow"] * x + np.clip(u, -1.0, 1.0)
    falls = np.gradient(values, y) * rates * statement.piece.M[0, 0] < 0.0
    low, high = statement.extents["level"]
    holds = (low <= z) & (z <= high)
    limited = {"level": x, "load": 2.0 * x, "slope": np.full_like(x, loop.held["slope"])}
    for name, signal in limited.items():
        least, most = loop.limits[name]
        holds &= (least <= signal) & (signal <= most)
    is_open = not inside[0] and not inside[-1]
    return is_open and bool(np.all(holds[inside] & (falls | (np.abs(z) < 1e-4))[inside]))


@pytest.mark.parametrize("count", [25, pytest.param(250, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["quadratic", "quartic", "network", "deployment"])
def test_no_false_region_is_accepted(kind: str, count: int) -> None:
    """The claim of every changed certificate that is accepted is true.

    At least one and less than half of the changed certificates are accepted.
    """
    rng = np.random.default_rng(0)
    original = content(kind)
    policy = policy_of(kind)
    statement, witness = read_content(copy.deepcopy(original), Subject(TANK, policy))
    assert check_region(statement, witness) > 0
    assert is_true(statement, kind)
    accepted = 0
    for _ in range(count):
        certificate = copy.deepcopy(original)
        mutate(certificate, rng)
        try:
            statement, witness = read_content(certificate, Subject(TANK, policy))
            check_region(statement, witness)
        except (BadInputError, NoSolutionError):
            continue
        accepted += 1
        assert is_true(statement, kind), certificate
    assert 0 < accepted < count / 2
