"""What a certificate may hold: every key, shape, order, unit and number of it, required before any arithmetic.

Whatever is not understood is refused, so that the checker computes with what it was written for and nothing else.
"""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.unsteady import UNSTEADY
from hfa_model.variants import VARIANTS
from hfa_support.errors import BadInputError, NoSolutionError, shown
from hfa_support.model import Model

Content = dict[str, Any]
_DECIMAL = re.compile(r"-?\d{1,80}(\.\d{1,80})?(e[+-]?\d{1,3})?", re.ASCII)
_FLIGHT = ("parameters", "spread", "imposed", "limits", "range")
_BOX, _MODES, _ROOT = ("range", "unstable", "rate"), ("H", "turn"), ("units", "P", "reach", "H", "turn")
#: Rounding that may make the lowest eigenvalue of a semidefinite Q negative, relative.
_ROUNDING = 1e-12
#: Kind -> the lists of boxes that it always has, and those that it may have.
LISTS = {
    "schedule": (("loop", "modes", "least", "most"), ("motion",)),
    "game": (("solution", "loop"), ("modes", "value", "refused")),
    "lpv": (("cells",), ()),
}


class Malformed(NoSolutionError):
    """A certificate holds an unknown entry."""


def model_of(claim: Content, own: Model | None) -> Model:
    """The model that a statement is about: the HFA's, or the user's own, which must be the same one."""
    name, source = claim["dynamics"], claim["source"]
    _require(isinstance(name, str) and isinstance(source, str), "dynamics", name)
    if own is None:
        if not source and name == UNSTEADY.name:
            return UNSTEADY
        if source or name not in VARIANTS:
            raise BadInputError(f"the certificate is about {shown(name)}; name its file by --aircraft FILE.py:NAME")
        return Aircraft(dynamics=name).model
    if (own.name, own.source[1]) != (name, source):
        raise BadInputError(f"the certificate is about {shown(name)} of another file than that of {own.name}")
    return own


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
    """Malformed names the first part that is missing, unknown, of another shape, out of order or no finite number.

    model: that of the statement, None where it is a plant.
    """
    kind = str(content.get("kind"))
    _require(content.get("kind") in tuple(LISTS), "kind", kind)
    closing = ("schema", "kind", "toolchain", "statement", "boxes", "digest", "provenance", "checksum")
    _keys("the certificate", content, closing + ("open",) * (kind == "schedule"))
    claim, boxes = content["statement"], content["boxes"]
    also = {"schedule": "place_rate", "game": "delta_min", "lpv": ""}[kind]
    more = isinstance(claim, dict) and also in claim
    extra = {"schedule": ("place_rate", "lyapunov"), "game": ("delta_min",), "lpv": ()}[kind] if more else ()
    own = ("table",) if kind == "schedule" else ("table", "game", "distances")
    uncertain = ("actuators",) if kind == "schedule" and isinstance(claim, dict) and "actuators" in claim else ()
    flight = ("A", "B", "range") if model is None else (*facts_of(model), *_FLIGHT)
    _keys("the statement", claim, flight + own + extra + uncertain)
    low, high = _numbers("range", claim["range"], (2,)).tolist()
    _require(low == high if kind == "game" else low < high, "range", [low, high])
    free = set[str]()
    if model is None:
        _require(kind == "game", "kind", kind)
        n = len(claim["A"]) if isinstance(claim["A"], list) else 0
        m = _numbers("B", claim["B"], (n, None)).shape[1]
        _numbers("A", claim["A"], (n, n))
        _require(low == 0.0, "range", low)
    else:
        n, m, free = len(model.linear), len(model.inputs), _flight(claim, model, spread=kind == "schedule")
    if kind == "schedule":
        size = _schedule(claim, n, m)
        intervals = _keys("open", content["open"], LISTS[kind][0][:2], LISTS[kind][1] if more else ())
        for name, gaps in intervals.items():
            _numbers(f"open {name}", gaps, (None, 2), empty=True)
    else:
        size = n
        _game(kind, claim, n, m)
    _keys("boxes", boxes, LISTS[kind][0] + LISTS[kind][1] * more)
    for name, each in boxes.items():
        count = len(each) if isinstance(each, list) else -1
        _require(count == 1 if kind == "game" else count >= (kind == "lpv"), name)
        for place, box in enumerate(each):
            of_A = name in ("modes", "least", "most")
            _box(f"{name} {place}", kind, name, box, claim, free, (n, m, n if of_A else size))


