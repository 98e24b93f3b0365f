"""What a proof states, and what the checker verified of it, in words, tables and data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from hfa_model.parameters import NAMED, Parameters, load_parameters
from hfa_model.provenance import parameter_hash
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.model import Model
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table, matrix_table, numbered
from verification.checker.checker import Verified
from verification.proof.certificate import Content, Proof, Run

SCHEMA = "hfa.proof/1"
_INTERVALS = ("bandwidth", "effectiveness", "delay")
#: The least size of an entry of A or B that the text shows.
_SHOWN = 1e-3
Found = TypeVar("Found")


def joined(runs: list[tuple[float, float, Found]]) -> list[tuple[float, float, Found]]:
    """Low, high and what was found, such as a number: neighbours of which the same was found are one."""
    together: list[tuple[float, float, Found]] = []
    for low, high, found in runs:
        if together and together[-1][1:] == (low, found):
            together[-1] = (together[-1][0], high, found)
        else:
            together.append((low, high, found))
    return together


def gaps(runs: list[Run], low: float, high: float) -> list[tuple[float, float]]:
    """What the runs leave of the interval from low to high."""
    ends = [low, *(end for run in sorted(runs) for end in run[:2]), high]
    return [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if a < b]


def crossings(found: Proof | Verified) -> list[tuple[float, float, tuple[int, int]]]:
    """Where the modes of A are not counted: low, high, the least and the most that are proved to be unstable."""
    covers, (low, high) = found.covers, found.statement["range"]
    cuts = sorted({end for name in ("least", "most") for run in covers[name] for end in run[:2]})
    crossed, states = [], len(found.statement["state_units"])
    for first, last in gaps(covers["modes"], low, high):
        for a, b in pairwise([first, *(cut for cut in cuts if first < cut < last), last]):
            least, most = ([n for c, d, n in covers[name] if c <= a and b <= d] for name in ("least", "most"))
            crossed.append((a, b, (max(least, default=0), min(most, default=states))))
    return joined(crossed)


def place_data(model: Model | None, places: Any) -> Content:
    """Places as data: of the HFA dihedral_deg; of other models by the name of the scheduling variable."""
    return (
        {"dihedral_deg": places}
        if model is None or model.schedule == "dihedral"
        else {"scheduled": {model.schedule: places}}
    )


def schedule_data(proof: Proof, moving: bool) -> Content:
    """What JSON has of a proved schedule. moving: a rate was asked for."""
    claim, covers, model = proof.statement, proof.covers, proof.model
    (low, high), end = claim["range"], "_deg" * (claim["unit"] == "deg")

    def ends(run: tuple[Any, ...]) -> Content:
        return {f"from{end}": run[0], f"to{end}": run[1]}

    still, counts = gaps(covers["loop"], low, high), {name: joined(covers[name]) for name in ("loop", "modes")}
    refuted = [ends(run) | {"unstable": run[2]} for run in counts["loop"] if run[2] > 0]
    open_ = {
        "loop": [ends(gap) for gap in still],
        "modes": [ends(run) | {"at_least": run[2][0], "at_most": run[2][1]} for run in crossings(proof)],
    }
    data = {
        "schema": SCHEMA,
        "statement": "schedule",
        "proved": not still and not refuted and not (moving and "place_rate" not in claim),
        "dynamics": claim["dynamics"],
        **place_data(model, [low, high]),
        "decay_rate": min((box["rate"] for box in proof.boxes["loop"] if not box["unstable"]), default=0.0),
    }
    for name, own in counts.items():
        data[name] = {"proved": [ends(run) | {"unstable": run[2]} for run in own], "boxes": len(covers[name])}
        data[name] |= {"open": open_[name]}
    data |= {"refuted": refuted}
    data["boxes"] = [place_data(model, box["range"]) | {key: box[key] for key in "AB"} for box in proof.boxes["loop"]]
    if "actuators" in claim:
        data["actuators"] = {key: claim["actuators"][key] for key in _INTERVALS}
    if moving:
        lyapunov = claim.get("lyapunov", {"places": [low, high], "P": []})
        data |= {_rate_key(claim): claim.get("place_rate", 0.0)}
        data |= {"lyapunov": {**place_data(model, lyapunov["places"]), "P": lyapunov["P"]}}
    return data | {"not_covered": _not_covered(claim)}


def schedule_report(proof: Proof) -> Report:
    """The verdict, how many modes are unstable where, open intervals, and the enclosures of the model's entries."""
    claim, data, model = proof.statement, proof.data, proof.model
    assert model is not None
    (low, high), over, unit = claim["range"], claim["over"], claim["unit"]
    every, still = "angle" if unit == "deg" else over, gaps(proof.covers["loop"], low, high)
    refuted = [run for run in joined(proof.covers["loop"]) if run[2] > 0]
    stable = not (still or refuted)
    verdict = "Proved" if stable else "Refuted" if refuted else "Left open"
    lines = [
        f"the loop has {n} unstable modes at every {every} from {a:.10g} to {b:.10g} {unit}" for a, b, n in refuted
    ]
    lines += [f"open: the loop from {a:.10g} to {b:.10g} {unit}" for a, b in still]
    uncertain = "actuators" in claim
    if stable:
        what = "the loop through the actuators is stable" if uncertain else "A - B K is Hurwitz"
        lines.append(f"the trim exists within its limits and {what} at every {every}")
    lines += [] if uncertain else [f"decay rate where the loop is Hurwitz: {data['decay_rate']:.6g} 1/s"]
    lines.append(f"boxes: {data['loop']['boxes']} for the loop, {data['modes']['boxes']} for the aircraft's modes")
    parts: list[Part] = ["\n".join(lines)]
    parts += [("" if stable else "asked ") + _actuators(claim)] if uncertain else []
    if "lyapunov" in data:
        parts.append(_motion(claim) if "place_rate" in claim else f"open: no rate of the {over} is proved")
    entries = []
    for name, columns in (("A", model.linear), ("B", tuple(model.inputs))):
        ends = np.array([box[name] for box in proof.boxes["loop"]] or np.zeros((1, len(model.linear), len(columns), 2)))
        lowest, highest = ends[..., 0].min(axis=0), ends[..., 1].max(axis=0)
        for i, j in np.argwhere(np.maximum(abs(lowest), abs(highest)) > _SHOWN):
            place = f"{name}({model.linear[i]}, {columns[j]})"
            entries.append((place, f"{lowest[i, j]:.5g}", f"{highest[i, j]:.5g}"))
    parts += [_not_covered(claim), *_mode_tables(proof), Table(("entry", "at least", "at most"), entries)]
    title = f"{verdict}: every {over} from {low:g} to {high:g} {unit}, {model.title}"
    return Report(title, parts, data=data)


