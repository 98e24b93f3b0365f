"""Regions of networks: proved, checked, forged, refused."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from small_networks import imitation

from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model, Signal
from hfa_boxes.check.checker import BoxWitness, _check_extents, check_region, read_content
from hfa_boxes.check.cover import (
    Boxes,
    Inequality,
    OpenBoxError,
    RefutedError,
    cover,
    in_ball,
    outside_ball,
)
from hfa_boxes.check.loop import Loop
from hfa_boxes.check.plant import zero_near
from hfa_boxes.check.statement import BoxStatement
from hfa_boxes.commands.region import scalars
from hfa_boxes.enclosure.program import Program
from hfa_boxes.enclosure.taylor import TaylorProgram
from hfa_support.errors import BadInputError, NoSolutionError

PENDULUM = "examples/pendulum.py:PENDULUM"
K = np.array([[1.97725, 0.97624]])


def inequality(expression: ca.SX, y: ca.SX, hole: int | None = None) -> Inequality:
    taylor = TaylorProgram(Program(ca.Function("f", [y], [expression]), "f"))
    return Inequality(y.numel(), taylor.over, taylor.at_once, hole, outside_ball, in_ball)


def test_a_planted_negative_place_is_found() -> None:
    y = ca.SX.sym("y", 2)
    bump = (y[0] - 0.3) ** 2 + (y[1] + 0.4) ** 2
    assert cover(inequality(bump + 1e-3, y), 10**5) >= 1
    with pytest.raises(RefutedError) as found:
        cover(inequality(bump - 1e-3, y), 10**5)
    assert np.linalg.norm(found.value.place - [0.3, -0.4]) < 0.04


def test_what_may_be_zero_is_not_positive() -> None:
    y = ca.SX.sym("y", 2)
    with pytest.raises(OpenBoxError):
        cover(inequality(ca.SX(0), y), 10**4)
    with pytest.raises(OpenBoxError):
        cover(inequality((y[0] - 0.3) ** 2, y), 10**4)
    with pytest.raises(OpenBoxError):  # zero at y = 0, which is no hole
        cover(inequality(ca.sumsqr(y), y), 10**4)
    assert cover(inequality(ca.sumsqr(y), y, hole=5), 10**4) >= 4


@pytest.fixture(scope="module")
def proved(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[dict[str, Any], ca.Function, list[str]]:
    """Content of a certificate, and the words of its check."""
    folder = tmp_path_factory.mktemp("boxes")
    network = imitation(folder / "network.npz", K, np.array([1.0, 4.0]), hidden=(8,))
    words = ["--aircraft", PENDULUM, "--Q", "1,1", "--R", "1", "--weights", str(network)]
    words += ["--set", "activation=tanh", "--network", "policy="]
    path = folder / "proved.json"
    assert main(["prove", "region", *words, "-o", str(path)]) == 0
    return json.loads(path.read_text()), [*words, "--check", str(path)]


def test_a_network_is_proved_and_checked(proved: Any, capsys: pytest.CaptureFixture[str]) -> None:
    content, words = proved
    assert main(["prove", "region", *words]) == 0
    out = capsys.readouterr().out
    assert out.startswith(
        "Verified, proved: region of attraction of pendulum; sampling, delay, actuators"
    )
    assert content["statement"]["extents"]["angle"] > np.radians(20.0)


def test_another_network_is_not_what_was_proved(proved: Any, tmp_path: Path) -> None:
    _, words = proved
    other = imitation(tmp_path / "other.npz", K, np.array([1.0, 4.0]), hidden=(8,), seed=1)
    swapped = [str(other) if word.endswith("network.npz") else word for word in words]
    assert main(["prove", "region", *swapped]) == 2


def test_the_checker_needs_the_users_network(proved: Any) -> None:
    _, words = proved
    assert main(["prove", *words[-2:]]) == 2


def statement_of(policy: ca.Function, **changed: Any) -> tuple[BoxStatement, BoxWitness]:
    """V = z'P z of the pendulum with a level that holds."""
    P = np.array([[2.0, 0.3], [0.3, 0.1]])
    rho = 0.05
    T = np.sqrt(rho) * (1 + 1e-9) * np.linalg.inv(np.linalg.cholesky(P)).T
    model = load_model(PENDULUM)
    names = ("angle", "rate")
    loop = Loop(
        model, {}, dict.fromkeys(names, 0.0), {"torque": 0.0}, {}, {"torque": (-0.7, 0.7)}, policy
    )
    extents = dict(zip(names, (np.linalg.norm(T, axis=1) * 1.001).tolist(), strict=True))
    fields = {"P": P, "rho": rho, "extents": extents, "T": T} | changed
    T = fields.pop("T")
    statement = BoxStatement(
        loop, "", dict.fromkeys(names, 0.0), fields["P"], fields["rho"], fields["extents"]
    )
    return statement, BoxWitness(T, 10**5)


