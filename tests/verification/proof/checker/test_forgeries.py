"""Forged certificates with right digests: none that claims what is false is accepted.

A forgery is a false statement, false by construction, with a witness that an attacker may try: the
one of the true statement, damaged, exaggerated, or made by the prover for another one.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from proof_cases import (
    PROOFS,
    certificate,
    content,
    exact_loop,
    family,
    forge,
    game_at,
    model_of,
    two_trims,
)

from controller import Game
from hfa_support import BadInputError
from verification import Family, check_certificate, prove_schedule, prove_solution
from verification.proof.checker.reading import Malformed, Rejected
from verification.proof.search.loops import loop_of_gains

Content = dict[str, Any]
Change = Callable[[Content], None]


def put(value: Any, *path: Any) -> Change:
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


def several(*changes: Change) -> Change:
    def change(content: Content) -> None:
        for part in changes:
            part(content)

    return change


def array(function: Callable[[np.ndarray], np.ndarray]) -> Callable[[Any], Any]:
    return lambda values: function(np.array(values, dtype=float)).tolist()


# False statements: name -> change of a true one of a kind.

CLAIM = ("statement",)
FLIGHT = ("statement", "flight")
CONTROLLER = ("statement", "controller")


def _runs(least: int, most: int) -> Callable[[Any], Any]:
    return lambda runs: [[low, high, least, most] for low, high, *_ in runs]


def of_flights() -> dict[str, Change]:
    """No trim is there, or it is beyond its limits: of every statement about an aircraft."""
    changes: dict[str, Change] = {}

    def first_trim(function: Callable[[float, float], float]) -> Change:
        def change(content: Content) -> None:
            unknowns = content["statement"]["flight"]["trims"][0]["unknowns"]
            name = sorted(unknowns)[0]
            unknowns[name] = function(unknowns[name], 1.0)

        return change

    for step in (1e-3, 0.1, -0.1, 10.0, -1e6):
        changes[f"trim moved by {step}"] = first_trim(lambda x, _, step=step: x + step)

    def limit(end: int, width: float) -> Change:
        """A limit that the trim does not keep, the ends in order."""

        def change(content: Content) -> None:
            flight = content["statement"]["flight"]
            for name, value in flight["trims"][0]["unknowns"].items():
                away = width * (1.0 + abs(value))
                beyond = [value + away, value + 2 * away]
                flight["limits"][name] = beyond if end else [value - 2 * away, value - away]

        return change

    for width in (1e-2, 1.0, 100.0):
        changes[f"limits above the trim by {width}"] = limit(1, width)
        changes[f"limits below the trim by {width}"] = limit(0, width)

    def imposed_beyond(content: Content) -> None:
        flight = content["statement"]["flight"]
        for name, value in flight["imposed"].items():
            flight["limits"][name] = [value + 1.0, value + 2.0]

    def unlimited(content: Content) -> None:
        content["statement"]["flight"]["limits"] = {}

    changes["what is imposed lies beyond its limits"] = imposed_beyond
    changes["no limits"] = unlimited
    changes["other units"] = put(lambda units: ["furlong", *units[1:]], *FLIGHT, "state_units")
    changes["another file"] = put("f" * 64, *FLIGHT, "source")
    return changes


def of_schedules(kind: str) -> dict[str, Change]:
    changes = of_flights()
    for least, most in ((1, 1), (2, 2), (1, 2), (3, 6)):
        size = 1 if kind == "two trims" else 6
        if most <= size:
            name = f"{least} to {most} unstable modes of the loop"
            changes[name] = put(_runs(least, most), *CLAIM, "loop")
    for share in (-1.0, -0.5, -3.0, -100.0):  # feedback of the wrong sign destabilizes all of these
        part = "C" if kind in ("memory", "second order") else "D"
        if kind != "two trims" and not (kind == "gtm" and share > -100.0):
            changes[f"gains times {share}"] = put(
                array(lambda K, share=share: share * K), *CONTROLLER, part
            )
    if kind in ("rate", "memory", "second order", "errors", "crossing"):
        changes["no gains at an unstable angle"] = several(
            put(array(np.zeros_like), *CONTROLLER, "C"), put(array(np.zeros_like), *CONTROLLER, "D")
        )
    if kind != "actuators":
        for factor in (1.2, 3.0, 100.0, 1e9):
            changes[f"decay rate times {factor}"] = put(
                lambda rate, factor=factor: factor * rate, *CLAIM, "decay_rate"
            )
    wrong = {"two trims": 1, "gtm": 4, "crossing": 1}.get(kind, 3)
    changes["unstable modes of A"] = put(_runs(wrong, wrong), *CLAIM, "modes")
    if kind == "two trims":
        changes["the other trim"] = put(
            lambda trims: [{"breakpoint": 1.0, "unknowns": {"x": -np.sqrt(2.0)}}], *FLIGHT, "trims"
        )
    if kind == "actuators":
        actuators = ("statement", "uncertain_actuators")
        for name, value in (
            ("bandwidth", [1e-6, 1e6]),
            ("bandwidth", [1e-3, 10.0]),
            ("bandwidth", [0.02, 10.0]),
            ("effectiveness", [0.0, 1.0]),
            ("effectiveness", [1e-6, 1.0]),
            ("delay", 0.5),
            ("delay", 10.0),
        ):
            changes[f"{name} {value}"] = put(value, *actuators, name)
    if kind in ("memory", "second order"):
        slow = ("statement", "fixed_actuators", "bandwidth")
        weak = ("statement", "fixed_actuators", "effectiveness")
        for share in (1e-6, 1e-5):
            changes[f"bandwidths times {share}"] = put(
                array(lambda x, share=share: share * x), *slow
            )
            changes[f"effectiveness times {share}"] = put(
                array(lambda x, share=share: share * x), *weak
            )
    return changes


def of_games(kind: str) -> dict[str, Change]:
    changes = of_flights() if kind in ("solution", "critic", "one of two") else {}
    weights = ("statement", "weights")
    has_bracket = kind in ("solution", "scalar", "one of two")
    name = "P" if has_bracket else "K"
    for share in (0.5, 0.1, 1e-6):
        changes[f"nearer by {share}"] = put(
            lambda ends, share=share: [0.0, share * ends[1] * (1e-6 if has_bracket else 1.0)],
            *CLAIM,
            "distances",
            name,
        )
    for share in (1.1, 2.0, 1e6):
        changes[f"farther by {share}"] = put(
            lambda ends, share=share: [share * ends[1] + 1e-6, share * ends[1] + 1.0],
            *CLAIM,
            "distances",
            name,
        )
    for factor in (1.001, 2.0, 0.5, 100.0):
        scaled = array(lambda M, factor=factor: factor * M)
        if has_bracket:  # a critic may by chance be as near to the solution of another game
            changes[f"Q times {factor}"] = put(scaled, *weights, "Q")
            changes[f"R times {factor}"] = put(scaled, *weights, "R")
    changes["Q not semidefinite"] = put(
        array(lambda Q: np.diag([*[1e12] * (len(Q) - 1), -0.2])), *weights, "Q"
    )
    changes["R not definite"] = put(array(lambda R: -R), *weights, "R")
    changes["unstable loop"] = put([1, 1], *CLAIM, "loop")
    changes["no gain"] = put(array(np.zeros_like), *CLAIM, "critic", "K")
    if kind in ("scalar", "one of two"):
        del changes["no gain"]  # that is as stable
        changes["a gain that destabilizes"] = put([[-100.0]], *CLAIM, "critic", "K")
    if has_bracket:
        for share in (1.01, 2.0, 0.5, 0.9):
            changes[f"delta_min times {share}"] = put(
                lambda ends, share=share: [share * end for end in ends], *CLAIM, "delta_min"
            )
        wrong = [1, 1] if kind in ("scalar", "one of two") else [3, 3]
        changes["unstable modes of A"] = put(wrong, *CLAIM, "modes")
        changes["P moved"] = put(array(lambda P: 1.001 * P), *CLAIM, "critic", "P")
    return changes


def of_models() -> dict[str, Change]:
    changes = of_flights()
    for name in ("A", "B", "K", "inputs"):
        for share in (0.3, 1e-3, 0.0):
            changes[f"error of {name} times {share}"] = put(
                lambda error, share=share: share * error, *CLAIM, "errors", name
            )
        for factor in (1.1, -1.0, 0.0):
            changes[f"{name} times {factor}"] = put(
                array(lambda table, factor=factor: factor * table), *CLAIM, name
            )
    for factor in (0.5, 4.0):
        changes[f"Q times {factor}"] = put(
            array(lambda Q, factor=factor: factor * Q), *CLAIM, "weights", "Q"
        )
    del changes["error of inputs times 0.3"]  # the bound of the inputs is not so sharp
    return changes


def false_statements(kind: str) -> dict[str, Change]:
    if kind == "models":
        return of_models()
    if kind in ("solution", "critic", "scalar", "plant", "one of two"):
        return of_games(kind)
    return of_schedules(kind)


# Witnesses that an attacker may try.


def _each_box(content: Content) -> Iterator[Content]:
    """Every object of a witness that holds numbers of a proof."""
    waiting: list[Any] = [content["witness"]]
    while waiting:
        part = waiting.pop()
        if isinstance(part, dict):
            yield part
            waiting += part.values()
        elif isinstance(part, list):
            waiting += [entry for entry in part if isinstance(entry, (dict, list))]


def _with(name: str, function: Callable[[Any], Any]) -> Change:
    def change(content: Content) -> None:
        for box in _each_box(content):
            if name in box:
                box[name] = function(box[name])

    return change


def _wider_trims(content: Content) -> None:
    for box in _each_box(content):
        for name, numbers in box.get("trim", {}).items():
            if isinstance(numbers[0], str):
                box["trim"][name] = [numbers[0], 1e3 * numbers[1], 1e3 * numbers[2]]
            else:
                box["trim"][name] = [1e3 * numbers[0], *numbers[1:]]


def _follows_the_statement(content: Content) -> None:
    """Rates, trims and bandwidths as the statement has them."""
    statement = content["statement"]
    for box in _each_box(content):
        if "rate" in box and box in content["witness"].get("loop", []):
            box["rate"] = statement.get("decay_rate", box["rate"])
        if "bandwidth" in box:
            box["bandwidth"] = statement["uncertain_actuators"]["bandwidth"]
        for name, numbers in box.get("trim", {}).items():
            value = statement["flight"]["trims"][0]["unknowns"].get(name, 0.0)
            place = 0 if isinstance(numbers[0], str) else 1
            numbers[place] = repr(value) if place == 0 else value


def _not_symmetric(content: Content) -> None:
    for box in _each_box(content):
        if "reach" in box:
            box["P"][0][0][-1] = repr(float(box["P"][0][0][-1]) * 0.5)


WITNESSES: dict[str, Change] = {
    "as it was": lambda content: None,
    "following the statement": _follows_the_statement,
    "H turned": _with("H", array(np.negative)),
    "H of no size": _with("H", array(lambda H: 1e-30 * np.eye(len(H)))),
    "no coordinates": _with("turn", array(np.zeros_like)),
    "one coordinate": _with("turn", array(lambda T: np.outer(T[:, 0], np.ones(len(T))))),
    "wider trims": _wider_trims,
    "wider reach": _with("reach", lambda reach: 1e6 * float(reach)),
    "P not symmetric": _not_symmetric,
    "negative multipliers": _with("X", array(np.negative)),
    "huge multipliers": _with("X", array(lambda X: 1e12 * X)),
}


def forgeries() -> list[tuple[str, str, str]]:
    """Kind, false statement and witness."""
    found = []
    for kind in PROOFS:
        for statement in false_statements(kind):
            for witness in WITNESSES:
                found.append((kind, statement, witness))
    return found


def forged(kind: str, statement: str, witness: str) -> Content:
    made = copy.deepcopy(certificate(kind))
    false_statements(kind)[statement](made)
    WITNESSES[witness](made)
    return made


def assert_refused(made: Content, kind: str, path: Path) -> None:
    with pytest.raises((Rejected, BadInputError, Malformed)):
        check_certificate(forge(path, made), model=model_of(kind))


def test_some_forgeries_of_every_kind_are_refused(tmp_path: Path) -> None:
    everything = forgeries()
    assert len(everything) > 2000
    rng = np.random.default_rng(7)
    for kind in PROOFS:
        of_kind = [forgery for forgery in everything if forgery[0] == kind]
        for number in rng.permutation(len(of_kind))[:3]:
            assert_refused(forged(*of_kind[number]), kind, tmp_path / "forged.json")


@pytest.mark.slow
@pytest.mark.parametrize("kind", PROOFS)
def test_no_forgery_is_accepted(kind: str, tmp_path: Path) -> None:
    for forgery in forgeries():
        if forgery[0] == kind:
            assert_refused(forged(*forgery), kind, tmp_path / "forged.json")


# Forgeries that an earlier checker accepted.


@cache
def of_the_other_trim(kind: str) -> Content:
    """A certificate of the model with two trims, about the unstable one."""
    other = two_trims(start=-1.0)
    if kind == "one of two":
        game = Game(A=[[2 * np.sqrt(2.0)]], B=[[1.0]], E=[[1.0]], Q=[[1.0]], R=[[1.0]], delta=20.0)
        return content(prove_solution(game, Family(other), 1.0))
    loop = loop_of_gains(other, [1.0, 2.0], np.array([[[9.0]], [[9.0]]]))
    return content(prove_schedule(Family(other), loop, 1.0, 1.5, moving=True))


def _witness_of_the_other_trim(kind: str) -> Change:
    return lambda made: made.update(witness=of_the_other_trim(kind)["witness"])


def _bounds_of_the_other_trim(made: Content) -> None:
    """delta_min of the other trim, with its evidence, beside the solution of this one."""
    other = of_the_other_trim("one of two")
    made["statement"]["delta_min"] = other["statement"]["delta_min"]
    for name in ("value", "refused", "frequencies"):
        made["witness"].pop(name, None)
        if name in other["witness"]:
            made["witness"][name] = other["witness"][name]


def _of_another_angle(made: Content) -> None:
    """Boxes that are proved of the exact gains, of a loop whose gains are none."""
    own = content(prove_schedule(family(), exact_loop(14.0, 14.125), 14.0, 14.125))
    made["witness"]["loop"] = own["witness"]["loop"]


KNOWN: dict[str, tuple[str, Change]] = {
    "states of the aircraft that decay by themselves": (
        "rate",
        several(
            put(array(np.zeros_like), *CONTROLLER, "D"),
            put((-100.0 * np.eye(6)).tolist(), *CONTROLLER, "M"),
            put(50.0, *CLAIM, "decay_rate"),
        ),
    ),
    "a rate without bound": ("rate", put(1e9, *CLAIM, "scheduled_rate")),
    "gains of the wrong sign": ("gtm", put(array(lambda D: -100.0 * D), *CONTROLLER, "D")),
    "a good gain refuted": ("rate", put(_runs(1, 1), *CLAIM, "loop")),
    "actuators that do nothing": (
        "actuators",
        several(
            put([1e-6, 1e6], *CLAIM, "uncertain_actuators", "bandwidth"),
            put(np.zeros((11, 5)).tolist(), *CLAIM, "uncertain_actuators", "G"),
        ),
    ),
    "P that is not symmetric": ("plant", several(_not_symmetric)),
    "boxes of another trim": ("two trims", _witness_of_the_other_trim("two trims")),
    "a game of another trim": ("one of two", _witness_of_the_other_trim("one of two")),
    "delta_min of another trim": ("one of two", _bounds_of_the_other_trim),
    "speed beyond its limits": ("rate", put([70.0, 80.0], *FLIGHT, "limits", "speed")),
    "Q with a negative eigenvalue": (
        "plant",
        put([[1e12, 0.0], [0.0, -0.2]], *CLAIM, "weights", "Q"),
    ),
    "boxes of other gains": (
        "rate",
        several(put(array(np.zeros_like), *CONTROLLER, "D"), _of_another_angle),
    ),
}


@pytest.mark.parametrize("name", KNOWN)
def test_a_known_forgery_is_refused(name: str, tmp_path: Path) -> None:
    kind, change = KNOWN[name]
    made = copy.deepcopy(certificate(kind))
    change(made)
    assert_refused(made, kind, tmp_path / "forged.json")


def test_the_other_trim_has_a_certificate_of_its_own(tmp_path: Path) -> None:
    """It is refused as evidence about the first trim and not for itself; both are named."""
    for kind in ("two trims", "one of two"):
        path = forge(tmp_path / "other.json", of_the_other_trim(kind))
        verified = check_certificate(path, model=model_of(kind))
        flight = getattr(verified.statement, "flight", getattr(verified.statement, "plant", None))
        assert flight.trims[0].unknowns["x"] == pytest.approx(-np.sqrt(2.0))


# One thing that is wrong, and the message that names it.

LOOP = ("witness", "loop", 0)
NAMED: dict[str, tuple[str, Change, str]] = {
    "a negative multiplier": (
        "actuators",
        put(lambda X: [-X[0], *X[1:]], *LOOP, "pieces", 0, "X"),
        "a Lyapunov function or a multiplier is not positive",
    ),
    "a Lyapunov function that is not positive": (
        "actuators",
        put(array(np.negative), *LOOP, "pieces", 0, "H"),
        "a Lyapunov function or a multiplier is not positive",
    ),
    "a piece left out": (
        "actuators",
        put([2.0, 10.0], *LOOP, "pieces", 0, "bandwidth"),
        "the pieces do not cover 1.8 to 10: nothing is proved at 1.8 to 2",
    ),
    "H not symmetric": (
        "rate",
        put(lambda H: [[H[0][0], 2 * H[0][1] + 1.0, *H[0][2:]], *H[1:]], *LOOP, "H"),
        "H: not symmetric",
    ),
    "P of the motion not symmetric": (
        "rate",
        put(lambda P: P + 1.0, "witness", "motion", "P", 0, 0, 1),
        "P: not symmetric",
    ),
    "P of the motion not positive": (
        "rate",
        put(array(np.negative), "witness", "motion", "P"),
        "the Lyapunov function of the motion is not positive",
    ),
    "a rate of the statement": (
        "rate",
        put(lambda rate: 2.0 * rate, *CLAIM, "scheduled_rate"),
        "not positive definite",
    ),
    "a trim moved": (
        "rate",
        put(
            lambda numbers: [numbers[0], numbers[1] + 1e-3, *numbers[2:]], *LOOP, "trim", "throttle"
        ),
        "a root of the equations is not proved to exist",
    ),
    "a box across a breakpoint": (
        "rate",
        put([14.0, 14.02], *CONTROLLER, "breakpoints"),
        "the box crosses a breakpoint",
    ),
    "an unknown entry": ("models", put(1, *CLAIM, "wing_color"), "unknown entry"),
    "a missing entry": ("models", put(None, *CLAIM, "errors"), "missing entry"),
    "an error of nothing": (
        "rate",
        put({"wing_color": 1.0}, *FLIGHT, "spread"),
        "unknown entry",
    ),
    "no limit of the throttle": ("rate", put(None, *FLIGHT, "limits", "throttle"), "missing entry"),
    "pitch imposed": ("rate", put(0.3, *FLIGHT, "imposed", "pitch"), "unknown entry"),
    "no number": ("models", put([None], *FLIGHT, "imposed", "gamma"), "is not what a certificate"),
    "not finite": ("plant", put(float("nan"), *CLAIM, "plant", "A", 0, 0), "is not what a"),
    "rows of other lengths": ("plant", put([[1.0], [1.0, 2.0]], *CLAIM, "plant", "A"), "A"),
    "text for a number": ("rate", put("0.3", *CLAIM, "decay_rate"), "decay_rate"),
    "true for a number": ("rate", put(True, *CLAIM, "decay_rate"), "decay_rate"),
    "runs with a gap": (
        "rate",
        put([[14.0, 14.05, 0, 0], [14.06, 14.125, 0, 0]], *CLAIM, "loop"),
        "loop",
    ),
    "a radius of zero": (
        "rate",
        put(lambda numbers: [0.0, *numbers[1:]], *LOOP, "trim", "throttle"),
        "trim",
    ),
    "another kind": ("plant", put("schedule", "kind"), "flight"),
}


@pytest.mark.parametrize("name", NAMED)
def test_what_is_wrong_is_named(name: str, tmp_path: Path) -> None:
    kind, change, message = NAMED[name]
    made = copy.deepcopy(certificate(kind))
    change(made)
    with pytest.raises((Rejected, BadInputError), match=message):
        check_certificate(forge(tmp_path / "forged.json", made), model=model_of(kind))


def test_a_game_of_another_angle_is_refused(tmp_path: Path) -> None:
    """The right solution at 14.6 deg, of a statement about 14.5 deg."""
    made = copy.deepcopy(certificate("solution"))
    made["witness"] = content(prove_solution(game_at(14.6), family(), 14.6))["witness"]
    assert_refused(made, "solution", tmp_path / "forged.json")