def _flight(claim: Content, model: Model, *, spread: bool) -> set[str]:
    """The unknowns of the trims of a flight; everything else of them is imposed, once."""
    over = model.schedule
    for key, value in facts_of(model).items():
        _require(claim[key] == value, key, claim[key])
    _table("parameters", claim["parameters"], set(model.parameters))
    widths = claim["spread"]
    known = isinstance(widths, dict) and widths.keys() <= {*model.parameters} - {over} and (spread or not widths)
    _require(known and min(_table("spread", widths, set(widths)), default=1.0) > 0.0, "spread", widths)
    imposed = claim["imposed"]
    _require(isinstance(imposed, dict) and imposed.keys() <= {*model.holdable} - {over}, "imposed", imposed)
    _table("imposed", imposed, set(imposed))
    free = {*model.variables} - {over} - set(imposed)
    bounded = {
        name
        for name in (*model.states, *model.inputs, *model.variables, *model.outputs)
        if np.isfinite(model.limits.get(name, math.inf)).any()
    } - {over, *imposed}
    _require(bool(free), "imposed", imposed)
    limits = claim["limits"]
    known = isinstance(limits, dict) and bounded <= limits.keys() <= {*model.limits} - {over, *imposed}
    _require(known, "limits", limits)
    for name, ends in limits.items():
        _require(bool(np.all(np.diff(_numbers(f"limits of {name}", ends, (2,))) > 0.0)), f"limits of {name}", ends)
    return free


def _schedule(claim: Content, nx: int, m: int) -> int:
    """The table of gains over increasing places, what drives them, and of a rate the table of P; returns the size of
    the loop."""
    table = _keys("table", claim["table"], ("places", *"KMNX"))
    count = _places("table", table["places"])
    n = _numbers("K", table["K"], (count, m, None)).shape[2]
    _require(n >= nx, "K", f"{n} columns")
    for key, shape in {"M": (n, n), "N": (n, nx), "X": (nx, n)}.items():
        _numbers(key, table[key], (count, *shape))
    if "actuators" in claim:
        own = _keys("actuators", claim["actuators"], ("own", "G", "U", "bandwidth", "effectiveness", "delay"))
        a = _numbers("G", own["G"], (n, None)).shape[1]
        for key, each in {"own": (n, n), "U": (count, a, n), "bandwidth": (2,), "effectiveness": (2,)}.items():
            found = _numbers(key, own[key], each)
            _require(found.ndim > 1 or 0.0 < found[0] <= found[1], key, own[key])
        _require(float(_numbers("delay", own["delay"], ())) >= 0.0, "delay", own["delay"])
        _require("place_rate" not in claim, "place_rate")
    if "place_rate" in claim:
        rate = float(_numbers("place_rate", claim["place_rate"], ()))
        lyapunov = _keys("lyapunov", claim["lyapunov"], ("places", "P"))
        _numbers("P", lyapunov["P"], (_places("lyapunov", lyapunov["places"]), n, n))
        _require(rate > 0.0, "place_rate", rate)
    return n


