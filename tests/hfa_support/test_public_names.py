"""Public names of the packages, which are imported when they are used."""

import ast
import inspect
import re
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from project import FOLDERS, PACKAGES

import hfa
import trim

STUBS = [
    *(FOLDERS[name] / "__init__.pyi" for name in PACKAGES),
    *(FOLDERS["hfa"] / name / "__init__.pyi" for name in ("paper", "extend")),
]


def test_the_core_stubs_name_no_extension() -> None:
    """The stubs of core packages, except `hfa`, import no name of an extension."""
    core = [stub for stub in STUBS if "extensions" not in stub.parts and stub.parent.name != "hfa"]
    assert len(core) >= 6
    for stub in core:
        known = re.findall(r"^from (hfa_\w+)", stub.read_text("utf-8"), re.M)
        assert set(known) <= {"hfa_aircraft", "hfa_model", "hfa_support"}


def stub_names() -> set[str]:
    """Return the names that the stub of `hfa` imports."""
    tree = ast.parse((FOLDERS["hfa"] / "__init__.pyi").read_text("utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name for node in imports for alias in node.names}


def test_hfa_has_the_names_of_its_stub_and_no_other() -> None:
    """`dir(hfa)` is the stub. Functions of other packages and earlier names do not exist."""
    pytest.importorskip("hfa_flight")
    assert set(dir(hfa)) == stub_names()
    for name in ("linspace", "find_operating_point", "load_critic", "load", "step", "sin"):
        assert not hasattr(hfa, name), name


@cache
def plant() -> dict[str, Any]:
    model = hfa.aircraft()
    point = hfa.trim(model)
    linear = hfa.linearize(model, point)
    game = hfa.paper.published_game(linear)
    return {
        "model": model,
        "point": point,
        "linear": linear,
        "game": game,
        "solution": hfa.solve(game),
    }


#: Wrong call -> words of the message that name the right one.
REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "verify(linear, K)": (
        lambda: hfa.verify(plant()["linear"], plant()["solution"].K),
        "give a game: hfa.game(linear, Q, R, delta)",
    ),
    "verify(game, 3)": (
        lambda: hfa.verify(plant()["game"], 3),
        "hfa.from_gain(game, K), hfa.from_value(game, P), hfa.from_weights(game, W, basis=...)",
    ),
    "solve(model)": (
        lambda: hfa.solve(plant()["model"]),
        "give a game: hfa.game(linear, Q, R, delta)",
    ),
    "fly(x0)": (
        lambda: hfa.fly(plant()["model"], plant()["point"], x0=plant()["point"].states),
        "did you mean initial (deviation from the trim)?",
    ),
    "fly(initial_state)": (
        lambda: hfa.fly(plant()["model"], plant()["point"], initial_state=np.zeros(6)),
        "did you mean initial (deviation from the trim)?",
    ),
    "lqr(A, B)": (lambda: hfa.lqr([[1.0]], [[1.0]]), "the arguments are A, B, Q, R"),
    "lqr(A, B, Q, R, N, delta)": (
        lambda: hfa.lqr([[1.0]], [[1.0]], [[1.0]], [[1.0]], None, 100.0),
        "the arguments are A, B, Q, R, N",
    ),
    "Game(linear)": (
        lambda: hfa.Game(plant()["linear"], np.eye(6), np.eye(5)),
        "write hfa.game(linear, Q, R, delta)",
    ),
    "published_game(A)": (
        lambda: hfa.paper.published_game(np.eye(6)),
        "B is missing; give A and B, or a linear model",
    ),
    "LinearModel(A, B)": (
        lambda: hfa.LinearModel([[1.0]], [[1.0]]),
        "hfa.LinearModel.of(A, B, C, D)",
    ),
    "from_weights(functions)": (
        lambda: hfa.from_weights(plant()["game"], [1.0], functions="quadratic"),
        "did you mean basis?",
    ),
    "solution.gain": (lambda: plant()["solution"].gain, "did you mean K?"),
    "linear.zeta": (lambda: plant()["linear"].zeta, "LinearModel has no attribute 'zeta'"),
    "mode.zeta": (lambda: plant()["linear"].modes[0].zeta, "did you mean damping?"),
    "linear.dcgain": (lambda: plant()["linear"].dcgain(), "write linear.to_control().dcgain"),
    "game.changed": (lambda: plant()["game"].changed(delta=1.0), "write dataclasses.replace(game"),
    "model.elevator_center": (
        lambda: plant()["model"].elevator_center,
        "its inputs['elevator_center']",
    ),
    "model.with_parameters({})": (
        lambda: plant()["model"].with_parameters({}),
        "write model.with_parameters(NAME=VALUE)",
    ),
    "OperatingPoint.load(FILE)": (lambda: hfa.OperatingPoint.load("a.json"), "model of the point"),
    "margins(linear, solution)": (
        lambda: hfa.margins(plant()["linear"], plant()["solution"]),
        "K is a Solution; give its K",
    ),
    "track(linear, solution)": (
        lambda: hfa.track(plant()["linear"], plant()["solution"]),
        'write hfa.track(linear, solution, {"STATE": ',
    ),
    "keep_inside(policy)": (lambda: hfa.keep_inside(None), "model: the aircraft and its trim"),
    "linear.margins": (lambda: plant()["linear"].margins, "write its point.margins"),
    "solution.A": (lambda: plant()["solution"].A, "write its game.A"),
    "point.alpha": (lambda: plant()["point"].alpha, "write its ['alpha']"),
    "point.levels": (lambda: plant()["point"].levels, "write trim.levels_of("),
    "point.report(category)": (
        lambda: plant()["point"].report(category="C"),
        "for levels trim.levels_of(",
    ),
}


@pytest.mark.parametrize("call", REFUSED)
def test_a_wrong_call_names_the_right_one(call: str) -> None:
    """A wrong call is refused in one line that names the right call."""
    pytest.importorskip("hfa_flight")
    wrong, words = REFUSED[call]
    with pytest.raises((hfa.BadInputError, AttributeError, TypeError)) as refused:
        wrong()
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_every_public_function_and_class_names_its_arguments() -> None:
    """A public function or class called with an unknown argument is refused in one line."""
    pytest.importorskip("hfa_flight")
    public = [getattr(hfa, name) for name in dir(hfa)]
    called = [each for each in public if inspect.isfunction(each) or inspect.isclass(each)]
    called = [each for each in called if each not in (hfa.BadInputError, hfa.NoSolutionError)]
    assert {hfa.track, hfa.Verdict, hfa.Signal} < {*called}
    for each in called:
        with pytest.raises(hfa.BadInputError, match=f"^{each.__name__}: .*arguments are"):
            each(nonsense=1)


def test_a_matrix_k_is_a_critic_and_a_policy() -> None:
    """`hfa.verify` and `hfa.fly` take the matrix K of u = u0 - K z."""
    pytest.importorskip("hfa_flight")
    solution, point = plant()["solution"], plant()["point"]
    assert hfa.verify(plant()["game"], solution.K).ok
    flight = hfa.fly(plant()["model"], point, solution.K, 0.1, initial={"alpha": 0.01})
    alpha = plant()["game"].names.states.index("alpha")
    change = flight.inputs[0] - np.array(point.inputs)
    np.testing.assert_allclose(change, -0.01 * solution.K[:, alpha], rtol=1e-9, atol=1e-12)


def test_a_state_space_gives_the_game_of_its_linear_model() -> None:
    """`hfa.game` takes the `StateSpace` of python-control, with its names."""
    linear = plant()["linear"]
    games = [hfa.game(plant, np.ones(6), np.ones(5)) for plant in (linear, linear.to_control())]
    np.testing.assert_array_equal(games[1].A, games[0].A)
    assert games[1].names.states == games[0].names.states


def test_the_calls_that_the_messages_name_exist() -> None:
    """Each right call of `REFUSED` gives what it says; `initial` and K are tested above."""
    pytest.importorskip("hfa_flight")
    model, point, linear, game, solution = plant().values()
    P, K = solution.P, solution.K
    assert hfa.game(linear, game.Q, game.R, game.delta) == game
    row, column = np.triu_indices(6)
    W = (1.0 + (row != column)) * P[row, column]
    critics = (hfa.from_gain(game, K), hfa.from_value(game, P))
    for critic in (*critics, hfa.from_weights(game, W, basis="quadratic")):
        assert hfa.verify(game, critic).ok
    assert hfa.lqr([[0.0]], [[1.0]], [[4.0]], [[1.0]], [[1.0]]).K.item() == pytest.approx(2.0)
    again = hfa.paper.published_game(np.array(linear.A), np.array(linear.B))
    assert np.array_equal(hfa.solve(again).P, P)
    (entry,) = hfa.LinearModel.of([[1.0]], [[2.0]], [[3.0]], [[4.0]]).C.ravel()
    assert entry == 3.0
    mode = linear.modes[0]
    assert mode.damping == pytest.approx(-mode.eigenvalue.real / abs(mode.eigenvalue))
    assert set(linear.point.margins) >= set(model.inputs)
    assert np.array_equal(solution.game.A, game.A)
    assert point["alpha"] == point.states.alpha
    assert all(each.level in (1, 2, 3, 4, None) for each in trim.levels_of(point, trim.Airplane()))