def _rate_key(claim: Content) -> str:
    return "dihedral_rate_deg_s" if claim["over"] == "dihedral" else "scheduled_rate"


def _actuators(claim: Content) -> str:
    """For which actuators a loop is proved."""
    (slow, fast), (least, most), delay = (claim["actuators"][key] for key in _INTERVALS)
    return (
        f"for every actuator bandwidth from {slow:g} to {fast:g} rad/s, the same of all inputs; for effectiveness from "
        f"{least:g} to {most:g}\nand delay up to {delay:g} s of each input for itself, changing at any time, as when "
        "commands are sampled and held"
    )


def _not_covered(claim: Content) -> str:
    """What a proof of a loop does not cover."""
    others = "other actuators than these" if "actuators" in claim else "other actuators than the loop's own, delay"
    return (
        f"not covered: {others}, sampling of a controller's own states, a {claim['over']} that the loop\n"
        "itself moves and that is not imposed from outside, limits of the inputs, the nonlinear aircraft"
    )


def _motion(claim: Content) -> str:
    most = f"{claim['place_rate']:.4g} {claim['unit']}/s"
    return f"stable while the {claim['over']} moves by at most {most}, however it does"


def _mode_tables(found: Proof | Verified) -> list[Table]:
    """How many modes of the loop and of A are unstable where, and the open intervals."""
    covers, (low, high) = found.covers, found.statement["range"]
    rows: dict[str, list[tuple[float, float, Any]]] = {
        "loop A - B K": [*joined(covers["loop"]), *((*gap, "open") for gap in gaps(covers["loop"], low, high))],
        "aircraft A": [*joined(covers["modes"]), *((a, b, f"{n} to {m}") for a, b, (n, m) in crossings(found))],
    }
    return [
        Table(
            (f"{name}: {found.statement['over']}, {found.statement['unit']}", "unstable modes"),
            [(f"{a:.10g} to {b:.10g}", str(count)) for a, b, count in sorted(own, key=lambda run: run[0])],
        )
        for name, own in rows.items()
    ]


