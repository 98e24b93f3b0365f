"""Forged certificates with right digests: what the checker accepts is true, judged without it, in
doubles."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from proof_cases import PROOFS, between, certificate, delayed_abscissa, forge
from random_points import INPUT_SCALES

import hfa_model
from controller import Game, basis
from controller.riccati.gare import solve_game
from controller.riccati.smallest_delta import minimum_delta
from hfa_aircraft.model import Model
from hfa_model import INPUTS, Parameters
from hfa_support import BadInputError, NoSolutionError
from trim import TrimCondition, find_operating_point, linearize
from verification import check_certificate
from verification.proof.checker.checker import Rejected
from verification.proof.search.scheduled_loop import Actuators, LoopTable

Content = dict[str, Any]
KINDS = tuple(PROOFS)
#: Rounding that the judge allows for: it computes in doubles.
ROUNDING = 1e-10


# The forger: one change of one thing.


def _places(part: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    for key, each in (
        part.items()
        if isinstance(part, dict)
        else enumerate(part)
        if isinstance(part, list)
        else ()
    ):
        yield from _places(each, (*path, key))


def _other(value: Any, random: np.random.Generator) -> Any:
    """Something else in place of a value: near it, far from it, or of another kind, shape or
    order."""
    ways: list[Callable[[], Any]] = [
        lambda: None,
        lambda: [],
        lambda: "alpha",
        lambda: float("nan"),
        lambda: True,
    ]
    if isinstance(value, list) and value:
        order = random.permutation(len(value)).tolist()
        ways = [
            lambda: value[:-1],
            lambda: value[1:],
            lambda: [*value, value[-1]],
            lambda: [value[i] for i in order],
        ]
        ways += [
            lambda: value[:1],
            lambda: [value],
            lambda: [value[0]] * len(value),
            lambda: value[::-1],
            lambda: [],
        ]
        if all(isinstance(each, list) for each in value):
            ways += [
                lambda: [list(each) for each in zip(*value, strict=False)],
                lambda: [each[:1] for each in value],
            ]
            if all(isinstance(each[0], float) for each in value if each):
                ways += [
                    lambda: np.eye(len(value), len(value[0])).tolist(),
                    lambda: (0.0 * np.array(value)).tolist(),
                ]
    elif isinstance(value, dict) and value:
        names = list(value)
        one, two = random.choice(names, 2)
        rest = {name: each for name, each in value.items() if name != one}
        ways = [
            lambda: rest,
            lambda: rest | {f"{one}_": value[one]},
            lambda: value | {one: value[two], two: value[one]},
        ]
        ways += [
            lambda: value | {"speed": 1.0},
            lambda: value | {"wing_color": 1.0},
            lambda: value | {"dihedral": 0.2},
        ]
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        near = [
            value * (1 + 1e-9),
            value * 1.001,
            value * 1.5,
            -value,
            0.0,
            value + 1,
            value - 1,
            value * 1e6,
        ]
        near.append(value * 1e-3)
        ways += [lambda each=each: each for each in near]  # type: ignore[misc]
        ways += [lambda: str(value), lambda: int(value) + 1, lambda: float("inf")]
    elif isinstance(value, str):
        ways += [
            lambda: "newton",
            lambda: "inf",
            lambda: "m/s",
            lambda: value + "1",
            lambda: "-" + value,
        ]
    return ways[random.integers(len(ways))]()


def _forged(whole: Content, random: np.random.Generator) -> Content:
    content = copy.deepcopy(whole)
    part = {key: content[key] for key in ("kind", "statement", "boxes", "open") if key in content}
    every = [path for path in _places(part) if path]
    # Most numbers are entries of matrices; blocks, names and single numbers are asked as often.
    few = [path for path in every if len(path) <= 4]
    among = few if random.random() < 0.6 else every
    path = among[random.integers(len(among))]
    holder: Any = content
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = _other(holder[path[-1]], random)
    return content


# The judge: doubles, the trims of this project, eigenvalues of NumPy.


@cache
def _model(
    aircraft: Model, imposed: tuple[tuple[str, float], ...], limits: str, degrees: float
) -> Any:
    ends = {name: tuple(each) for name, each in json.loads(limits)[0].items()}
    condition = TrimCondition(
        hfa_model.aircraft(), dict(imposed) | {"dihedral": np.radians(degrees)}, limits=ends
    )
    point = find_operating_point(aircraft, condition)
    return linearize(aircraft, point)


def _models(
    claim: Content, degrees: float, random: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """A, B and the inputs of the trim at an angle; with errors of the parameters, of two more
    aircraft within them."""
    if "A" in claim:
        yield np.array(claim["A"]), np.array(claim["B"]), np.zeros(0)
        return
    nominal = Parameters(**claim["parameters"])
    shifts = [dict.fromkeys(claim["spread"], 0.0)]
    if claim["spread"]:
        shifts += [
            {name: w * random.choice([-1.0, 1.0]) for name, w in claim["spread"].items()}
            for _ in range(2)
        ]

    free = [
        name
        for name in hfa_model.aircraft().variables
        if name not in claim["imposed"] and name != "dihedral"
    ]
    for shift in shifts:
        moved = nominal._replace(
            **{name: getattr(nominal, name) + each for name, each in shift.items()}
        )
        words = json.dumps([claim["limits"], free])
        model = _model(
            hfa_model.aircraft(claim["dynamics"], moved),
            tuple(claim["imposed"].items()),
            words,
            degrees,
        )
        inputs = np.array([getattr(model.point.inputs, name) for name in INPUTS])
        for name, value in zip(INPUTS, inputs, strict=True):
            low, high = claim["limits"].get(name, (-np.inf, np.inf))
            assert low - ROUNDING <= value <= high + ROUNDING, f"{name} is beyond its limits"
        yield model.A, model.B, inputs


def _at(table: Content, key: str, degrees: float) -> np.ndarray:
    return between(table["places"], table[key], degrees)


def _count(A: np.ndarray, line: float = 0.0) -> int | None:
    """Eigenvalues right of a line; None where rounding may decide."""
    real = np.linalg.eigvals(A).real - line
    return (
        None if np.abs(real).min() < 1e-6 * max(1.0, np.abs(A).max()) else int(np.sum(real > 0.0))
    )


def _loop(claim: Content, A: np.ndarray, B: np.ndarray, degrees: float) -> np.ndarray:
    K, M, N, X = (_at(claim["table"], key, degrees) for key in "KMNX")
    first = np.eye(len(A), len(M))
    return np.asarray(first.T @ (A @ first - B @ K) + N @ (A @ X - B @ K) + M)


def _delayed(
    claim: Content, A: np.ndarray, B: np.ndarray, degrees: float, random: np.random.Generator
) -> float:
    """The abscissa of the loop with a bandwidth, effectiveness and delay drawn from their
    intervals."""
    own = claim["actuators"]
    parts = {key: np.array(claim["table"][key]) for key in ("places", *"KMNX")}
    table = LoopTable(
        **parts,
        actuators=Actuators(*(np.array(own[key]) for key in ("own", "G", "U")), own["bandwidth"]),
    )
    arrives, late = (
        random.uniform(*own["effectiveness"], len(own["G"][0])),
        random.uniform(0.0, own["delay"]),
    )
    return delayed_abscissa(table, A, B, random.uniform(*own["bandwidth"]), arrives, late, degrees)


def judge(content: Content, path: Path) -> None:
    """AssertionError unless what the accepted certificate is reported to prove holds at sampled
    angles."""
    from verification.proof.search.proof_report import checked_report

    found, random = checked_report(check_certificate(path)).data, np.random.default_rng(1)
    claim = content["statement"]
    if "A" not in claim:
        assert [claim["state_units"], claim["input_units"]] == [
            ["ft/s", "rad", "rad", "rad/s", "rad", "rad/s"],
            ["1", *["rad"] * 4],
        ]
        assert claim["imposed"]["pitch_rate"] == claim["imposed"]["dihedral_rate"] == 0.0
    {"schedule": _judge_schedule, "game": _judge_game, "lpv": _judge_lpv}[found["kind"]](
        claim, found, random
    )


def _angles(low: float, high: float, random: np.random.Generator) -> list[float]:
    return [low, high, *random.uniform(low, high, 2).tolist()]


def _judge_schedule(claim: Content, found: Content, random: np.random.Generator) -> None:
    for name in ("loop", "modes"):
        for low, high, count in found[name]:
            for angle in _angles(low, high, random)[2 * (found["crossings"] != []) :]:
                for A, B, _ in _models(claim, angle, random):
                    if name == "loop" and "actuators" in claim:
                        assert max(_delayed(claim, A, B, angle, random) for _ in range(3)) < 0.0, (
                            f"loop at {angle}"
                        )
                        continue
                    matrix = _loop(claim, A, B, angle) if name == "loop" else A
                    assert _count(matrix) in (count, None), f"{name} at {angle}"
                    if name == "loop" and count == 0:
                        assert np.linalg.eigvals(matrix).real.max() < -found["decay_rate"] + 1e-6
    for low, high, (least, most) in found["crossings"]:
        for A, _, _ in _models(claim, (low + high) / 2, random):
            count = _count(A)
            assert count is None or least <= count <= most
    if "dihedral_rate_deg_s" in found:
        P, rate = claim["lyapunov"], found["dihedral_rate_deg_s"]
        for angle in np.linspace(*claim["range"], 9)[1:-1]:
            ((A, B, _),) = _models(claim, float(angle), random)
            V, loop = _at(P, "P", angle), _loop(claim, A, B, float(angle))
            step = 1e-3 * np.ptp(claim["range"])
            slope = (_at(P, "P", angle + step) - _at(P, "P", angle - step)) / (2 * step)
            assert np.linalg.eigvalsh(V).min() > 0.0
            for sign in (1, -1):
                assert (
                    np.linalg.eigvalsh(loop.T @ V + V @ loop + sign * rate * slope).max() < 0.0
                ), f"motion at {angle}"


def _judge_game(claim: Content, found: Content, random: np.random.Generator) -> None:
    ((A, B, _),) = _models(claim, claim["range"][0], random)
    own = claim["game"]
    game = Game(A=A, B=B, E=own["E"], Q=own["Q"], R=own["R"], delta=float(own["delta"]))
    exact, table = solve_game(game), claim["table"]
    targets = {"P": exact.P, "K": exact.K}
    if "W" in table:
        weights = basis("quadratic", len(A)).weights(exact.P)
        targets["W"] = np.concatenate([weights, np.zeros(len(table["W"]) - len(weights))])[:, None]
    for name, (least, most) in found["distances"].items():
        away = np.linalg.norm(table[name] - targets[name]) / np.linalg.norm(targets[name])
        assert least <= away * (1 + 1e-6) + ROUNDING, name
        assert most >= away * (1 - 1e-6) - ROUNDING, name
    assert (np.linalg.eigvals(A - B @ np.array(table["K"])).real.max() < 0.0) == found[
        "closed_loop_hurwitz"
    ]
    if "delta_min_above" in found:
        smallest = minimum_delta(game)
        assert found["delta_min_above"] <= smallest.value * (1 + 1e-6)
        assert found["delta_min_at_most"] >= smallest.refused * (1 - 1e-6)


def _judge_lpv(claim: Content, found: Content, random: np.random.Generator) -> None:
    own = claim["game"]
    for angle in _angles(*claim["range"], random):
        ((A, B, inputs),) = _models(claim, angle, random)
        game = Game(A=A, B=B, E=own["E"], Q=own["Q"], R=own["R"], delta=float(own["delta"]))
        exact = {
            "A": A,
            "B": B,
            "K": solve_game(game).K,
            "inputs": inputs[:, None] / np.array(INPUT_SCALES)[:, None],
        }
        for name, most in found["error"].items():
            given = _at(claim["table"], name, angle)
            given = given / np.array(INPUT_SCALES)[:, None] if name == "inputs" else given
            size = 1.0 if name == "inputs" else np.linalg.norm(exact[name])
            assert np.linalg.norm(given - exact[name]) / size <= most * (1 + 1e-6) + 1e-8, (
                f"{name} at {angle}"
            )


@pytest.mark.parametrize("count", [12, pytest.param(560, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_no_false_theorem_is_accepted(kind: str, count: int, tmp_path: Path) -> None:
    """One thing changed at a time: numbers, shapes, order, names, units, blocks; the digest is
    right."""
    random, accepted = np.random.default_rng([count, KINDS.index(kind)]), 0
    judge(certificate(kind), forge(tmp_path / "same.json", certificate(kind)))
    for number in range(count):
        content = _forged(certificate(kind), random)
        path = forge(tmp_path / "forged.json", content)
        try:
            check_certificate(path)
        except (Rejected, BadInputError):  # the latter names another model
            continue
        accepted += 1
        try:
            judge(content, path)
        except (AssertionError, NoSolutionError, ValueError) as error:
            raise AssertionError(f"{kind}, forgery {number} is accepted: {error}") from error
    assert 0 < accepted < count


def put(value: Any, *path: Any) -> Callable[[Content], None]:
    """Another value at a place, or what a function makes of the one there; None takes it away."""

    def change(content: Content) -> None:
        holder: Any = content
        for key in path[:-1]:
            holder = holder[key]
        if value is None:
            holder.pop(path[-1])
        else:
            holder[path[-1]] = value(holder[path[-1]]) if callable(value) else value

    return change


def _array(function: Callable[[np.ndarray], np.ndarray]) -> Callable[[Any], Any]:
    return lambda values: function(np.array(values)).tolist()


def _several(*changes: Callable[[Content], None]) -> Callable[[Content], None]:
    return lambda content: [change(content) for change in changes] and None  # type: ignore[return-value]


def _doubles_alone(content: Content) -> None:
    for box in chain(*content["boxes"].values()):
        box["decimals"] = False


def _one_direction(content: Content) -> None:
    for box in content["boxes"]["motion"]:
        box["turn"] = [[row[0]] for row in box["turn"]]


def _repeated(table: Content) -> Content:
    """Two more places before the others, which do not increase."""
    first = {key: [table[key][0], table[key][-1], *table[key]] for key in "KMNX"}
    return {"places": [0.0, 30.0, *table["places"]], **first}


_TINY = {key: [0.0, 1e-30] for key in ("A", "B", "inputs", "K")}
LOOP, MODES, TABLE, V = (
    ("boxes", "loop", 0),
    ("boxes", "modes", 0),
    ("statement", "table"),
    ("statement", "lyapunov"),
)
#: Name -> kind, and what is changed in a certificate whose digest is then right.
UNPROVED: dict[str, tuple[str, Callable[[Content], None]]] = {
    "rate": ("rate", put(0.5, *LOOP, "rate")),
    "negative rate": ("rate", put(-0.1, *LOOP, "rate")),
    "sign of H": ("rate", put(_array(np.negative), *LOOP, "H")),
    "singular H": ("rate", put(np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0]).tolist(), *LOOP, "H")),
    "no H": ("rate", put(None, *LOOP, "H")),
    "count": ("rate", put(0, *MODES, "unstable")),
    "gain": ("rate", put(np.zeros((5, 6)).tolist(), *TABLE, "K", 0)),
    "entry of A": ("rate", put(lambda ends: [ends[0], sum(ends) / 2], *LOOP, "A", 3, 1)),
    "trim": ("rate", put(lambda x: x + 1e-3, *LOOP, "trim", "throttle", 0)),
    "dynamics": ("rate", put("newton", "statement", "dynamics")),
    "a box twice": ("rate", put(lambda boxes: [boxes[-1], *boxes], "boxes", "modes")),
    "across an angle": ("rate", put([14.0, 14.02], *TABLE, "places")),
    "limit": ("rate", put(1.0, "statement", "limits", "throttle", 1)),
    "no limit": ("rate", put(None, "statement", "limits", "throttle")),
    "motion": ("rate", put(lambda rate: 2.0 * rate, "statement", "place_rate")),
    "lyapunov": (
        "rate",
        put(_array(lambda P: (P.T * np.linspace(1, 2, len(P))).T), *V, "P"),
    ),
    "every box at 14 deg": (
        "rate",
        put(float(np.radians(14.0)), "statement", "imposed", "dihedral"),
    ),
    "throttle imposed": ("rate", put(3.0, "statement", "imposed", "throttle")),
    "error of nothing": ("rate", put({"wing_color": 1.0}, "statement", "spread")),
    "delay": ("actuators", put(0.3, "statement", "actuators", "delay")),
    "bandwidth": ("actuators", put([0.05, 10.0], "statement", "actuators", "bandwidth")),
    "effectiveness": ("actuators", put([0.01, 1.0], "statement", "actuators", "effectiveness")),
    "a piece left out": ("actuators", put([2.0, 10.0], *LOOP, "pieces", 0, "bandwidth")),
    "a negative multiplier": ("actuators", put(lambda X: [-X[0], *X[1:]], *LOOP, "pieces", 0, "X")),
    "another H": (
        "actuators",
        put(lambda H: (1e-3 * np.eye(len(H))).tolist(), *LOOP, "pieces", 0, "H"),
    ),
    "commands": ("actuators", put(_array(np.negative), "statement", "actuators", "U", 0)),
    "radius": ("solution", put(1e-14, "statement", "distances", "P", 1)),
    "P": ("solution", put("1.0", "boxes", "solution", 0, "P", 0, 0, 0)),
    "bracket from below": (
        "solution",
        put(lambda ends: [ends[1] * (1 - 1e-12), ends[1]], "statement", "delta_min"),
    ),
    "bracket from above": (
        "solution",
        put(lambda ends: [ends[0], ends[0] * (1 + 1e-12)], "statement", "delta_min"),
    ),
    "count of A": ("solution", put(0, *MODES, "unstable")),
    "trim of a bound": ("solution", put("20.0", "boxes", "value", 0, "trim", "throttle", 0)),
    "Q": ("solution", put(lambda q: q * (1.0 + 1e-6), "statement", "game", "Q", 0, 0)),
    "nothing refused": ("solution", put([], "boxes", "refused")),
    "nearer": ("critic", put([0.0, 9e-4], "statement", "distances", "K")),
    "farther": ("critic", put([2e-6, 1.0], "statement", "distances", "W")),
    "unstable": ("critic", put(1, *LOOP, "unstable")),
}


#: What is refused before any arithmetic.
MALFORMED: dict[str, tuple[str, Callable[[Content], None]]] = {
    "a schedule of doubles": ("rate", _doubles_alone),
    "a solution of doubles": ("solution", _doubles_alone),
    "one direction": ("rate", _several(put(1e6, "statement", "place_rate"), _one_direction)),
    "all is open": (
        "critic",
        _several(put([], "boxes", "solution"), put({"solution": [[14.5, 14.5]]}, "open")),
    ),
    "no cells": ("lpv", _several(put(_TINY, "statement", "distances"), put([], "boxes", "cells"))),
    "unsorted": ("rate", put(_repeated, *TABLE)),
    "pitch imposed": ("rate", put(0.3, "statement", "imposed", "pitch")),
    "a unit": ("solution", put("m/s", "statement", "state_units", 0)),
    "no number": ("lpv", put([None], "statement", "imposed", "gamma")),
}


@pytest.mark.parametrize("name", UNPROVED | MALFORMED)
def test_a_forgery_with_a_right_digest_is_rejected(name: str, tmp_path: Path) -> None:
    kind, change = (UNPROVED | MALFORMED)[name]
    content = copy.deepcopy(certificate(kind))
    change(content)
    with pytest.raises(
        Rejected, match="is not what a certificate holds" if name in MALFORMED else None
    ):
        check_certificate(forge(tmp_path / "forged.json", content))
