"""Public functions called with wrong arguments return a result or raise an error of one line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from extension import needs
from project import ROOT

import controller
import hfa
import hfa_design
import trim
import verification
from hfa import BadInputError, NoSolutionError

#: Public functions with valid arguments. Each argument is replaced in turn.
Calls = dict[str, tuple[Callable[..., Any], dict[str, Any]]]


@cache
def valid_calls() -> Calls:
    model = hfa.aircraft()
    condition = hfa.paper.level_flight(0.2)
    point = hfa.trim(model, condition)
    linear = hfa.linearize(model, point)
    game = hfa.paper.published_game(linear)
    exact = hfa.solve(game)
    critic = hfa.from_gain(game, exact.K)
    functions: dict[Callable[..., Any], dict[str, Any]] = {
        hfa.aircraft: {"dynamics": "newton", "parameters": None},
        hfa.load_model: {"text": f"{ROOT / 'examples' / 'navion.py'}:NAVION"},
        hfa.trim: {"model": model, "condition": condition, "start": point},
        hfa.linearize: {
            "model": model,
            "point": point,
            "outputs": ("speed",),
            "disturbances": ("updraft",),
        },
        hfa.sweep: {"model": model, "grid": {"dihedral": [0.1, 0.2]}, "condition": condition},
        hfa.game: {"linear": linear, "Q": np.ones(6), "R": np.ones(5), "delta": 200.0, "E": None},
        hfa.solve: {"game": game, "progress": None},
        hfa.from_gain: {"game": game, "K": exact.K},
        hfa.from_value: {"game": game, "P": exact.P},
        hfa.from_weights: {
            "game": game,
            "weights": np.ones(21),
            "basis": "quadratic",
            "constant": 0.0,
            "precision": "float64",
        },
        hfa.verify: {"game": game, "critic": critic, "limit": 1e-6, "scope": None},
        hfa.paper.level_flight: {"dihedral": 0.1, "limits": {}},
        hfa.paper.level_model: {"model": model, "scheduled": 0.2},
        trim.release: {"condition": condition, "free": ("speed",), "hold": {"throttle": 40.0}},
        trim.trim_points: {
            "model": model,
            "variables": ("dihedral",),
            "values": np.array([[0.1], [0.2]]),
            "condition": condition,
        },
        trim.modes_of: {"A": linear.A, "states": linear.states},
        trim.trim_report: {"model": model, "condition": condition, "point": point},
        hfa.TrimCondition: {"model": model, "imposed": dict(condition.imposed)},
        hfa.paper.published_game: {"A": linear},
        controller.basis: {"name": "quadratic", "states": 6},
        controller.random_pool: {"game": game, "count": 3, "seed": 0},
        hfa.solve: {"game": game},
        controller.minimum_delta: {"game": game},
        controller.bounded_real_gain: {"game": game, "K": exact.K},
        controller.disk_margin: {"game": game, "K": exact.K},
        verification.relative_error: {"value": exact.K, "exact": exact.K},
        controller.solve_games: {"A": np.array([game.A]), "B": np.array([game.B]), "like": game},
        verification.Scope: {"flights": 10, "seconds": 0.0},
    }
    return {function.__name__: (function, right) for function, right in functions.items()}


@cache
def valid_calls_of_extensions() -> Calls:
    import hfa_flight

    calls = valid_calls()
    model = calls["linearize"][1]["model"]
    point = calls["linearize"][1]["point"]
    game = calls["solve"][1]["game"]
    K = calls["from_gain"][1]["K"]
    policy = hfa_flight.GainPolicy("exact", K)
    envelope = hfa_flight.flight_envelope(model, point)
    scenario = hfa_flight.Scenario(duration=0.01)
    x = ca.SX.sym("x", 6)
    square = ca.Function("square", [x], [x.T @ x])
    functions: dict[Callable[..., Any], dict[str, Any]] = {
        hfa.from_network: {"game": game, "source": square, "network": "V="},
        hfa_flight.flight_envelope: {"model": model, "point": point},
        hfa.fly: {
            "model": model,
            "point": point,
            "policy": policy,
            "scenario": scenario,
            "envelope": envelope,
            "predict": False,
        },
        controller.GainSchedule: {
            "breakpoints": np.array([0.1, 0.2]),
            "gains": np.array([K, K]),
            "model": model,
        },
        hfa_design.load_design: {"name": "paper", "model": model},
    }
    return {function.__name__: (function, right) for function, right in functions.items()}


@cache
def wrong_values() -> list[Any]:
    calls = valid_calls()
    arguments = {
        name: calls["trim_report"][1][name] for name in ("model", "condition", "point")
    } | {
        "linear": calls["published_game"][1]["A"],
        "game": calls["solve"][1]["game"],
    }
    plain = [None, True, 0, -1, 3.5, 1j, float("nan"), float("inf"), 10**400, "", "x", b"x"]
    full = [[], {}, (), [1.0], {"x": 1.0}, ["x"], [None], [[1.0], [1.0, 2.0]], {1: 2}]
    arrays = [np.zeros(0), np.zeros(3), np.eye(6), np.full((6, 6), np.nan), np.array(["a"])]
    others = [object(), len, int, Path("x"), np.array([1j]), np.array([None]), ca.SX.sym("x")]
    return [*plain, *full, *arrays, *others, *arguments.values()]


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
            fault_text = fault(function, arguments | {argument: value})
            if fault_text:
                found[f"{argument} = {str(value)[:40]!r} ({number})"] = fault_text[:200]
    return found


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["linearize", "trim", "from_gain", "modes_of"])
def test_a_wrong_argument_is_named(name: str) -> None:
    """A core function accepts valid arguments and refuses wrong values with a proper error."""
    function, arguments = valid_calls()[name]
    function(**arguments)
    assert faults(function, arguments) == {}


@needs("hfa_flight", "hfa_design")
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_every_wrong_argument_of_every_function_is_named() -> None:
    """All public functions, also of extensions, refuse wrong values with a proper error."""
    count = 0
    for name, (function, arguments) in (valid_calls() | valid_calls_of_extensions()).items():
        function(**arguments)
        assert faults(function, arguments) == {}, name
        count += len(arguments) * len(wrong_values())
    assert count > 3000


def test_a_function_without_checks_is_detected() -> None:
    """The test harness reports a function that does not check its arguments."""

    def unchecked(point: Any) -> Any:
        return point.refuse_other()

    assert "refuse_other" in fault(unchecked, {"point": None})