def game_report(proof: Proof, states: tuple[str, ...] = (), origin: str = "a plant", file: str = "it") -> Report:
    """Of a solution the statements one by one and the P that the radius is about, of a critic the distances.

    states: of P. origin: whose game it is. file: of the critic.
    """
    data, proved = proof.data, "Proved" if proof.proved else "Left open"
    if data["statement"] == "critic":
        found = [(key, f"{each['at_least']:.6e}", f"{each['at_most']:.6e}") for key, each in data["distances"].items()]
        hurwitz = {True: "proved Hurwitz", False: "proved not Hurwitz", None: "open: a mode may lie on the axis"}
        parts: list[Part] = [Table(("|X - X*| / |X*|", "at least", "at most"), found)]
        parts.append(f"A - B K with this gain: {hurwitz[data['closed_loop_hurwitz']]}")
        return Report(
            f"{proved}: the distance of {file} from the exact solution of the game of {origin}", parts, data=data
        )
    above, most, count = (data[key] for key in ("delta_min_above", "delta_min_at_most", "unstable_modes"))
    rows = [
        ("the stabilizing solution exists and is unique", "worst_case_hurwitz"),
        ("P is positive definite", "positive_definite"),
        ("A - S P is Hurwitz", "worst_case_hurwitz"),
        ("A - B K is Hurwitz", "closed_loop_hurwitz"),
    ]
    rows = [(name, "proved" if data[key] else "open") for name, key in rows] + [
        ("relative radius about the printed P", f"{data['relative_radius']:.3g}"),
        ("delta_min", "open" if above is None else f"above {above:.10g}, at most {most:.10g}"),
        ("relative width of the bracket", "" if above is None else f"{(most - above) / most:.2g}"),
        ("unstable modes of A", "open: one may lie on the axis" if count is None else str(count)),
    ]
    states = states or numbered("z", len(data["P"]))
    parts = [Table(("statement", "result"), rows), matrix_table("P", states, states, data["P"])]
    return Report(f"{proved}: the solution of the game of {origin}", parts, data=data)


def checked_report(found: Verified) -> Report:
    """The statement that was verified, in words and in data: proved on the whole interval or not, of which aircraft in
    which flight whatever the options of the command, and with which gains, limits and weights."""
    claim, model = found.statement, found.model
    low, high = claim["range"]
    what, parts, own = {"schedule": _schedule, "game": _game, "lpv": _lpv}[found.kind](found)
    data: Content = {"schema": SCHEMA, "statement": "check", "kind": found.kind, **place_data(model, [low, high])}
    boxes, proved = sum(len(runs) for runs in found.covers.values()), own.get("proved", True)
    data |= {"boxes": boxes, "proved": proved, "written": found.written} | own
    if model is None:
        what += "the plant of a file"
    else:
        what += f"{claim['over']} {low:g} {claim['unit']}" if low == high else _interval(claim)
        about, of_aircraft = _aircraft(claim, model)
        parts, data = [about, *parts], data | of_aircraft
    data["table_sha256"] = digest = _digest(claim["table"])
    lines = [f"table of {', '.join(key for key in claim['table'] if key not in 'MNX')}: SHA-256 {digest[:16]}"]
    for key, name in (("limits", "limits of the trims"), ("spread", "half widths of the parameters")):
        if model is not None and claim.get(key):
            data[key] = claim[key]
            ends = (
                f"{each} " + " to ".join(model.describe(each, x) for x in np.atleast_1d(own))
                for each, own in claim[key].items()
            )
            lines.append(f"{name}: {', '.join(ends)}")
    if "game" in claim:
        data |= {"game": claim["game"]}
        lines += [f"{key} = {_matrix_said(value)}" for key, value in claim["game"].items()]
    parts += ["\n".join(lines), "written by hfa {version} on {date}: {command}".format(**found.written)]
    verdict = "Verified, proved" if proved else "Verified, but not proved on the whole interval"
    return Report(f"{verdict}: {what}, {boxes} boxes", parts, data=data)


def _interval(claim: Content) -> str:
    low, high = claim["range"]
    return f"{claim['over']} from {low:g} to {high:g} {claim['unit']}"


def _aircraft(claim: Content, model: Model) -> tuple[str, Content]:
    flight = ", ".join(f"{held} {model.describe(held, value)}" for held, value in claim["imposed"].items())
    data = {key: claim[key] for key in ("dynamics", "parameters")}
    if claim["source"] or set(claim["parameters"]) != set(Parameters._fields):
        numbers = "".join(f", {name} {value:.10g}" for name, value in claim["parameters"].items())
        source = f", file of SHA-256 {claim['source'][:16]}" if claim["source"] else ""
        return f"{model.title}{source}{numbers}\ntrims at {flight}", data | {"source": claim["source"]}
    values = Parameters(**claim["parameters"])
    known = [name for name in NAMED if load_parameters(name).values == values]
    data |= {"parameters": known[0] if known else "of the certificate", "parameter_hash": parameter_hash(values)}
    about = f"{claim['dynamics']} dynamics, parameters {data['parameters']} ({data['parameter_hash']})"
    return f"{about}\ntrims at {flight}", data


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()


