"""Regions of networks: proved, checked, forged and refused."""

from __future__ import annotations

import copy
import json
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from small_networks import imitation

from controller.critic.critic_file import critic_in
from controller.critic.reading import Reading
from controller.game.zero_sum import Game
from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model, Signal
from hfa_prove.certificate import read_content, write_certificate
from hfa_prove.check.cover import (
    Boxes,
    OpenBoxError,
    Question,
    RefutedError,
    SmallestBoxError,
    cover,
    refute,
)
from hfa_prove.check.equilibrium import equilibrium_near
from hfa_prove.check.region_boxes import check_region
from hfa_prove.commands.policies import scalars
from hfa_prove.enclosure.program import Program
from hfa_prove.enclosure.taylor import TaylorProgram, lowest
from hfa_prove.search.clock import Clock
from hfa_prove.search.region_boxes import BoxesSearch
from hfa_prove.search.region_search import RegionProblem, Settings
from hfa_prove.search.shape_boxes import Shape
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Subject
from hfa_prove.statements.region import RegionStatement, RegionWitness
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.interruption import interruptible

PENDULUM = "examples/pendulum.py:PENDULUM"
K = np.array([[1.97725, 0.97624]])


@dataclass(frozen=True, eq=False)
class Positive(Question):
    """The property that functions of y are positive in the cube, to be proved by branch and bound.

    hole: the first function need not be positive for |y_i| <= 2^-hole; None for no exception
    """

    taylor: TaylorProgram
    hole: int | None
    within: Callable[[np.ndarray], np.ndarray] = lambda places: np.ones(len(places), dtype=bool)

    @property
    def n(self) -> int:
        return self.taylor.n

    @property
    def at_once(self) -> int:
        return self.taylor.at_once

    def is_outside(self, boxes: Boxes) -> np.ndarray:
        return np.zeros(len(boxes.centres), dtype=bool)

    def edges(self, boxes: Boxes) -> np.ndarray:
        models = self.taylor.over(boxes.centres, boxes.half_widths)
        proved = lowest(models, self.n) > 0.0
        if self.hole is not None:
            proved[0] |= boxes.reach <= 2.0**-self.hole
        refute(boxes.centres, np.min(models.value + models.radius, axis=0), self.within)
        return np.where(proved.all(axis=0), -1, np.argmin(boxes.depths, axis=1))


def inequality(expression: ca.SX, y: ca.SX, hole: int | None = None) -> Positive:
    return Positive(
        TaylorProgram(Program(ca.Function("f", [y], [expression]), "f"), y.numel()), hole
    )


def test_a_planted_negative_value_is_detected() -> None:
    """A function that is negative near one point is refuted at that point.

    Without the negative values, the function is proved positive.
    """
    y = ca.SX.sym("y", 2)
    bump = (y[0] - 0.3) ** 2 + (y[1] + 0.4) ** 2
    assert cover(inequality(bump + 1e-3, y), 10**5) >= 1
    with pytest.raises(RefutedError) as found:
        cover(inequality(bump - 1e-3, y), 10**5)
    assert np.linalg.norm(found.value.place - [0.3, -0.4]) < 0.04


def test_functions_with_zeros_are_not_proved_positive() -> None:
    """A function with a zero is not proved positive, unless the zero lies in a hole."""
    y = ca.SX.sym("y", 2)
    with pytest.raises(OpenBoxError):
        cover(inequality(ca.SX(0), y), 10**4)
    with pytest.raises(OpenBoxError):
        cover(inequality((y[0] - 0.3) ** 2, y), 10**4)
    with pytest.raises(OpenBoxError):  # the function is 0 at y = 0, without a hole there
        cover(inequality(ca.sumsqr(y), y), 10**4)
    assert cover(inequality(ca.sumsqr(y), y, hole=5), 10**4) >= 4


