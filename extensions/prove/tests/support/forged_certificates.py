"""False statements with correct digests, and witnesses that an attacker may try for these
statements.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from proof_cases import PROOFS, certificate

Content = dict[str, Any]
Change = Callable[[Content], None]


def put(value: Any, *path: Any) -> Change:
    """Return a function that replaces the value at a path of a certificate.

    value: the new value, a function old value -> new value, or None to remove the entry
    path: keys of the entry
    """

    def change(content: Content) -> None:
        holder: Any = content
        for key in path[:-1]:
            holder = flight_in(content) if key == "flight" else holder[key]
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


# False statements: name -> change of a true certificate.

CLAIM = ("statement",)
FLIGHT = ("statement", "flight")
CONTROLLER = ("statement", "controller")


def flight_in(content: Content) -> Content:
    """Return the aircraft and its trims in the content of a certificate."""
    statement = content["statement"]
    found: Content = statement.get("flight") or statement["plant"]
    return found


def runs_of(least: int, most: int) -> Callable[[Any], Any]:
    return lambda runs: [[low, high, least, most] for low, high, *_ in runs]


def of_flights() -> dict[str, Change]:
    """Return name -> change of a certificate to a false or invalid statement about a flight."""
    changes: dict[str, Change] = {}

    def first_trim(function: Callable[[float, float], float]) -> Change:
        def change(content: Content) -> None:
            unknowns = flight_in(content)["trims"][0]["unknowns"]
            name = sorted(unknowns)[0]
            unknowns[name] = function(unknowns[name], 1.0)

        return change

    for step in (1e-3, 0.1, -0.1, 10.0, -1e6):
        changes[f"trim moved by {step}"] = first_trim(lambda x, _, step=step: x + step)

    def limit(end: int, width: float) -> Change:
        """Return a change of a certificate to limits that the trim violates.

        end: 1 for limits above the trim, 0 for limits below it
        width: distance from the trim, relative to 1 + |value|
        """

        def change(content: Content) -> None:
            flight = flight_in(content)
            for name, value in flight["trims"][0]["unknowns"].items():
                away = width * (1.0 + abs(value))
                beyond = [value + away, value + 2 * away]
                flight["limits"][name] = beyond if end else [value - 2 * away, value - away]

        return change

    for width in (1e-2, 1.0, 100.0):
        changes[f"limits above the trim by {width}"] = limit(1, width)
        changes[f"limits below the trim by {width}"] = limit(0, width)

    def imposed_beyond(content: Content) -> None:
        flight = flight_in(content)
        for name, value in flight["imposed"].items():
            flight["limits"][name] = [value + 1.0, value + 2.0]

    def unlimited(content: Content) -> None:
        flight_in(content)["limits"] = {}

    changes["what is imposed lies beyond its limits"] = imposed_beyond
    changes["no limits"] = unlimited
    changes["other units"] = put(
        lambda units: ["furlong", *units[1:]], *FLIGHT, "model", "state_units"
    )
    changes["another file"] = put("f" * 64, *FLIGHT, "model", "equations")
    return changes


def of_schedules(kind: str) -> dict[str, Change]:
    changes = of_flights()
    for least, most in ((1, 1), (2, 2), (1, 2), (3, 6)):
        size = 1 if kind == "two trims" else 6
        if most <= size:
            name = f"{least} to {most} unstable modes of the loop"
            changes[name] = put(runs_of(least, most), *CLAIM, "loop")
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
    changes["unstable modes of A"] = put(runs_of(wrong, wrong), *CLAIM, "modes")
    if kind == "two trims":
        changes["the other trim"] = put(
            lambda trims: [{"breakpoint": 1.0, "unknowns": {"x": -np.sqrt(2.0)}}], *FLIGHT, "trims"
        )
    if kind == "actuators":
        actuators = ("statement", "actuators")
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
        slow = ("statement", "actuators", "bandwidth")
        weak = ("statement", "actuators", "effectiveness")
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
        if (
            has_bracket
        ):  # without it, a critic may by chance be as close to the solution of another game
            changes[f"Q times {factor}"] = put(scaled, *weights, "Q")
            changes[f"R times {factor}"] = put(scaled, *weights, "R")
    changes["Q not semidefinite"] = put(
        array(lambda Q: np.diag([*[1e12] * (len(Q) - 1), -0.2])), *weights, "Q"
    )
    changes["R not definite"] = put(array(lambda R: -R), *weights, "R")
    changes["unstable loop"] = put([1, 1], *CLAIM, "loop")
    changes["no gain"] = put(array(np.zeros_like), *CLAIM, "critic", "K")
    if kind in ("scalar", "one of two"):
        del changes["no gain"]  # the loop without a gain is stable too
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


def false_statements(kind: str) -> dict[str, Change]:
    if kind in ("solution", "critic", "scalar", "plant", "one of two"):
        return of_games(kind)
    return of_schedules(kind)


# Witnesses that an attacker may try.


def _each_box(content: Content) -> Iterator[Content]:
    """Yield every JSON object in the witness of a certificate."""
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
    """Set rates, trims and bandwidths in the witness of a certificate to those of the statement."""
    statement = content["statement"]
    for box in _each_box(content):
        if "rate" in box and box in content["witness"].get("loop", []):
            box["rate"] = statement.get("decay_rate", box["rate"])
        if "bandwidth" in box:
            box["bandwidth"] = statement["actuators"]["bandwidth"]
        for name, numbers in box.get("trim", {}).items():
            value = flight_in(content)["trims"][0]["unknowns"].get(name, 0.0)
            place = 0 if isinstance(numbers[0], str) else 1
            numbers[place] = repr(value) if place == 0 else value


def not_symmetric(content: Content) -> None:
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
    "P not symmetric": not_symmetric,
    "negative multipliers": _with("X", array(np.negative)),
    "huge multipliers": _with("X", array(lambda X: 1e12 * X)),
}


def forgeries() -> list[tuple[str, str, str]]:
    """Return (kind, name of the false statement, name of the witness) of each forgery."""
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


# Removals: lists emptied, intervals made points, entries omitted, pairs exchanged.


def removals(content: Content) -> dict[str, Change]:
    """Return changes that remove or alter one part of a certificate, by name.

    The parts are in the statement and in the witness.
    """
    changes: dict[str, Change] = {}
    for part in ("statement", "witness"):
        for path, value in _containers((part,), content[part]):
            called = " ".join(map(str, path))
            for name, changed in _without(value).items():
                changes[f"{called}: {name}"] = put(changed, *path)
            if isinstance(value, dict):
                for key in value:
                    changes[f"{called}: without {key}"] = put(None, *path, key)
    return changes


def _containers(path: tuple[Any, ...], value: Any) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Yield the path and the value of every JSON object and list in a part of a certificate.

    In matrices and stacks, only the first list of each level is included.
    """
    if isinstance(value, dict):
        entries = list(value.items())
    elif isinstance(value, list):
        entries = list(enumerate(value if _has_objects(value) else value[:1]))
    else:
        return
    if len(path) > 1:
        yield path, value
    for key, entry in entries:
        yield from _containers((*path, key), entry)