def _game(kind: str, claim: Content, n: int, m: int) -> None:
    """The game, the critic compared with its solution, and the claimed distances."""
    game = _keys("game", claim["game"], ("Q", "R", "E", "delta"))
    Q, R = _numbers("Q", game["Q"], (n, n)), _numbers("R", game["R"], (m, m))
    _numbers("E", game["E"], (n, None))
    _require(bool(np.all(Q == Q.T)) and np.linalg.eigvalsh(Q)[0] >= -_ROUNDING * np.abs(Q).max(), "Q")
    _require(bool(np.all(R == R.T)), "R")
    _require(game["delta"] == "inf" or float(_numbers("delta", game["delta"], ())) > 0.0, "delta", game["delta"])
    if "delta_min" in claim:
        bracket = _numbers("delta_min", claim["delta_min"], (2,))
        _require(0.0 < bracket[0] < bracket[1], "delta_min", claim["delta_min"])
    shapes: dict[str, tuple[int | None, ...]] = {"W": (None, 1), "P": (n, n), "K": (m, n)}
    if kind == "lpv":
        shapes = {"A": (n, n), "B": (n, m), "inputs": (m, 1), "K": (m, n)}
        table = _keys("table", claim["table"], ("places", *shapes))
        count = _places("table", table["places"])
        shapes = {key: (count, *shape) for key, shape in shapes.items()}
        compared = _keys("distances", claim["distances"], tuple(shapes))
    else:
        table = _keys("table", claim["table"], ("K",), ("W", "P"))
        compared = _keys("distances", claim["distances"], (), tuple(shapes.keys() & table.keys()))
    for key in shapes.keys() & table.keys():
        values = _numbers(key, table[key], shapes[key])
        _require(key != "W" or len(values) >= n * (n + 1) // 2, "W", f"{len(values)} weights")
    for key, ends in compared.items():
        least, most = _numbers(f"distances of {key}", ends, (2,)).tolist()
        _require(0.0 <= least <= most, f"distances of {key}", ends)
    _require(bool(compared), "distances", compared)


def _box(
    where: str, kind: str, name: str, box: Any, claim: Content, free: set[str], shape: tuple[int, int, int]
) -> None:
    """One box: its places, its unstable modes, its trims, the entries of A and B, and the proof."""
    (nx, m, n), pieces = shape, name == "loop" and "actuators" in claim
    keys = _BOX + (("decimals", "trim") if free else ()) + (("A", "B") if kind != "game" else ())
    if name == "refused" and isinstance(box, dict) and "axis" in box:
        keys += ("axis",)
        _numbers(f"{where}: axis", box["axis"], (None,))
    elif name in ("solution", "value", "refused", "cells"):
        keys += _ROOT
    else:
        keys += ("turn",) if name == "motion" else ("pieces",) if pieces else _MODES
    _keys(where, box, keys)
    low, high = _numbers(f"{where}: range", box["range"], (2,)).tolist()
    _require(low <= high if kind == "game" else low < high, f"{where}: range", [low, high])
    counted = type(box["unstable"]) is int and 0 <= box["unstable"] <= n
    _require(counted and (name in ("loop", "modes", "least", "most") or box["unstable"] == 0), f"{where}: unstable")
    rate = float(_numbers(f"{where}: rate", box["rate"], ()))
    _require(rate == 0.0 or (kind == "schedule" and name != "motion" and not pieces), f"{where}: rate", rate)
    if pieces:
        a = len(claim["actuators"]["G"][0])
        _require(box["unstable"] == 0 and isinstance(box["pieces"], list) and bool(box["pieces"]), f"{where}: pieces")
        for each in box["pieces"]:
            shapes = {"bandwidth": (2,), "H": (n, n), "X": (2 * a,), "turn": (n + 2 * a,) * 2}
            _keys(f"{where}: pieces", each, tuple(shapes))
            for key, sides in shapes.items():
                _numbers(f"{where}: {key}", each[key], sides)
    if free:
        # Statements hold for every decimal that reads as these doubles; a critic, and delta_min, for the doubles alone.
        wide = kind != "game" or ("delta_min" in claim and name in ("solution", "loop"))
        _require(box["decimals"] is True or (box["decimals"] is False and not wide), f"{where}: decimals")
        for unknown, parts in _keys(f"{where}: trim", box["trim"], tuple(free)).items():
            found = _numbers(f"{where}: {unknown}", parts, (4 + len(claim["spread"]),), decimals=kind == "game")
            _require(found[3] > 0.0, f"{where}: radius of {unknown}", parts[3])
    for key, columns in (("A", nx), ("B", m)) if kind != "game" else ():
        _numbers(f"{where}: {key}", box[key], (nx, columns, 2))
    for key in ("H", "turn"):
        if key in keys:
            _numbers(f"{where}: {key}", box[key], (n, n))
    if "reach" in keys:
        parts = _numbers(f"{where}: P", box["P"], (None, n, n), decimals=True)
        _require(len(parts) == 1 if kind == "game" else len(parts) == 3, f"{where}: P", f"{len(parts)} parts")
        sizes = [*_numbers(f"{where}: units", box["units"], (n,)), float(_numbers(f"{where}: reach", box["reach"], ()))]
        _require(min(sizes) > 0.0, f"{where}: units or reach")


def _places(where: str, places: Any) -> int:
    """The number of places, two at least, that increase."""
    found = _numbers(f"{where}: places", places, (None,)).tolist()
    _require(len(found) >= 2 and all(a < b for a, b in pairwise(found)), f"{where}: places", found)
    return len(found)


def _keys(where: str, table: Any, names: tuple[str, ...], optional: tuple[str, ...] = ()) -> Content:
    """A table with these entries and no others."""
    _require(isinstance(table, dict), where, table)
    odd = sorted(({*names} - table.keys()) | (table.keys() - {*names, *optional}))
    _require(not odd, f"{where}: missing or unknown entry", odd[:1])
    return dict(table)


def _table(where: str, table: Any, names: set[str]) -> list[float]:
    """The numbers of a table of names."""
    return [float(_numbers(f"{where}: {name}", x, ())) for name, x in _keys(where, table, tuple(names)).items()]


def _numbers(
    where: str, value: Any, shape: tuple[int | None, ...], *, decimals: bool = False, empty: bool = False
) -> np.ndarray:
    """A nested list of finite numbers with this shape, None: any length but 0; of decimals in quotes where allowed."""

    def walk(part: Any, left: tuple[int | None, ...]) -> Any:
        if left:
            fits = isinstance(part, list) and (len(part) == left[0] if left[0] is not None else len(part) or empty)
            _require(bool(fits), where, part)
            return [walk(each, left[1:]) for each in part]
        if decimals and isinstance(part, str) and _DECIMAL.fullmatch(part):
            part = float(part)
        _require(type(part) in (int, float) and abs(part) <= 1e300 and math.isfinite(part), where, part)
        _require(type(part) is float or abs(part) <= 2**53, where, part)
        return float(part)

    try:
        return np.array(walk(value, shape))
    except ValueError as error:  # a dimension without a fixed length whose rows differ
        raise Malformed(f"{where} has rows that differ in length") from error


def _require(holds: bool, where: str, value: Any = None) -> None:
    if not holds:
        said = "" if value is None else f" ({shown(value)})"
        raise Malformed(f"{where} is not what a certificate holds{said}")