def test_no_edge_is_halved_beyond_double_precision() -> None:
    """No edge of a box is halved more than 53 times.

    The function is 0 at y_0 = 0.3, near which the first edge is halved again and again.
    """
    depths = []

    class Deep(Positive):
        def edges(self, boxes: Boxes) -> np.ndarray:
            depths.append(int(boxes.depths.max()))
            return np.where(super().edges(boxes) >= 0, 0, -1)

    y = ca.SX.sym("y", 2)
    question = inequality((y[0] - 0.3) ** 2, y)
    with pytest.raises(SmallestBoxError):
        cover(Deep(question.taylor, None), 10**4)
    assert max(depths) == 53


def network_in(path: str | Path) -> ca.Function:
    """Return the network in a file, as the command reads it.

    The certificate contains a digest of the instructions of this function.
    """
    zeros = np.zeros((2, 2))
    game = Game(zeros, np.ones((2, 1)), np.eye(2), np.eye(2), np.eye(1), np.inf)
    return scalars(critic_in(str(path), game, Reading(None, "policy=", "tanh", None)).policy)


@pytest.fixture(scope="module")
def proved(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[dict[str, Any], ca.Function, list[str]]:
    """Return the content of a proved certificate, and the arguments of the command that checks
    it.
    """
    folder = tmp_path_factory.mktemp("boxes")
    network = imitation(folder / "network.npz", K, np.array([1.0, 4.0]), hidden=(8,))
    words = ["--aircraft", PENDULUM, "--Q", "1,1", "--R", "1", "--weights", str(network)]
    words += ["--set", "activation=tanh", "--network", "policy="]
    path = folder / "proved.json"
    statement, witness = statement_of(network_in(network))
    write_certificate(
        path, statement, witness.content(), dict.fromkeys(("version", "command", "date"), "")
    )
    return json.loads(path.read_text()), [*words, "--check", str(path)]


def test_a_region_of_a_network_is_verified(proved: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """The region of a network is checked by `hfa prove`."""
    _, words = proved
    assert main(["prove", *words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["proved"]


def test_another_network_is_refused(proved: Any, tmp_path: Path) -> None:
    """A certificate about one network is refused if the user gives another network."""
    _, words = proved
    other = imitation(tmp_path / "other.npz", K, np.array([1.0, 4.0]), hidden=(8,), seed=1)
    swapped = [str(other) if word.endswith("network.npz") else word for word in words]
    assert main(["prove", *swapped]) == 2
    relu = [word.replace("activation=tanh", "activation=relu") for word in words]
    assert main(["prove", *relu]) == 2


def test_a_recurrent_network_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A recurrent network is refused, and its tensor is named."""
    path = tmp_path / "lstm.npz"
    names = ("weight_ih_l0", "weight_hh_l0", "bias_ih_l0", "bias_hh_l0")
    shapes = ((16, 2), (16, 4), (16,), (16,))
    arrays = {f"lstm.{name}": np.ones(shape) for name, shape in zip(names, shapes, strict=True)}
    np.savez(path, **arrays, **{"out.weight": np.ones((1, 4)), "out.bias": np.zeros(1)})
    assert main(_words_of(path)) == 2
    assert "'lstm.weight_ih_l0' (16, 2) is not a weight" in capsys.readouterr().err


def test_a_network_too_large_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A network with too many operations is refused with the supported number."""
    path = imitation(tmp_path / "wide.npz", K, np.array([1.0, 4.0]), hidden=(200, 300))
    assert main(_words_of(path)) == 2
    assert "operations, but at most 100000 are supported" in capsys.readouterr().err


def _words_of(network: Path) -> list[str]:
    words = ["prove", "region", "--aircraft", PENDULUM, "--Q", "1,1", "--R", "1"]
    words += ["--weights", str(network), "--set", "activation=tanh", "--network", "policy="]
    return words


def test_the_checker_needs_the_users_network(proved: Any) -> None:
    """A certificate that concerns a network is refused if the user gives no network."""
    _, words = proved
    assert main(["prove", *words[-2:]]) == 2


def statement_of(policy: ca.Function, rho: float = 0.05) -> tuple[RegionStatement, RegionWitness]:
    """Return the statement that {z'P z <= rho} is a region of the pendulum, and its witness."""
    P = np.array([[2.0, 0.3], [0.3, 0.1]])
    names = ("angle", "rate")
    shape = Shape.of_matrix(P / rho, -np.eye(2), 2).in_cube()
    ends, multipliers = shape.extents()
    loop = Loop(
        load_model(PENDULUM),
        {},
        dict.fromkeys(names, 0.0),
        {"torque": 0.0},
        {},
        {"torque": (-0.7, 0.7)},
        policy,
    )
    extents = {name: (low, high) for name, (low, high) in zip(names, ends.tolist(), strict=True)}
    statement = RegionStatement(loop, dict.fromkeys(names, 0.0), shape.piece(), extents)
    return statement, RegionWitness(multipliers, 10**5)


def linear(gain: np.ndarray) -> ca.Function:
    z = ca.SX.sym("z", 2)
    return ca.Function("u", [z], [-ca.DM(gain) @ z])


def test_another_digest_of_the_policy_is_refused(proved: Any) -> None:
    """A certificate with the digest of another policy is refused."""
    content = copy.deepcopy(proved[0])
    words = proved[1]
    own = Subject(load_model(PENDULUM), network_in(words[words.index("--weights") + 1]))
    assert check_region(*read_content(copy.deepcopy(content), own)) > 0
    content["statement"]["loop"]["policy"] = "0" * 64
    with pytest.raises(BadInputError, match="is about another policy"):
        read_content(content, own)


def test_the_hole_applies_to_the_first_function_only() -> None:
    """In the hole around the equilibrium, only the first function need not be positive.

    A second function that is negative in the hole is refused.
    """
    y = ca.SX.sym("y", 2)
    bump = (y[0] - 0.05) ** 2 + y[1] ** 2
    assert cover(inequality(ca.vertcat(ca.sumsqr(y), bump + 1e-4), y, hole=2), 10**5) > 1
    with pytest.raises(OpenBoxError):
        cover(inequality(ca.vertcat(ca.sumsqr(y), bump - 1e-4), y, hole=2), 10**5)


@pytest.mark.parametrize("margin", [1e-13, -1e-13])
def test_a_margin_of_1e13_decides_a_network(margin: float) -> None:
    """A region of a network is proved if the margin of V' is 1e-13, and refused if it is -1e-13.

    For x' = -x (x - 1/2)² + u with u = -margin x, V' at x = 1/2 consists of the margin alone.
    """
    z = ca.SX.sym("z", 1)
    hidden = ca.fmax(ca.vertcat(z, -z), 0)
    network = ca.Function("u", [z], [ca.DM([[-margin, margin]]) @ hidden])
    model = Model(
        "tank",
        {"level": Signal("m")},
        {"valve": Signal("m/s")},
        lambda x, u, p, w: ({"level": u.valve - x.level * (x.level - 0.5) ** 2}, {}),
        trim={"level": 0.0},
    )
    loop = Loop(model, {}, {"level": 0.0}, {"valve": 0.0}, {}, {}, network)
    piece = Piece(np.eye(1), Polynomial(1, ((1.0, (2,)),)), 0.81)
    statement = RegionStatement(loop, {"level": 0.0}, piece, {"level": (-0.91, 0.91)})
    witness = RegionWitness(np.full((1, 2), 0.55), 10**6)
    if margin > 0.0:
        assert check_region(statement, witness) > 0
    else:
        with pytest.raises(NoSolutionError, match="inequality"):
            check_region(statement, witness)


def test_an_interrupted_search_returns_the_proved_region() -> None:
    """Ctrl-C ends the search at its next step. The region proved so far is returned."""
    saved = []
    before = signal.getsignal(signal.SIGINT)

    def interrupt(done: float, whole: float, text: str = "", /) -> None:
        if saved:
            os.kill(os.getpid(), signal.SIGINT)

    gain = Gain(K, {})
    loop = statement_of(gain.function(("torque",)))[0].loop
    with interruptible(interrupt) as progress:
        settings = Settings(2, Clock(30.0, progress), saved.append)
        found = BoxesSearch(RegionProblem(loop), settings).found()
    assert signal.getsignal(signal.SIGINT) is before
    assert found.stopped == "interrupted"
    assert found.statement is saved[-1].statement


def _still(rates: ca.Function) -> Any:
    """Return a plant with given rates of its states, whose nominal values are 1."""
    return SimpleNamespace(
        rate_function=rates,
        program=Program(rates, "f"),
        nominal=np.ones(rates.numel_in(0)),
        model=SimpleNamespace(name="f"),
    )


def test_a_loop_without_an_equilibrium_is_refused() -> None:
    """The equilibrium of x' = x² - 1 is enclosed. x' = x² + 1 has no equilibrium and is refused."""
    x = ca.SX.sym("x")
    for constant in (1.0, -1.0):
        near: Any = (_still(ca.Function("f", [x], [x**2 + constant])), np.array([0.7]))
        if constant < 0.0:
            assert equilibrium_near(*near).x == pytest.approx([1.0])
        else:
            with pytest.raises(NoSolutionError, match="no equilibrium is enclosed"):
                equilibrium_near(*near)


def test_every_coordinate_of_an_equilibrium_is_enclosed() -> None:
    """The equations (x - 1, y² + 1), whose second entry has no zero, are refused."""
    x = ca.SX.sym("x", 2)
    plant = _still(ca.Function("f", [x], [ca.vertcat(x[0] - 1, x[1] ** 2 + 1)]))
    with pytest.raises(NoSolutionError, match="no equilibrium is enclosed"):
        equilibrium_near(plant, np.array([0.9, 0.7]))


def test_increase_within_the_hole_is_refused() -> None:
    """A region is refused if V increases in a part of the hole around the equilibrium.

    x' = -x (x² - 0.04) (x² - 0.16) increases |x| between 0.2 and 0.4.
    """

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        square = x.angle**2
        return {"angle": -x.angle * (square - 0.04) * (square - 0.16)}, {}

    model = Model("rings", {"angle": Signal("rad")}, {}, equations, trim={})
    none = ca.Function("u", [ca.SX.sym("z", 1)], [ca.SX(0, 1)])
    loop = Loop(model, {}, {"angle": 0.0}, {}, {}, {}, none)
    for reach, rho in ((0.19, 0.03), (1.0, 0.9)):
        piece = Piece(np.eye(1) / reach, Polynomial(1, ((reach**2, (2,)),)), rho)
        statement = RegionStatement(loop, {"angle": 0.0}, piece, {"angle": (-1.1, 1.1)})
        witness = RegionWitness(np.zeros((1, 2)), 10**4)
        if rho == 0.9:
            with pytest.raises(NoSolutionError, match="inequality"):
                check_region(statement, witness)
        else:
            assert check_region(statement, witness) > 0


def test_a_kink_at_the_equilibrium_is_named() -> None:
    """The error names a kink at the equilibrium that rules out a quadratic V.

    The damping is negative on one side of the kink.
    """

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"angle": x.rate, "rate": 0.4 * ca.fabs(x.rate) - 0.2 * x.rate - x.angle}, {}

    names = ("angle", "rate")
    model = Model("clock", {name: Signal("rad") for name in names}, {}, equations, trim={})
    none = ca.Function("u", [ca.SX.sym("z", 2)], [ca.SX(0, 1)])
    loop = Loop(model, {}, dict.fromkeys(names, 0.0), {}, {}, {}, none)
    with pytest.raises(NoSolutionError, match="rate of rate has a kink in rate at the equil"):
        BoxesSearch(RegionProblem(loop), Settings(2, Clock(0.2))).found()