def _has_objects(value: list[Any]) -> bool:
    return any(isinstance(entry, dict) for entry in value)


def _without(value: Any) -> dict[str, Any]:
    """Return changed copies of a list or an object by name, {} for an empty list.

    A copy is emptied, shortened, reordered or has its last entry twice. An interval also becomes a
    point.
    """
    if isinstance(value, dict):
        return {"emptied": {}} | _exchanged_entries(value)
    changed: dict[str, Any] = {"emptied": []}
    if not value:
        return {}
    changed["shortened"] = value[:-1]
    changed["doubled"] = [*value, value[-1]]
    if len(value) == 2 and all(isinstance(entry, (int, float)) for entry in value):
        changed["its low end"] = [value[0], value[0]]
        changed["its high end"] = [value[1], value[1]]
        changed["its middle"] = [sum(value) / 2] * 2
    for i in range(min(len(value), 6)):
        for j in range(i):
            exchanged = list(value)
            exchanged[i], exchanged[j] = value[j], value[i]
            if exchanged != value:
                changed[f"{j} and {i} exchanged"] = exchanged
    return changed


def _exchanged_entries(value: Content) -> dict[str, Any]:
    """Return copies of an object with two adjacent entries of equal type exchanged, by name."""
    changed = {}
    keys = list(value)
    for first, second in pairwise(keys):
        if type(value[first]) is type(value[second]) and value[first] != value[second]:
            exchanged = value | {first: value[second], second: value[first]}
            changed[f"{first} and {second} exchanged"] = exchanged
    return changed


def wrong_critics_without_a_claim(kind: str) -> dict[str, Change]:
    """Return changes of a certificate to a wrong part of the critic, by name.

    The changed certificates claim nothing about this part that is true.
    """
    changes: dict[str, Change] = {}
    for part in certificate(kind)["statement"]["critic"]:
        for factor in (-5.0, -3.0, 0.0, 1.5):
            wrong = put(array(lambda M, factor=factor: factor * M), *CLAIM, "critic", part)
            silent = put(None, *CLAIM, "distances", part)
            open_loop = put(lambda ends: [0, ends[1]], *CLAIM, "loop")
            size = len(certificate(kind)["statement"]["weights"]["Q"])
            anything = put([0, size], *CLAIM, "loop")
            changes[f"{part} times {factor}, no distance"] = several(wrong, silent)
            changes[f"{part} times {factor}, no distance, loop open"] = several(
                wrong, silent, anything, put([], "witness", "loop")
            )
            changes[f"{part} times {factor}, any distance, loop open"] = several(
                wrong, put([0.0, 1e9], *CLAIM, "distances", part), anything
            )
            changes[f"{part} times {factor}, any distance"] = several(
                wrong, put([0.0, 1e9], *CLAIM, "distances", part), open_loop
            )
    return changes
