"""Public functions called with wrong arguments return a result or raise an error of one line."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from project import ROOT

import hfa
from controller import disk_margin
from hfa import BadInputError, NoSolutionError
from hfa_aircraft import in_si
from trim import transfers
from verification import Box, Scope


def main_arguments(function: Callable[..., Any]) -> list[str]:
    """Return the arguments that a call of a function cannot leave out."""
    parameters = inspect.signature(function).parameters.values()
    kinds = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    return [
        each.name for each in parameters if each.default is each.empty and each.kind not in kinds
    ]


@cache
def functions() -> dict[str, Callable[..., Any]]:
    """Return the public functions of `hfa` and `hfa.paper`, name -> function."""
    found = {}
    for module in (hfa, hfa.paper):
        for name in dir(module):
            value = getattr(module, name)
            if callable(value) and not inspect.isclass(value):
                found[name] = value
    return found


@cache
def valid_arguments() -> dict[str, Any]:
    """Return a value of each main argument, name -> value."""
    model = hfa.aircraft()
    point = hfa.trim(model, hfa.paper.level_flight(0.2))
    linear = hfa.linearize(model, point)
    game = hfa.paper.published_game(linear)
    solution = hfa.solve(game)
    x = ca.SX.sym("x", 6)
    return {
        "model": model,
        "point": point,
        "linear": linear,
        "game": game,
        "solution": solution,
        "critic": hfa.from_gain(game, solution.K),
        "policy": solution.K,
        "K": solution.K,
        "P": solution.P,
        "weights": np.ones(21),
        "source": ca.Function("square", [x], [x.T @ x]),
        "A": game.A,
        "B": game.B,
        "Q": np.ones(6),
        "R": np.ones(5),
        "order": 2,
        "reference": {"speed": 1.0},
        "dihedral": 0.1,
        "scheduled": 0.1,
        "text": f"{ROOT / 'examples' / 'navion.py'}:NAVION",
        "table": str(ROOT / "examples" / "uav.toml"),
        "path": "critic.npz",
        "deployment": str(ROOT / "examples" / "gtm_policy" / "late.toml"),
        "records": [str(ROOT / "examples" / "uav_record.csv")],
        "initial": {"speed": 1.0},
    }


@cache
def wrong_values() -> list[Any]:
    kept = ("model", "point", "linear", "game", "solution", "critic")
    values = [valid_arguments()[name] for name in kept]
    plain = [None, True, 0, -1, 3.5, 1j, float("nan"), float("inf"), 10**400, "", "x", b"x"]
    full = [[], {}, (), [1.0], {"x": 1.0}, ["x"], [None], [[1.0], [1.0, 2.0]], {1: 2}]
    arrays = [np.zeros(0), np.zeros(3), np.eye(6), np.full((6, 6), np.nan), np.array(["a"])]
    others = [object(), len, int, Path("x"), np.array([1j]), np.array([None]), ca.SX.sym("x")]
    return [*plain, *full, *arrays, *others, *values]


def fault(function: Callable[..., Any], arguments: Mapping[str, Any]) -> str:
    """Call a function, and return a description of an improper error, or "" if there is none.

    Proper errors are BadInputError and NoSolutionError with a message of one line.
    """
    try:
        function(**arguments)
    except (BadInputError, NoSolutionError) as error:
        return "" if "\n" not in str(error) else f"more than one line: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


def faults(function: Callable[..., Any], arguments: Mapping[str, Any]) -> dict[str, str]:
    """Call a function with every wrong value of each argument. Return case -> improper error."""
    found = {}
    for argument in arguments:
        for number, value in enumerate(wrong_values()):
            is_right = value is arguments[argument]
            if is_right or (argument == "K" and hasattr(value, "K")):  # a solution has a gain
                continue
            fault_text = fault(function, arguments | {argument: value})
            if fault_text:
                found[f"{argument} = {str(value)[:40]!r} ({number})"] = fault_text[:200]
    return found


@pytest.mark.parametrize(
    ("name", "argument"),
    [
        *(("trim", "hold"), ("trim", "condition"), ("trim", "start"), ("trim", "free")),
        *(("fly", "scenario"), ("fly", "duration"), ("fly", "initial"), ("verify", "scope")),
        *(("track", "K"), ("track", "duration"), ("sweep", "grid"), ("sweep", "condition")),
    ],
)
def test_a_wrong_optional_argument_is_named(name: str, argument: str) -> None:
    """An optional argument of a kind that fits nowhere is refused in one line with its name."""
    function = functions()[name]
    arguments = {each: valid_arguments()[each] for each in main_arguments(function)}
    for value in (object(), [object()], 1j):
        named = f"{argument} (is|does not consist)|unknown trim variable"
        with pytest.raises(BadInputError, match=rf"^[^\n]*({named})[^\n]*$"):
            function(**arguments, **{argument: value})


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", sorted(functions()))
def test_a_wrong_main_argument_is_named(name: str) -> None:
    """A public function refuses each main argument of a wrong kind in one line.

    The main arguments are those that a call cannot leave out.
    """
    function = functions()[name]
    arguments = {each: valid_arguments()[each] for each in main_arguments(function)}
    assert faults(function, arguments) == {}


GAME = hfa.Game([[1.0]], [[1.0]], Q=[1.0], R=[1.0], delta=2.0)


#: Words of the message -> wrong call of a public name that is not a main argument of a function.
WRONG_PARTS: dict[str, Callable[[], Any]] = {
    **{
        f"scope.box is {given}": partial(Scope, Box(box, ""))
        for given, box in {"[1.0, 1.0]": [1.0, 1.0], "[-1.0]": [-1.0]}.items()
    },
    "scope.box is 5": partial(Scope, 5),
    "flights is 'x'": partial(Scope, flights="x"),
    "plant is 3": partial(Scope, plant=3),
    "linear is 3": partial(hfa.verify, GAME, hfa.from_gain(GAME, [[1.0]]), linear=3),
    "name is 5": partial(hfa.Model, 5, {"x": hfa.Signal()}, {}, len),
    "min, max is": partial(hfa.Model, "a", {"x": hfa.Signal(min="a")}, {}, len),
    "game is 5": partial(disk_margin, 5, 5),
    "system is 5": partial(transfers, 5),
    "model is 5": partial(in_si, 5),
}


@pytest.mark.parametrize("words", WRONG_PARTS)
def test_a_wrong_part_is_named(words: str) -> None:
    """A wrong part of an argument is refused in one line, at the latest in its use by `verify`."""
    with pytest.raises(BadInputError, match=rf"^[^\n]*{re.escape(words)}[^\n]*$"):
        hfa.verify(GAME, hfa.from_gain(GAME, [[1.0]]), scope=WRONG_PARTS[words]())


@pytest.mark.parametrize(
    ("guess", "call"),
    [
        (lambda model, _: model.trim(dihedral=0.2), "hfa.trim(model, dihedral=0.2)"),
        (lambda model, _: model.linearize(), "hfa.linearize(model, hfa.trim(model))"),
        (lambda model, _: hfa.linearize(model), "hfa.linearize(model, hfa.trim(model))"),
        (lambda model, _: model.A, "hfa.trim(model).linearize().A"),
        (lambda model, _: hfa.environment(model, observations=["alpha"]), "hfa.environment("),
        (lambda *_: hfa.verify(GAME, K=[[1.0]]), "hfa.verify(game, hfa.from_gain(game, K))"),
        (lambda _, point: point.A, "point.linearize().A"),
        (lambda _, point: point.eigenvalues, "point.linearize().poles()"),
        (
            lambda _, point: hfa.lqr(point.linearize(), np.eye(6), np.eye(5)),
            "hfa.solve(hfa.game(linear, Q, R))",
        ),
        (lambda _, point: hfa.paper.published_game(point.linearize()).K, "hfa.solve(game).K"),
        (lambda *_: hfa.solve(GAME, delta=0.5), "hfa.solve(game.with_delta(delta))"),
        (lambda *_: tuple(hfa.solve(GAME)), "solution.K, solution.P"),
        (lambda *_: hfa.load_game("plant.npz"), "controller.load_game(FILE)"),
        (lambda *_: hfa.delta_min(GAME), "hfa.solve(game).delta_min"),
        (lambda *_: hfa.hinf(GAME), "hfa.solve(game).delta_min"),
        (
            lambda model, point: hfa.fly(model, point, "predictive", 2.0),
            "hfa.predictive(model, point",
        ),
        (
            lambda model, _: hfa.Model(
                "own",
                {"v": hfa.Signal("ft/s")},
                {"f": hfa.Signal("lb")},
                lambda x, u, p, w: ({"v": u.f}, {}),
            ),
            "lbf",
        ),
    ],
)
def test_a_guess_names_the_right_call(guess: Callable[..., Any], call: str) -> None:
    """What a new user tries in vain raises an error of one line that contains the call."""
    model, point = (valid_arguments()[name] for name in ("model", "point"))
    with pytest.raises((BadInputError, AttributeError)) as refused:
        guess(model, point)
    assert f"write {call}" in str(refused.value)
    assert "\n" not in str(refused.value)