def linear(gain: np.ndarray) -> ca.Function:
    z = ca.SX.sym("z", 2)
    return ca.Function("u", [z], [-ca.DM(gain) @ z])


FORGED: dict[str, Any] = {
    "rho": lambda s, w: s.update(rho=s["rho"] * 4.0),
    "P": lambda s, w: s.update(P=(np.array(s["P"]) * 0.5).tolist()),
    "P indefinite": lambda s, w: s.update(P=(-np.array(s["P"])).tolist()),
    "extents": lambda s, w: s["extents"].update(angle=s["extents"]["angle"] * 0.9),
    "equilibrium": lambda s, w: s["equilibrium"].update(angle=0.01),
    "T smaller": lambda s, w: w.update(T=(np.array(w["T"]) * 0.9).tolist()),
    "T singular": lambda s, w: w.update(T=[[1.0, 1.0], [1.0, 1.0]]),
    "boxes": lambda s, w: w.update(boxes=3),
    "limits wider": lambda s, w: s["limits"].update(torque=[-7.0, 7.0]),
    "limits narrower": lambda s, w: s["limits"].update(torque=[-0.5, 0.7]),
    "angle above a limit": lambda s, w: s["limits"].update(
        angle=[-9.0, 0.5 * s["extents"]["angle"]]
    ),
    "angle below a limit": lambda s, w: s["limits"].update(
        angle=[-0.5 * s["extents"]["angle"], 9.0]
    ),
    "limits gone": lambda s, w: s["limits"].clear(),
    "policy": lambda s, w: s.update(policy="0" * 64),
    "model": lambda s, w: s.update(dynamics="van der Pol"),
    "source": lambda s, w: s.update(source="0" * 64),
    "states": lambda s, w: s.update(states=["rate", "angle"]),
    "units": lambda s, w: s.update(state_units=["deg", "deg/s"]),
    "more": lambda s, w: s.update(note="x"),
    "witness more": lambda s, w: w.update(rho=1.0),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_certificate_is_refused(name: str, proved: Any) -> None:
    content = proved[0]
    forged = copy.deepcopy(content)
    model = load_model(PENDULUM)
    statement, witness = read_content(copy.deepcopy(forged), model, _same_policy(proved))
    assert check_region(statement, witness) > 0
    FORGED[name](forged["statement"], forged["witness"])
    with pytest.raises((NoSolutionError, BadInputError)):
        check_region(*read_content(forged, model, _same_policy(proved)))


def _same_policy(proved: Any) -> ca.Function:
    """The policy as the command reads it, for the digest covers its instructions."""
    from controller.critic.critic_file import Reading, critic_in
    from controller.game.zero_sum import Game

    words = proved[1]
    path = words[words.index("--weights") + 1]
    zeros = np.zeros((2, 2))
    game = Game(zeros, np.ones((2, 1)), np.eye(2), np.eye(2), np.eye(1), np.inf)
    return scalars(critic_in(path, game, Reading(None, "policy=", "tanh", None)).policy)


def test_a_level_that_is_unstable_is_refused() -> None:
    assert check_region(*statement_of(linear(K))) > 0
    with pytest.raises(NoSolutionError):
        check_region(*statement_of(linear(-K)))


def test_rest_at_no_decrease_is_refused() -> None:
    """V' = 0 everywhere: an undamped loop keeps its energy."""
    x = ca.SX.sym("x", 2)
    with pytest.raises(OpenBoxError):
        cover(inequality(-(x[0] * x[1] - x[1] * x[0]), x, hole=3), 10**4)


def test_boxes_that_touch_the_ball_are_not_outside() -> None:
    """Their nearest corners are at .97 and 1.06."""
    corners = Boxes(np.array([[0.75, 0.75], [0.8125, 0.8125]]), np.full((2, 2), 4))
    assert outside_ball(corners).tolist() == [False, True]


def test_the_hole_is_one_of_first_function_alone() -> None:
    """The hole is one of the first function alone."""
    y = ca.SX.sym("y", 2)
    bump = (y[0] - 0.05) ** 2 + y[1] ** 2
    assert cover(inequality(ca.vertcat(ca.sumsqr(y), bump + 1e-4), y, hole=2), 10**5) > 1
    with pytest.raises(OpenBoxError):
        cover(inequality(ca.vertcat(ca.sumsqr(y), bump - 1e-4), y, hole=2), 10**5)


@pytest.mark.parametrize("limits", [(-0.01, 9.0), (-9.0, 0.01)])
def test_an_output_beyond_its_limits_is_refused(limits: tuple[float, float]) -> None:
    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"angle": -x.angle}, {"load": x.angle}

    model = Model(
        "sink", {"angle": Signal("rad")}, {}, equations, outputs={"load": Signal("rad")}, trim={}
    )
    none = ca.Function("u", [ca.SX.sym("z", 1)], [ca.SX(0, 1)])
    one = np.eye(1)
    for pair in ((-9.0, 9.0), limits):
        loop = Loop(model, {}, {"angle": 0.0}, {}, {}, {"load": pair}, none)
        statement = BoxStatement(loop, "", {"angle": 0.0}, one, 0.9, {"angle": 1.1})
        if pair == limits:
            with pytest.raises(NoSolutionError, match="inequality"):
                check_region(statement, BoxWitness(one, 10**4))
        else:
            assert check_region(statement, BoxWitness(one, 10**4)) > 0


