"""Forged certificates with right digests: what the checker accepts is true, judged without it, in doubles."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from proof_cases import ORIGIN, exact_table, family, forge, scalar_game

from controller import Game, basis
from controller.game.critic_file import StoredCritic
from controller.policy.gain_table import GainTable
from controller.riccati.gare import solve_game
from controller.riccati.smallest_delta import minimum_delta
from hfa_model import INPUTS, LINEAR_STATES, Aircraft, Parameters, default_parameters
from hfa_model.vectors import INPUT_SCALES
from hfa_support import NoSolutionError
from trim import TrimCondition, find_operating_point, linearize
from verification import Family, check_certificate, coarsest_grid, prove_critic, prove_rate, prove_schedule
from verification.checker.checker import Rejected
from verification.proof.certificate_file import ScheduleCertificate, write_certificate
from verification.proof.lpv_grid import certify
from verification.proof.solution_proof import critic_claim, prove_solution, solution_claim

Content = dict[str, Any]
KINDS = ("rate", "memory", "crossing", "errors", "solution", "critic", "scalar", "plant", "lpv")
#: Rounding that the judge allows for: it computes in doubles.
ROUNDING = 1e-10


def _schedule(path: Path, flights: Family, table: GainTable, low: float, high: float, *, rate: bool = False) -> None:
    proof = prove_schedule(flights, table, low, high)
    motion = prove_rate(flights, table, low, high) if rate else None
    ScheduleCertificate(flights, table, low, high, path, ORIGIN).finish(proof, motion)


def _with_memory() -> GainTable:
    """Throttle and elevators through lags that are states of the loop."""
    exact, rows = exact_table(14.0, 14.125), np.arange(5)
    K, M = np.zeros((2, 5, 11)), np.zeros((2, 11, 11))
    K[:, rows, 6 + rows], M[:, 6 + rows, 6 + rows], M[:, 6:, :6] = -1.0, -400.0, -400.0 * exact.K
    return GainTable(exact.dihedral_deg, K, M)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Content]:
    folder, known = tmp_path_factory.mktemp("proofs"), default_parameters()
    files = {kind: folder / f"{kind}.json" for kind in KINDS}
    spread = tuple(known.standard_errors.get(name, 0.0) for name in known.values._fields)
    wide = Family(Aircraft(known.values), spread=spread)
    _schedule(files["rate"], family(), exact_table(14.0, 14.125), 14.0, 14.125, rate=True)
    _schedule(files["memory"], family(), _with_memory(), 14.0, 14.0625)
    _schedule(files["crossing"], family(), exact_table(16.6875, 16.6895), 16.6875, 16.6895)
    _schedule(files["errors"], wide, exact_table(14.0, 14.0625), 14.0, 14.0625)
    aircraft, plant = (
        _game(14.5),
        Game(A=[[0.0, 1.0], [2.0, -1.0]], B=[[0.0], [1.0]], E=np.eye(2), Q=np.eye(2), R=[[1.0]], delta=50.0),
    )
    for name, game, flights, degrees in (
        ("solution", aircraft, family(), 14.5),
        ("scalar", scalar_game(2.0), None, None),
    ):
        proof = prove_solution(game, flights, degrees)
        write_certificate(files[name], ORIGIN, "game", *solution_claim(proof))
    for name, game, flights, degrees in (("critic", aircraft, family(), 14.5), ("plant", plant, None, None)):
        exact, functions = solve_game(game), basis("quadratic", len(game.A))
        stored = StoredCritic(functions.weights(exact.P) * (1 + 1e-6), None, exact.K * (1 + 1e-3))
        found = prove_critic(game, stored, functions, flights, degrees)
        write_certificate(files[name], ORIGIN, "game", *critic_claim(found))
    certify(coarsest_grid(family(), 14.0, 14.0625, 1e-2), family(), files["lpv"], ORIGIN)
    return {kind: json.loads(path.read_text()) for kind, path in files.items()}


def _game(degrees: float) -> Game:
    from known_models import game_at

    return game_at(degrees)


# The forger: one change of one thing.


def _places(part: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    for key, each in part.items() if isinstance(part, dict) else enumerate(part) if isinstance(part, list) else ():
        yield from _places(each, (*path, key))


def _other(value: Any, random: np.random.Generator) -> Any:
    """Something else in place of a value: near it, far from it, or of another kind, shape or order."""
    ways: list[Callable[[], Any]] = [lambda: None, lambda: [], lambda: "alpha", lambda: float("nan"), lambda: True]
    if isinstance(value, list) and value:
        order = random.permutation(len(value)).tolist()
        ways = [lambda: value[:-1], lambda: value[1:], lambda: [*value, value[-1]], lambda: [value[i] for i in order]]
        ways += [lambda: value[:1], lambda: [value], lambda: [value[0]] * len(value), lambda: value[::-1], lambda: []]
        if all(isinstance(each, list) for each in value):
            ways += [lambda: [list(each) for each in zip(*value, strict=False)], lambda: [each[:1] for each in value]]
            if all(isinstance(each[0], float) for each in value if each):
                ways += [
                    lambda: np.eye(len(value), len(value[0])).tolist(),
                    lambda: (0.0 * np.array(value, float)).tolist(),
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
        ways += [lambda: value | {"speed": 1.0}, lambda: value | {"wing_color": 1.0}, lambda: value | {"dihedral": 0.2}]
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
            value * 1e-3,
        ]
        ways += [lambda each=each: each for each in near]  # type: ignore[misc]
        ways += [lambda: str(value), lambda: int(value) + 1, lambda: float("inf")]
    elif isinstance(value, str):
        ways += [lambda: "newton", lambda: "inf", lambda: "m/s", lambda: value + "1", lambda: "-" + value]
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
def _model(aircraft: Aircraft, imposed: tuple[tuple[str, float], ...], limits: str, degrees: float) -> Any:
    free = tuple(name for name in json.loads(limits)[1])
    ends = {name: tuple(each) for name, each in json.loads(limits)[0].items()}
    condition = TrimCondition(dict(imposed) | {"dihedral": np.radians(degrees)}, free, limits=ends)
    point = find_operating_point(aircraft, condition)
    return linearize(aircraft, point)


def _models(
    claim: Content, degrees: float, random: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """A, B and the inputs of the trim at an angle; with errors of the parameters, of two more aircraft within them."""
    if "A" in claim:
        yield np.array(claim["A"]), np.array(claim["B"]), np.zeros(0)
        return
    nominal = Parameters(**claim["parameters"])
    shifts = [dict.fromkeys(claim["spread"], 0.0)]
    if claim["spread"]:
        shifts += [{name: w * random.choice([-1.0, 1.0]) for name, w in claim["spread"].items()} for _ in range(2)]
    from trim.point.condition import VARIABLES

    free = [name for name in VARIABLES if name not in claim["imposed"] and name != "dihedral"]
    for shift in shifts:
        moved = nominal._replace(**{name: getattr(nominal, name) + each for name, each in shift.items()})
        words = json.dumps([claim["limits"], free])
        model = _model(Aircraft(moved, claim["dynamics"]), tuple(claim["imposed"].items()), words, degrees)
        inputs = np.array([getattr(model.point.inputs, name) for name in INPUTS])
        for name, value in zip(INPUTS, inputs, strict=True):
            low, high = claim["limits"][name]
            assert low - ROUNDING <= value <= high + ROUNDING, f"{name} is beyond its limits"
        yield model.A, model.B, inputs


def _at(table: Content, key: str, degrees: float) -> np.ndarray:
    angles, values = np.array(table["dihedral_deg"]), np.array(table[key])
    flat = [np.interp(degrees, angles, each) for each in values.reshape(len(angles), -1).T]
    return np.array(flat).reshape(values.shape[1:])


def _count(A: np.ndarray, line: float = 0.0) -> int | None:
    """Eigenvalues right of a line; None where rounding may decide."""
    real = np.linalg.eigvals(A).real - line
    return None if np.abs(real).min() < 1e-6 * max(1.0, np.abs(A).max()) else int(np.sum(real > 0.0))


def _loop(claim: Content, A: np.ndarray, B: np.ndarray, degrees: float) -> np.ndarray:
    K, M, N, X = (_at(claim["table"], key, degrees) for key in "KMNX")
    first = np.eye(len(A), len(M))
    return np.asarray(first.T @ (A @ first - B @ K) + N @ (A @ X - B @ K) + M)


def judge(content: Content, path: Path) -> None:
    """AssertionError unless what the accepted certificate is reported to prove holds at sampled angles."""
    from verification.proof.proof_report import checked_report

    found, random = checked_report(check_certificate(path)).data, np.random.default_rng(1)
    claim = content["statement"]
    if "A" not in claim:
        assert [claim["state_units"], claim["input_units"]] == [
            ["ft/s", "rad", "rad", "rad/s", "rad", "rad/s"],
            ["1", *["rad"] * 4],
        ]
        assert claim["imposed"]["pitch_rate"] == claim["imposed"]["dihedral_rate"] == 0.0
    {"schedule": _judge_schedule, "game": _judge_game, "lpv": _judge_lpv}[found["kind"]](claim, found, random)


def _angles(low: float, high: float, random: np.random.Generator) -> list[float]:
    return [low, high, *random.uniform(low, high, 2).tolist()]


def _judge_schedule(claim: Content, found: Content, random: np.random.Generator) -> None:
    for name in ("loop", "modes"):
        for low, high, count in found[name]:
            for angle in _angles(low, high, random)[2 * (found["crossings"] != []) :]:
                for A, B, _ in _models(claim, angle, random):
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
        for angle in np.linspace(*claim["dihedral_deg"], 9)[1:-1]:
            ((A, B, _),) = _models(claim, float(angle), random)
            V, loop = _at(P, "P", angle), _loop(claim, A, B, float(angle))
            step = 1e-3 * np.ptp(claim["dihedral_deg"])
            slope = (_at(P, "P", angle + step) - _at(P, "P", angle - step)) / (2 * step)
            assert np.linalg.eigvalsh(V).min() > 0.0
            for sign in (1, -1):
                assert np.linalg.eigvalsh(loop.T @ V + V @ loop + sign * rate * slope).max() < 0.0, f"motion at {angle}"


def _judge_game(claim: Content, found: Content, random: np.random.Generator) -> None:
    ((A, B, _),) = _models(claim, claim["dihedral_deg"][0], random)
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
    assert (np.linalg.eigvals(A - B @ np.array(table["K"])).real.max() < 0.0) == found["closed_loop_hurwitz"]
    if "delta_min_above" in found:
        smallest = minimum_delta(game)
        assert found["delta_min_above"] <= smallest.value * (1 + 1e-6)
        assert found["delta_min_at_most"] >= smallest.refused * (1 - 1e-6)


def _judge_lpv(claim: Content, found: Content, random: np.random.Generator) -> None:
    own = claim["game"]
    for angle in _angles(*claim["dihedral_deg"], random):
        ((A, B, inputs),) = _models(claim, angle, random)
        game = Game(A=A, B=B, E=own["E"], Q=own["Q"], R=own["R"], delta=float(own["delta"]))
        exact = {"A": A, "B": B, "K": solve_game(game).K, "inputs": inputs[:, None] / np.array(INPUT_SCALES)[:, None]}
        for name, most in found["error"].items():
            given = _at(claim["table"], name, angle)
            given = given / np.array(INPUT_SCALES)[:, None] if name == "inputs" else given
            size = 1.0 if name == "inputs" else np.linalg.norm(exact[name])
            assert np.linalg.norm(given - exact[name]) / size <= most * (1 + 1e-6) + 1e-8, f"{name} at {angle}"


@pytest.mark.parametrize("kind", KINDS)
def test_the_judge_agrees_with_what_was_proved(certificates: dict[str, Content], kind: str, tmp_path: Path) -> None:
    judge(certificates[kind], forge(tmp_path / "same.json", certificates[kind]))


@pytest.mark.parametrize("count", [40, pytest.param(560, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_no_false_theorem_is_accepted(certificates: dict[str, Content], kind: str, count: int, tmp_path: Path) -> None:
    """One thing changed at a time: numbers, shapes, order, names, units, blocks; the digest is right."""
    random, accepted = np.random.default_rng([count, KINDS.index(kind)]), 0
    for number in range(count):
        content = _forged(certificates[kind], random)
        path = forge(tmp_path / "forged.json", content)
        try:
            check_certificate(path)
        except Rejected:
            continue
        accepted += 1
        try:
            judge(content, path)
        except (AssertionError, NoSolutionError, ValueError) as error:
            raise AssertionError(f"{kind}, forgery {number} is accepted: {error}") from error
    assert 0 < accepted < count


def _one_direction(content: Content) -> None:
    content["statement"]["dihedral_rate"] = 1e6
    P = np.array(content["statement"]["lyapunov"]["P"])
    content["statement"]["lyapunov"]["P"] = np.broadcast_to(np.eye(6), P.shape).tolist()
    for box in content["boxes"]["motion"]:
        box["turn"] = [[row[0]] for row in box["turn"]]


def _one_entry_of_the_loop(content: Content) -> None:
    n = len(content["statement"]["table"]["M"])
    content["statement"]["table"] |= {"M": [[-1.0]], "K": [[0.0]] * 5, "N": [[0.0] * 6], "X": [[0.0]] * 6}
    content["boxes"]["loop"][0] |= {"H": [[1.0]], "turn": [[1.0]]}
    assert n == len(LINEAR_STATES)


def _damped_by_M(content: Content) -> None:
    content["statement"]["table"] |= {"M": (-1e3 * np.eye(6)).tolist(), "K": np.zeros((5, 6)).tolist()}
    content["boxes"]["loop"][0] |= {"H": np.eye(6).tolist(), "turn": np.eye(6).tolist()}


def _all_open(content: Content) -> None:
    content["statement"]["distances"]["K"] = [0.0, 1e-30]
    content["open"] = {"solution": [[14.5, 14.5]]}
    content["boxes"]["solution"] = []


def _no_cells(content: Content) -> None:
    content["statement"]["distances"] = {key: [0.0, 1e-30] for key in content["statement"]["distances"]}
    content["open"] = {"cells": [content["statement"]["dihedral_deg"]]}
    content["boxes"]["cells"] = []


def _unsorted(content: Content) -> None:
    table = content["statement"]["table"]
    table["dihedral_deg"] = [0.0, 30.0, *table["dihedral_deg"]]
    for key in "KMNX":
        table[key] = [table[key][0], table[key][-1], *table[key]]


def _overwritten(content: Content) -> None:
    content["statement"]["imposed"]["pitch"] = 0.3


def _units(content: Content) -> None:
    content["statement"]["state_units"][0] = "m/s"


def _null(content: Content) -> None:
    content["statement"]["imposed"]["gamma"] = None


def _doubles_alone(content: Content) -> None:
    for boxes in content["boxes"].values():
        for box in boxes:
            box["decimals"] = False


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("rate", _doubles_alone),
        ("solution", _doubles_alone),
        ("rate", _one_direction),
        ("critic", _one_entry_of_the_loop),
        ("critic", _damped_by_M),
        ("critic", _all_open),
        ("lpv", _no_cells),
        ("rate", _unsorted),
        ("rate", _overwritten),
        ("solution", _units),
        ("lpv", _null),
    ],
)
def test_a_known_forgery_is_rejected(
    certificates: dict[str, Content], kind: str, change: Callable[[Content], None], tmp_path: Path
) -> None:
    content = copy.deepcopy(certificates[kind])
    change(content)
    with pytest.raises(Rejected, match=r"is not what a certificate holds"):
        check_certificate(forge(tmp_path / "forged.json", content))