def _matrix_said(value: Any) -> str:
    """A number; I; the diagonal; else the SHA-256 of the matrix, whose entries are data."""
    if not isinstance(value, list):
        return str(value)
    matrix = np.array(value)
    diagonal = np.diag(matrix)
    if matrix.shape[0] == matrix.shape[1] and np.array_equal(matrix, np.diag(diagonal)):
        return "I" if np.all(diagonal == 1.0) else f"diag({', '.join(f'{each:.10g}' for each in diagonal)})"
    return f"matrix {matrix.shape[0]} x {matrix.shape[1]}, SHA-256 {_digest(value)[:16]}"


def require_same(claim: Content, own: Mapping[str, Any], what: str) -> None:
    """NoSolutionError unless the user's own data, by name, is exactly that of the certificate's part."""
    for name, value in own.items():
        if name not in claim:
            raise BadInputError(f"{what} gives {name}, which this certificate does not state; leave it out")
        stated = np.inf if claim[name] == "inf" else claim[name]
        if not np.array_equal(np.asarray(stated, dtype=float), np.asarray(value, dtype=float)):
            raise NoSolutionError(f"the certificate is about another {name} than {what} gives")


def _schedule(found: Verified) -> tuple[str, list[Part], Content]:
    claim, covers = found.statement, found.covers
    (low, high), over, unit = claim["range"], claim["over"], claim["unit"]
    own: Content = {"decay_rate": found.rate, "crossings": crossings(found), "one_branch": not found.parted}
    lines = [f"decay rate where the loop is Hurwitz: {found.rate:.6g} 1/s"]
    if "actuators" in claim:
        own["actuators"], lines = {key: claim["actuators"][key] for key in _INTERVALS}, [_actuators(claim)]
    still = gaps(covers["motion"], low, high) if "motion" in covers else []
    if "motion" in covers and not still:
        own[_rate_key(claim)] = claim["place_rate"]
        lines.append(_motion(claim))
    lines += [f"open: a moving {over} from {a:.10g} to {b:.10g} {unit}" for a, b in still]
    if claim["spread"]:
        lines.append(
            f"for every value of {len(claim['spread'])} parameters within the half widths that the certificate states"
        )
    parted = ", ".join(f"{at:.10g}" for at in found.parted[:3])
    branches = f"open: whether the trims before and after {parted} {unit} are one branch"
    lines += [branches if parted else "the trims of all boxes are one branch", _not_covered(claim)]
    own |= {name: joined(covers[name]) for name in ("loop", "modes")} | {"open": gaps(covers["loop"], low, high)}
    own |= {"proved": own["loop"] == [(low, high, 0)] and not still and not found.parted}
    return "", ["\n".join(lines), *_mode_tables(found)], own


def _game(found: Verified) -> tuple[str, list[Part], Content]:
    claim = found.statement
    rows = [(name, f"{low:.6g}", f"{high:.6g}") for name, (low, high) in claim["distances"].items()]
    ((*_, count),) = found.covers["loop"]
    lines = [f"A - B K with this gain is {'Hurwitz' if count == 0 else f'not Hurwitz: {count} unstable modes'}"]
    own: Content = {"distances": claim["distances"], "closed_loop_hurwitz": count == 0}
    if "delta_min" in claim:
        own["delta_min_above"], own["delta_min_at_most"] = above, most = claim["delta_min"]
        lines.append(f"delta_min is above {above:.10g}, at most {most:.10g}")
    table = Table(("|X - X*| / |X*|, X* of the exact game", "at least", "at most"), rows)
    return "the exact game, ", [table, "\n".join(lines)], own


def _lpv(found: Verified) -> tuple[str, list[Part], Content]:
    error = {name: most for name, (_, most) in found.statement["distances"].items()}
    table = Table(("error between the nodes, at most", "bound"), [(k, f"{v:.3g}") for k, v in error.items()])
    nodes = len(found.statement["table"]["places"])
    return f"linear interpolation of {nodes} models, ", [table], {"error": error, "nodes": nodes}
