"""Regions of loops whose policy follows from a polynomial V of degree 4."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from pendulum_regions import PENDULUM, certified, passes, pendulum_loop, quickly_proved

from controller.critic.critic import Critic, from_weights
from controller.game.zero_sum import Game
from hfa.main import main
from hfa_aircraft.march.ending import Outcome
from hfa_aircraft.model import Model
from hfa_prove.certificate import read_content
from hfa_prove.check import check_certificate
from hfa_prove.check.loop_on_ball import LoopOnBall
from hfa_prove.commands.polynomials import policy_terms
from hfa_prove.enclosure.polynomial import exponents_of
from hfa_prove.monomials import PolynomialFunction, edge_points
from hfa_prove.search.clock import Clock
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import outcomes
from hfa_prove.statements.loop import Gain
from hfa_prove.statements.plant import Subject
from hfa_support.errors import BadInputError

BASIS = "x1**2, x1*x2, x2**2, x1**3*x2, x2**4"
WEIGHTS = [1.4, 0.148, 0.0366, 0.02, 0.0005]
#: 1 / (m l²) of the example.
BY_TORQUE = 1 / (0.15 * 0.5**2)
LINE = "The policy of torque is -K z -0.266667 angle^3 -0.0266667 rate^3, then saturated."


def critic_of(basis: str, weights: list[float]) -> Critic:
    """Return a critic of the pendulum, linearized at its trim, with Q and R the identity.

    basis: name of the basis, or its monomials
    """
    A = np.array([[0.0, 1.0], [19.62, -0.1 * BY_TORQUE]])
    game = Game(A, np.array([[0.0], [BY_TORQUE]]), np.eye(2), np.eye(2), np.eye(1), delta=np.inf)
    functions = basis
    return from_weights(game, np.array(weights), functions)


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory, model: Model) -> Path:
    critic = critic_of(BASIS, WEIGHTS)
    policy = policy_terms(critic, ("torque",))
    loop = replace(pendulum_loop(model), policy=Gain(critic.K, policy))
    return certified(tmp_path_factory.mktemp("policy") / "pendulum.json", loop, 0.9)


@pytest.mark.slow
def test_the_command_accepts_a_quartic_critic(tmp_path: Path) -> None:
    """`hfa prove region` proves a region for the policy of a critic with terms of degree 4."""
    (tmp_path / "quartic.json").write_text(json.dumps({"W": WEIGHTS}))
    words = ("--weights", str(tmp_path / "quartic.json"), "--basis", BASIS)
    said = quickly_proved(tmp_path / "pendulum.json", PENDULUM, *words)
    assert LINE in " ".join(said.split())


def test_policy_terms_follow_from_the_critic() -> None:
    # u = -B'∂V/∂z / 2: the fourth power of the rate gives -2 W B rate³.
    """The terms of a critic's policy follow from u = -B'∂V/∂z / 2.

    A quadratic V has no terms of degree 2 or more.
    """
    terms = policy_terms(critic_of(BASIS, WEIGHTS), ("torque",))["torque"]
    wanted = {(3, 0): -0.5 * BY_TORQUE * 0.02, (0, 3): -2 * BY_TORQUE * 0.0005}
    assert {powers: coefficient for coefficient, powers in terms} == pytest.approx(wanted)
    quartic = critic_of("quadratic+quartic", [*WEIGHTS[:3], 0.5, 0.0005])
    ((coefficient, powers),) = policy_terms(quartic, ("torque",))["torque"]
    assert powers == (0, 3)
    assert coefficient == pytest.approx(wanted[0, 3])
    cubic = critic_of("x1**2, x1*x2, x2**2, x2**3", [*WEIGHTS[:3], 0.02])
    (((coefficient, powers),),) = policy_terms(cubic, ("torque",)).values()
    assert (coefficient, powers) == (pytest.approx(-1.5 * BY_TORQUE * 0.02), (0, 2))
    assert policy_terms(critic_of("quadratic", WEIGHTS[:3]), ("torque",)) == {}


@pytest.mark.parametrize(
    ("basis", "reason"),
    [
        ("x1**2, x1*x2, x2**2, sin(x1)*x2, x2**4", "not a polynomial"),
        ("x1**2, x1*x2, x2**2, x2**8, x2**4", "not a polynomial"),
        ("x1**2, x1*x2, x2**2, x2, x2**4", "not 0 at the trim"),
    ],
)
def test_unsupported_policies_are_refused(basis: str, reason: str) -> None:
    """Policies that are not polynomials, or not zero at the trim, are refused."""
    with pytest.raises(BadInputError, match=reason):
        policy_terms(critic_of(basis, [1.4, 0.148, 0.0366, 0.02, 0.01]), ("torque",))


def test_the_checker_evaluates_the_stated_policy(
    certificate: Path, model: Model, capsys: pytest.CaptureFixture[str]
) -> None:
    """The statement contains the terms of the policy, and the checker evaluates the same policy."""
    statement, witness = read_content(json.loads(certificate.read_text()), Subject(model))
    assert {powers for _, powers in statement.loop.gain.terms["torque"]} == {(3, 0), (0, 3)}
    ball = LoopOnBall(statement, witness.T, witness.order)
    policy = critic_of(BASIS, WEIGHTS).policy
    for y in np.random.default_rng(0).uniform(-0.7, 0.7, (20, 2)):
        total = 0.0
        for key, _, coefficient in ball.command("torque").terms():
            powers = [*exponents_of(key), 0, 0][:2]
            total += float(coefficient) * float(np.prod(y ** np.array(powers)))
        assert total == pytest.approx(float(policy(witness.T @ y)), rel=1e-9)
    words = ["prove", "--aircraft", PENDULUM, "--check", str(certificate)]
    assert main(words) == 0
    assert LINE in " ".join(capsys.readouterr().out.split())
    own = certificate.parent / "without the cube of the rate.json"
    own.write_text(json.dumps({"W": WEIGHTS[:-1]}))
    basis = BASIS.removesuffix(", x2**4")
    assert main([*words, "--weights", str(own), "--basis", basis]) == 1
    assert "policy" in capsys.readouterr().err


def test_forged_policies_are_refused(certificate: Path, model: Model) -> None:
    """A certificate with changed coefficients, exponents or inputs of the policy is refused."""
    content = json.loads(certificate.read_text())
    assert passes(content, model)
    policy = content["statement"]["loop"]["policy"]["terms"]["torque"]
    forgeries = [
        {},
        {"torque": [[-10 * coefficient, powers] for coefficient, powers in policy]},
        {"torque": [[30 * coefficient, powers] for coefficient, powers in policy]},
        {"torque": [*policy, [3.0, [2, 0]]]},
        {"torque": [*policy, [3.0, [1, 0]]]},
        {"torque": [*policy, [3.0, [6, 0]]]},
        {"torque": []},
        {"thrust": policy},
    ]
    kept = []
    for forged in forgeries:
        changed = copy.deepcopy(content)
        changed["statement"]["loop"]["policy"]["terms"] = forged
        if passes(changed, model):
            kept.append(forged)
    assert kept == []


def test_flights_from_the_edge_converge(certificate: Path, model: Model) -> None:
    """Flights from the edge of the proved set converge, and the loop has the policy of the critic."""
    statement = check_certificate(certificate, model=model).statement
    V = PolynomialFunction.of_terms(statement.terms).scaled(1.0 / statement.rho)
    T = V.coordinates()
    edge = edge_points(V, T, 1.0)[::50] @ T.T
    plant = LoopValues(statement.loop)
    found = outcomes(plant, edge, lambda z: V(z) <= 1e-4, 20.0, Clock(60.0))
    assert set(found.tolist()) == {Outcome.CONVERGED}
    z = ca.SX.sym("z", 2)
    command = ca.Function("u", [z], [statement.loop.deviations(z)])
    policy = critic_of(BASIS, WEIGHTS).policy
    assert np.allclose(np.array(command(edge.T)), np.array(policy(edge.T)), rtol=1e-9)


def test_a_basis_without_weights_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """A basis without weights is refused."""
    assert main(["prove", "region", "--aircraft", PENDULUM, "--basis", "quadratic"]) == 2
    assert "--weights" in capsys.readouterr().err