@pytest.mark.parametrize("held", [-1.0, 2.0])
def test_a_state_held_beyond_its_limits_is_refused(held: float) -> None:
    loop = SimpleNamespace(states=(), held={"flap": held}, limits={"flap": (0.0, 1.0)})
    decrease = SimpleNamespace(equilibrium=None, reach=lambda: [])
    with pytest.raises(NoSolutionError, match="flap is held beyond its limits"):
        _check_extents(SimpleNamespace(loop=loop), decrease)


def test_no_equilibrium_is_enclosed_where_there_is_none() -> None:
    """x² + 1 has no zero, x² - 1 has one."""
    x = ca.SX.sym("x")
    for constant in (1.0, -1.0):
        program = Program(ca.Function("f", [x], [x**2 + constant]), "f")
        near = (program, np.array([0.7]), np.ones(1), (0,))
        if constant < 0.0:
            assert zero_near(*near).x == pytest.approx([1.0])
        else:
            with pytest.raises(NoSolutionError, match="no equilibrium is enclosed"):
                zero_near(*near)


def test_a_hole_is_proved_everywhere_in_it() -> None:
    """x' = -x (x² - 0.04) (x² - 0.16) decreases |x| at 0 and beyond 0.4, and not between."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        square = x.angle**2
        return {"angle": -x.angle * (square - 0.04) * (square - 0.16)}, {}

    model = Model("rings", {"angle": Signal("rad")}, {}, equations, trim={})
    none = ca.Function("u", [ca.SX.sym("z", 1)], [ca.SX(0, 1)])
    loop = Loop(model, {}, {"angle": 0.0}, {}, {}, {}, none)
    for reach, rho in ((0.19, 0.03), (1.0, 0.9)):
        statement = BoxStatement(loop, "", {"angle": 0.0}, np.eye(1), rho, {"angle": 1.1})
        witness = BoxWitness(reach * np.eye(1), 10**4)
        if rho == 0.9:
            with pytest.raises(NoSolutionError, match="inequality"):
                check_region(statement, witness)
        else:
            assert check_region(statement, witness) > 0
