"""`hfa prove value`: the equation of the nonlinear game in balls, and forged certificates."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from cli import answer, hfa
from flint import arb, ctx
from known_models import game_at, model_at
from project import ROOT

import hfa as package
from hfa import BadInputError, LinearModel, Model, NoSolutionError, Signal
from hfa_prove.certificate import sealed
from hfa_prove.check.value import ValueEquation, check_value
from hfa_prove.fields import Rejected
from hfa_prove.search.value import ValueProof, prove_value
from hfa_prove.statements.flight import Line
from hfa_prove.statements.value import LARGEST_RESIDUAL, ValueStatement, ValueWitness

PENDULUM = ("--aircraft", f"{ROOT}/examples/pendulum.py:PENDULUM")
#: Changes of one coefficient: a percent, the sign, and degrees instead of radians.
FACTORS = (1.01, -1.0, 180.0 / np.pi)


def mixed(x, u, p, w):
    """Return a plant without symmetry that is not affine in its inputs."""
    rates = {
        "a": -ca.sin(x.a) + x.b**2 + u.u + 0.3 * u.u * u.v + 0.2 * u.v**3,
        "b": x.a * ca.exp(0.4 * x.b) - x.a + x.b + u.v * ca.cos(x.a) + 0.1 * u.u**2 + 0.5 * x.a,
    }
    return rates, {}


def proof_of(linear: LinearModel, game: package.Game, order: int) -> ValueProof:
    return prove_value(package.expand(linear, package.solve(game), order), linear.point)


def single(x, u, p, w):
    """Return a plant whose input moves one of its states alone."""
    return {"a": x.b + x.a**2 - 0.5 * x.a, "b": -ca.sin(x.a) + x.b**2 + u.u}, {}


def game_of(equations, inputs: tuple[str, ...]) -> tuple[LinearModel, package.Game]:
    states = {"a": Signal(), "b": Signal()}
    model = Model(
        "plant", states, {name: Signal() for name in inputs}, equations,
        trim=dict.fromkeys(states, 0.0),
    )  # fmt: skip
    linear = package.linearize(model, package.trim(model))
    R = [0.5, 0.8][: len(inputs)]
    return linear, package.game(linear, [1.0, 2.0], R, 3.0, E=[[0.3], [1.0]])


@cache
def proved(kind: str = "mixed") -> ValueProof:
    equations, inputs = {"mixed": (mixed, ("u", "v")), "single": (single, ("u",))}[kind]
    return proof_of(*game_of(equations, inputs), 4)


def is_refused(statement: ValueStatement, witness: ValueWitness) -> bool:
    """Return whether the checker refuses a statement, whatever residual it claims."""
    try:
        check_value(replace(statement, residual=LARGEST_RESIDUAL), witness)
    except NoSolutionError:
        return True
    return False


def test_the_residual_is_that_of_rounding() -> None:
    assert proved().statement.residual < 1e-13
    assert not is_refused(proved().statement, proved().witness)


def test_the_rays_determine_a_polynomial_of_the_degree() -> None:
    """As many rays as a form of degree 4 of two variables has coefficients."""
    assert proved().rays == 5


def test_balls_that_are_too_wide_prove_nothing() -> None:
    with ctx.workprec(24), pytest.raises(Rejected):
        ValueEquation(proved().statement).check_residual(arb(LARGEST_RESIDUAL))


def test_cross_weights_are_refused() -> None:
    linear, game = game_of(single, ("u",))
    expansion = SimpleNamespace(game=replace(game, N=[[0.1], [0.0]]))
    with pytest.raises(BadInputError, match="no cross weights"):
        prove_value(expansion, linear.point)


@pytest.mark.parametrize("part", ["V", "u"])
@pytest.mark.parametrize(
    "factor", [FACTORS[0], *(pytest.param(each, marks=pytest.mark.slow) for each in FACTORS[1:])]
)
@pytest.mark.parametrize("kind", ["mixed", "single"])
def test_every_forged_coefficient_is_refused(kind: str, part: str, factor: float) -> None:
    statement = proved(kind).statement
    exact = getattr(statement, part)
    for index in np.ndindex(exact.shape):
        forged = exact.copy()
        forged[index] *= factor
        assert is_refused(replace(statement, **{part: forged}), proved(kind).witness), index


def test_other_games_and_trims_are_refused() -> None:
    statement = proved().statement
    weights = statement.weights
    for name, value in (("Q", 1.01 * weights.Q), ("R", 1.01 * weights.R), ("delta", 3.03)):
        planted = replace(statement, weights=replace(weights, **{name: value}))
        assert is_refused(planted, proved().witness)
    planted = replace(statement, weights=replace(weights, E=-1.01 * weights.E))
    assert is_refused(planted, proved().witness)
    elsewhere = replace(statement.plant, trim={"a": 0.01, "b": 0.0})
    with pytest.raises(Rejected, match="rate of a"):
        check_value(replace(statement, plant=elsewhere), proved().witness)


def scalar_statement(equations, P: float, K: float) -> ValueStatement:
    model = Model("plant", {"x": Signal()}, {"u": Signal()}, equations, trim={"x": 0.0})
    linear = package.linearize(model, package.trim(model))
    stabilizing = proof_of(linear, package.game(linear, [1.0], [1.0], np.inf), 2).statement
    return replace(stabilizing, V=np.array([P]), u=np.array([[-K]]))


def test_another_solution_of_the_equation_is_refused() -> None:
    """The solution that is negative satisfies the equation, and stabilizes nothing."""

    def equations(x, u, p, w):
        return {"x": x.x + u.u}, {}

    root = 1.0 - np.sqrt(2.0)
    statement = scalar_statement(equations, root, root)
    line = proved().witness
    with pytest.raises(NoSolutionError, match="not positive definite"):
        check_value(statement, line)


def test_a_positive_solution_that_does_not_stabilize_is_refused() -> None:
    """Of the two positive solutions of a game with S < 0, the larger one destabilizes A - S P."""

    def equations(x, u, p, w):
        return {"x": u.u - x.x}, {}

    model = Model("plant", {"x": Signal()}, {"u": Signal()}, equations, trim={"x": 0.0})
    linear = package.linearize(model, package.trim(model))
    game = package.game(linear, [1.0], [2.0], 1.0, E=[[1.0]])
    proof = proof_of(linear, game, 2)
    # -2 P + 1 + P²/2 = 0, with S = 1/2 - 1
    larger = 2.0 + np.sqrt(2.0)
    V = np.array([larger])
    u = np.array([[-0.5 * larger]])
    planted = replace(proof.statement, V=V, u=u, residual=LARGEST_RESIDUAL)
    ValueEquation(planted).check_residual(arb(LARGEST_RESIDUAL))
    for H in (1.0, -1.0):
        line = Line(np.array([[H]]), np.eye(1))
        with pytest.raises(NoSolutionError):
            check_value(planted, ValueWitness(line))


def test_a_switch_at_the_trim_is_refused() -> None:
    """|x| has no derivative at 0, although its comparison has a branch there."""

    def kinked(x, u, p, w):
        return {"x": x.x + ca.fabs(x.x) + u.u}, {}

    def smooth(x, u, p, w):
        return {"x": 2.0 * x.x + u.u}, {}

    root = 2.0 + np.sqrt(5.0)
    statement = scalar_statement(smooth, root, root)
    ValueEquation(statement).check_trim()
    model = Model("kinked", {"x": Signal()}, {"u": Signal()}, kinked, trim={"x": 0.0})
    planted = replace(statement, plant=replace(statement.plant, model=model))
    with pytest.raises(NoSolutionError, match="switches"):
        ValueEquation(planted).check_trim()


def test_a_certificate_is_compared_and_a_forged_one_refused(folder: Path) -> None:
    """The file proves its statement for the user's aircraft and game, and for no other."""
    found = answer("prove", "value", *PENDULUM, "--order", "2", "-o", "value.json")
    checked = answer("prove", "--check", "value.json", *PENDULUM)
    assert (found["proved"], checked["proved"]) == (True, True)
    assert checked["W"] == found["W"]
    assert "value" in checked["not_given"]
    other = hfa("prove", "--check", "value.json", *PENDULUM, "--delta", "50")
    assert (other.code, other.err.count("\n")) == (1, 1)
    content = json.loads(Path("value.json").read_text())
    origin = json.dumps(content["provenance"])
    body = {key: content[key] for key in content if key not in ("digest", "provenance", "checksum")}
    body["statement"]["V"][0] *= 1.01
    Path("forged.json").write_text(sealed(json.dumps(body)[:-1], origin))
    forged = hfa("prove", "--check", "forged.json", *PENDULUM)
    assert (forged.code, forged.out, forged.err.count("\n")) == (1, "", 1)
    assert "not proved" in forged.err


@pytest.mark.slow
def test_no_forged_value_of_the_flexible_aircraft_passes() -> None:
    """Of 200 certificates with one coefficient changed, none passes."""
    proof = proof_of(model_at(15.0), game_at(15.0), 4)
    check_value(proof.statement, proof.witness)
    random = np.random.default_rng(3)
    for _ in range(200):
        part = random.choice(["V", "u"])
        forged = getattr(proof.statement, part).copy()
        index = tuple(int(random.integers(size)) for size in forged.shape)
        forged[index] *= random.choice(FACTORS)
        planted = replace(proof.statement, residual=LARGEST_RESIDUAL, **{part: forged})
        with pytest.raises(Rejected):
            check_value(planted, proof.witness)
