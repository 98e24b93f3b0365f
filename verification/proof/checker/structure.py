"""What a certificate may hold, declared: every entry, shape, order, unit and number, required
before any arithmetic.

Whatever is not declared is refused, so that the checker computes with what it was written for and
nothing else."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import Any

import numpy as np

import hfa_model
from hfa_aircraft.model import Model
from hfa_model.unsteady import UNSTEADY
from hfa_model.variants import VARIANTS
from hfa_support.errors import BadInputError, NoSolutionError, shown

# A declaration is a shape, "g m n", of a nested list of finite numbers: a letter is the same length
# wherever it comes, * any, and . any or none; numbers may be in quotes after "decimal". Or (shape,
# test of the array), a table of entries of which those that end in ? need not be there,
# [declaration] of a list that is not empty, or a test of the value.
Content = dict[str, Any]
_DECIMAL = re.compile(r"-?\d{1,80}(\.\d{1,80})?(e[+-]?\d{1,3})?", re.ASCII)
#: Rounding that may make the lowest eigenvalue of a semidefinite Q negative, relative.
_ROUNDING = 1e-12


class Malformed(NoSolutionError):
    """A certificate holds an unknown entry."""


def _semidefinite(Q: np.ndarray) -> bool:
    return np.array_equal(Q, Q.T) and bool(np.linalg.eigvalsh(Q)[0] >= -_ROUNDING * np.abs(Q).max())


def _any(_: Any) -> bool:
    return True


POSITIVE = "", lambda x: x > 0.0
INTERVAL = "2", lambda ends: 0.0 < ends[0] <= ends[1]
LIMITS, DISTANCE = (
    ("2", lambda ends: ends[0] < ends[1]),
    ("2", lambda ends: 0.0 <= ends[0] <= ends[1]),
)
PLACES = "g", lambda places: len(places) > 1 and np.all(np.diff(places) > 0.0)
MODES, PIECE = {"H": "n n", "turn": "n n"}, {"bandwidth": "2", "H": "n n", "X": "b", "turn": "w w"}
MOVING = {"place_rate": POSITIVE, "lyapunov": {"places": ("l", PLACES[1]), "P": "l n n"}}
ACTUATORS = {
    "own": "n n",
    "G": "n a",
    "U": "g a n",
    "bandwidth": INTERVAL,
    "effectiveness": INTERVAL,
}
GAME = {
    "Q": ("n n", _semidefinite),
    "R": ("m m", lambda R: np.array_equal(R, R.T)),
    "E": "n *",
    "delta": lambda delta: delta == "inf" or _array("delta", delta, "", {}) > 0.0,
}
#: Kind -> its table, the lists of boxes that it always has, and those that come with `place_rate`
#: or `delta_min`.
KINDS: dict[str, tuple[Content, tuple[str, ...], tuple[str, ...]]] = {
    "schedule": (
        {"places": PLACES, "K": "g m n", "M": "g n n", "N": "g n x", "X": "g x n"},
        ("loop", "modes", "least", "most"),
        ("motion",),
    ),
    "game": (
        {"K": "m n", "W?": "* 1", "P?": "n n"},
        ("solution", "loop"),
        ("modes", "value", "refused"),
    ),
    "lpv": (
        {"places": PLACES, "A": "g n n", "B": "g n m", "inputs": "g m 1", "K": "g m n"},
        ("cells",),
        (),
    ),
}


def model_of(claim: Content, own: Model | None) -> Model:
    """The model that a statement is about: the HFA's, or the user's own, which must be the same
    one."""
    name, source = claim["dynamics"], claim["source"]
    _require(isinstance(name, str) and isinstance(source, str), "dynamics", name)
    if own is None:
        if not source and name == UNSTEADY.name:
            return UNSTEADY
        if source or name not in VARIANTS:
            raise BadInputError(
                f"the certificate is about {shown(name)}; name its file by --aircraft FILE.py:NAME"
            )
        return _aircraft(name)
    if (own.name, own.source[1]) != (name, source):
        raise BadInputError(
            f"the certificate is about {shown(name)} of another file than that of {own.name}"
        )
    return own


@cache
def _aircraft(dynamics: str) -> Model:
    return hfa_model.aircraft(dynamics)


def facts_of(model: Model) -> Content:
    """Which model it is, over which variable, and the units of all numbers."""
    return {
        "dynamics": model.name,
        "source": model.source[1],
        "over": model.schedule,
        "unit": model.schedule_unit,
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
        "input_scales": [model.signals[name].nominal for name in model.inputs],
    }


def check_structure(content: Content, model: Model | None) -> None:
    """Malformed names the first part that is missing, unknown, of another shape, out of order or no
    finite number.

    model: that of the statement, None where it is a plant.
    """
    kind, claim = str(content.get("kind")), content["statement"]
    _require(
        kind in KINDS and isinstance(claim, dict) and (kind == "game" or model is not None),
        "kind",
        kind,
    )
    (table, lists, more), lengths = KINDS[kind], dict[str, int]()
    moves = {"schedule": "place_rate", "game": "delta_min", "lpv": ""}[kind] in claim
    lists += more if moves else ()
    ends = "2", lambda ends: ends[0] == ends[1] if kind == "game" else ends[0] < ends[1]
    whole: Content = dict.fromkeys(
        ("schema", "kind", "toolchain", "boxes", "digest", "provenance", "checksum"), _any
    )
    if model is None:
        declared: Content = {"A": "n n", "B": "n m", "range": ("2", lambda ends: not ends.any())}
    else:
        lengths = {"x": len(model.linear), "m": len(model.inputs), "n": len(model.linear)}
        declared = _flight(claim, model, spread=kind == "schedule") | {"range": ends}
    if kind == "schedule":
        lengths.pop("n")
        whole["open"] = {
            name if name in ("loop", "modes") else f"{name}?": ". 2"
            for name in ("loop", "modes", *lists[4:])
        }
        declared |= (
            {"actuators": ACTUATORS | {"delay": ("", lambda s: s >= 0.0)}}
            if "actuators" in claim
            else {}
        )
        declared |= MOVING if moves else {}
    else:
        names = [key if kind == "lpv" else key + "?" for key in claim["table"] if key != "places"]
        declared |= {"game": GAME, "distances": dict.fromkeys(names, DISTANCE)}
        declared |= {"delta_min": ("2", lambda ends: 0.0 < ends[0] < ends[1])} if moves else {}
    _check("", content, whole | {"statement": declared | {"table": table}}, lengths)
    n, a = lengths["n"], lengths.get("a", 0)
    lengths |= {
        "x": lengths.get("x", n),
        "b": 2 * a,
        "w": n + 2 * a,
        "z": 4 + len(claim.get("spread", ())),
    }
    _require(n >= lengths["x"] and not (a and moves), "K", f"{n} columns")
    _require(kind == "schedule" or bool(claim["distances"]), "distances")
    _require("W" not in claim["table"] or len(claim["table"]["W"]) >= n * (n + 1) // 2, "W")
    _check(
        "boxes",
        content["boxes"],
        dict.fromkeys(lists, lambda boxes: isinstance(boxes, list)),
        lengths,
    )
    free = () if model is None else tuple({*model.variables} - {model.schedule, *claim["imposed"]})
    for name, boxes in content["boxes"].items():
        _require(len(boxes) == 1 if kind == "game" else len(boxes) >= (kind == "lpv"), name)
        for place, box in enumerate(boxes):
            axis = name == "refused" and isinstance(box, dict) and "axis" in box
            _check(
                f"{name} {place}",
                box,
                {"range": ends} | _box(kind, name, claim, free, axis, lengths),
                lengths,
            )


def _flight(claim: Content, model: Model, *, spread: bool) -> Content:
    """What is stated of the trims; what is not imposed is unknown, and there is some."""
    over, imposed = model.schedule, claim["imposed"]
    _require(
        isinstance(imposed, dict) and not {*model.variables} <= {over, *imposed}, "imposed", imposed
    )
    known = {name: ends for name, ends in model.limits.items() if name not in (over, *imposed)}
    unlimited = {
        name
        for name, ends in known.items()
        if name in model.disturbances or not np.isfinite(ends).any()
    }
    return {
        key: lambda value, fact=fact: value == fact for key, fact in facts_of(model).items()
    } | {
        "parameters": dict.fromkeys(model.parameters, ""),
        "spread": {f"{name}?": POSITIVE for name in model.parameters if spread and name != over},
        "imposed": {f"{name}?": "" for name in model.holdable if name != over},
        "limits": {name + "?" * (name in unlimited): LIMITS for name in known},
    }


def _box(
    kind: str, name: str, claim: Content, free: tuple[str, ...], axis: bool, lengths: dict[str, int]
) -> Content:
    """One box: its unstable modes, its trims, the entries of A and B, and the proof."""
    of_A, pieces = name in ("modes", "least", "most"), name == "loop" and "actuators" in claim
    most = lengths["x" if of_A else "n"] if (of_A or name == "loop") and not pieces else 0
    moved = kind == "schedule" and name != "motion" and not pieces
    declared: Content = {
        "unstable": lambda count: type(count) is int and 0 <= count <= most,
        "rate": ("", lambda rate: rate == 0.0 or moved),
    }
    if free:
        # Statements hold for every decimal that reads as these doubles; a critic, and delta_min,
        # for the doubles alone.
        wide = kind != "game" or ("delta_min" in claim and name in ("solution", "loop"))
        declared["decimals"] = lambda decimals: decimals is True or (decimals is False and not wide)
        trim = "z decimal" if kind == "game" else "z", lambda parts: parts[3] > 0.0
        declared["trim"] = dict.fromkeys(free, trim)
    declared |= {} if kind == "game" else {"A": "x x 2", "B": "x m 2"}
    if name in ("solution", "value", "refused", "cells"):
        root = {"units": ("n", lambda units: np.all(units > 0.0)), "reach": POSITIVE}
        P = {"P": "1 n n decimal" if kind == "game" else "3 n n decimal"}
        return declared | ({"axis": "*"} if axis else MODES | root | P)
    if name == "motion":
        return declared | {"turn": "n n"}
    return declared | (
        {"pieces": [PIECE]} if pieces else {"H": "x x", "turn": "x x"} if of_A else MODES
    )


def _check(where: str, value: Any, declared: Any, lengths: dict[str, int]) -> None:
    if isinstance(declared, (str, tuple)):
        shape, holds = declared if isinstance(declared, tuple) else (declared, _any)
        _require(bool(holds(_array(where, value, shape, lengths))), where, value)
    elif isinstance(declared, dict):
        _require(isinstance(value, dict), where, value)
        kinds = {name.removesuffix("?"): each for name, each in declared.items()}
        odd = {*value} - {*kinds} | {name for name in declared if name[-1] != "?"} - {*value}
        _require(not odd, f"{where or 'it'}: missing or unknown entry", sorted(odd)[:1])
        for name in kinds:
            if name in value:
                _check(f"{where}: {name}" if where else name, value[name], kinds[name], lengths)
    elif isinstance(declared, list):
        _require(isinstance(value, list) and bool(value), where, value)
        for each in value:
            _check(where, each, declared[0], lengths)
    else:
        _require(bool(declared(value)), where, value)


def _array(where: str, value: Any, shape: str, lengths: dict[str, int]) -> np.ndarray:
    """The numbers of a nested list of this shape."""
    sides = shape.removesuffix(" decimal").split()

    def walk(part: Any, left: list[str]) -> Any:
        if left:
            size = len(part) if isinstance(part, list) else -1
            wanted = (
                size
                if left[0] in "*."
                else int(left[0])
                if left[0].isdigit()
                else lengths.setdefault(left[0], size)
            )
            _require(size == wanted and size >= (left[0] != "."), where, part)
            return [walk(each, left[1:]) for each in part]
        if shape[-7:] == "decimal" and isinstance(part, str) and _DECIMAL.fullmatch(part):
            part = float(part)
        _require(
            type(part) in (int, float) and abs(part) <= 1e300 and math.isfinite(part), where, part
        )
        _require(type(part) is float or abs(part) <= 2**53, where, part)
        return float(part)

    try:
        return np.array(walk(value, sides))
    except ValueError as error:  # rows of any length that differ
        raise Malformed(f"{where} has rows that differ in length") from error


def _require(holds: bool, where: str, value: Any = None) -> None:
    if not holds:
        said = "" if value is None else f" ({shown(value)})"
        raise Malformed(f"{where} is not what a certificate holds{said}")
