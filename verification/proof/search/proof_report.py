"""What a proof states, and what the checker verified of it, in words, tables and data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from hfa_aircraft.model import Model
from hfa_model.parameters import NAMED, Parameters, load_parameters
from hfa_model.provenance import parameter_hash
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table, matrix_table, numbered
from verification.proof.checker.checker import Run, Statement, Verified
from verification.proof.checker.structure import Content

SCHEMA = "hfa.proof/1"
Found = TypeVar("Found")


def joined(runs: list[tuple[float, float, Found]]) -> list[tuple[float, float, Found]]:
    """Low, high and what was found, such as a number: neighbours of which the same was found are
    one."""
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


def crossings(found: Statement) -> list[tuple[float, float, tuple[int, int]]]:
    """Where the modes of A are not counted: low, high, the least and the most that are proved to be
    unstable."""
    covers, (low, high) = found.covers, found.statement["range"]
    cuts = sorted({end for name in ("least", "most") for run in covers[name] for end in run[:2]})
    crossed, states = [], len(found.statement["state_units"])
    for first, last in gaps(covers["modes"], low, high):
        for a, b in pairwise([first, *(cut for cut in cuts if first < cut < last), last]):
            least, most = (
                [n for c, d, n in covers[name] if c <= a and b <= d] for name in ("least", "most")
            )
            crossed.append((a, b, (max(least, default=0), min(most, default=states))))
    return joined(crossed)


def place_data(model: Model, places: Any) -> Content:
    """Places as data: of the HFA dihedral_deg; of other models by the name of the scheduling
    variable."""
    return (
        {"dihedral_deg": places}
        if model.schedule == "dihedral"
        else {"scheduled": {model.schedule: places}}
    )


def loop_statement(found: Statement, moving: bool) -> tuple[list[Part], Content]:
    """What is proved of the loop and of the modes of A, in words and as JSON has it. moving: a rate
    was asked for."""
    claim, covers, model = found.statement, found.covers, found.model
    assert model is not None
    (low, high), over, unit = claim["range"], claim["over"], claim["unit"]
    every, end = ("angle", "_deg") if unit == "deg" else (over, "")
    loop, modes, crossed = joined(covers["loop"]), joined(covers["modes"]), crossings(found)
    still, refuted = gaps(covers["loop"], low, high), [run for run in loop if run[2] > 0]
    resting = gaps(covers.get("motion", []), low, high) if moving else []
    stable, data = not (still or refuted), Content()

    def span(run: tuple[Any, ...]) -> str:
        return f"{run[0]:.10g} to {run[1]:.10g}"

    def ends(run: tuple[Any, ...], **more: Any) -> Content:
        return {f"from{end}": run[0], f"to{end}": run[1]} | more

    lines = [
        f"the loop has {run[2]} unstable modes at every {every} from {span(run)} {unit}"
        for run in refuted
    ]
    lines += [f"open: the loop from {span(gap)} {unit}" for gap in still]
    what, of_rate = (
        "A - B K is Hurwitz",
        [f"decay rate where the loop is Hurwitz: {found.rate:.6g} 1/s"],
    )
    others, more = "other actuators than the loop's own, delay", list[Part]()
    if "actuators" in claim:
        what, of_rate, others = (
            "the loop through the actuators is stable",
            [],
            "other actuators than these",
        )
        data["actuators"] = {
            key: claim["actuators"][key] for key in ("bandwidth", "effectiveness", "delay")
        }
        (slow, fast), (least, most), delay = data["actuators"].values()
        more.append(
            f"{'' if stable else 'asked '}for every actuator bandwidth from {slow:g} to {fast:g} rad/s, the same of all"
            f" inputs; for effectiveness from {least:g} to {most:g}\nand delay up to {delay:g} s of each input for "
            "itself, changing at any time, as when commands are sampled and held"
        )
    lines += [f"the trim exists within its limits and {what} at every {every}"] * stable + of_rate
    lines.append(
        f"boxes: {len(covers['loop'])} for the loop, {len(covers['modes'])} for the aircraft's modes"
    )
    if moving:
        rate, lyapunov = (
            claim.get("place_rate", 0.0),
            claim.get("lyapunov", {"places": [low, high], "P": []}),
        )
        data["dihedral_rate_deg_s" if over == "dihedral" else "scheduled_rate"] = (
            0.0 if resting else rate
        )
        data["lyapunov"] = {**place_data(model, lyapunov["places"]), "P": lyapunov["P"]}
        moves = f"stable while the {over} moves by at most {rate:.4g} {unit}/s, however it does"
        more.append(
            "\n".join(f"open: a moving {over} from {span(gap)} {unit}" for gap in resting) or moves
        )
    data["not_covered"] = (
        f"not covered: {others}, sampling of a controller's own states, a {over} that the loop\n"
        "itself moves and that is not imposed from outside, limits of the inputs, the nonlinear aircraft"
    )
    data |= {"proved": stable and not resting, "decay_rate": found.rate}
    for name, runs in (("loop", loop), ("modes", modes)):
        data[name] = {
            "proved": [ends(run, unstable=run[2]) for run in runs],
            "boxes": len(covers[name]),
        }
    data["loop"]["open"] = [ends(gap) for gap in still]
    data["modes"]["open"] = [ends(run, at_least=run[2][0], at_most=run[2][1]) for run in crossed]
    data["refuted"] = [ends(run, unstable=run[2]) for run in refuted]
    counts = {
        "loop A - B K": [*loop, *((*gap, "open") for gap in still)],
        "aircraft A": [*modes, *((*run[:2], "{} to {}".format(*run[2])) for run in crossed)],
    }
    tables = [
        Table(
            (f"{name}: {over}, {unit}", "unstable modes"),
            [(span(run), str(run[2])) for run in sorted(runs)],
        )
        for name, runs in counts.items()
    ]
    return ["\n".join(lines), *more, data["not_covered"], *tables], data


def schedule_report(proof: Statement, data: Content) -> Report:
    """The statement of the loop."""
    assert proof.model is not None
    verdict = "Refuted" if data["refuted"] else "Left open" if data["loop"]["open"] else "Proved"
    parts, _ = loop_statement(proof, "lyapunov" in data)
    return Report(
        f"{verdict}: every {_interval(proof.statement)}, {proof.model.title}", parts, data=data
    )


def game_report(
    data: Content, states: tuple[str, ...] = (), origin: str = "a plant", file: str = "it"
) -> Report:
    """Of a solution the statements one by one and the P that the radius is about, of a critic the
    distances.

    states: of P. origin: whose game it is. file: of the critic.
    """
    verdict = "Proved" if data.get("proved", True) else "Left open"
    if data["statement"] == "critic":
        found = [
            (key, f"{each['at_least']:.6e}", f"{each['at_most']:.6e}")
            for key, each in data["distances"].items()
        ]
        hurwitz = {
            True: "proved Hurwitz",
            False: "proved not Hurwitz",
            None: "open: a mode may lie on the axis",
        }
        parts = [Table(("|X - X*| / |X*|", "at least", "at most"), found)]
        loop = f"A - B K with this gain: {hurwitz[data['closed_loop_hurwitz']]}"
        title = f"{verdict}: the distance of {file} from the exact solution of the game of {origin}"
        return Report(title, [*parts, loop], data=data)
    above, most, count = (
        data[key] for key in ("delta_min_above", "delta_min_at_most", "unstable_modes")
    )
    said = {True: "proved", False: "open"}
    rows = [
        ("the stabilizing solution exists and is unique", said[data["worst_case_hurwitz"]]),
        ("P is positive definite", said[data["positive_definite"]]),
        ("A - S P is Hurwitz", said[data["worst_case_hurwitz"]]),
        ("A - B K is Hurwitz", said[data["closed_loop_hurwitz"]]),
        ("relative radius about the printed P", f"{data['relative_radius']:.3g}"),
        ("delta_min", "open" if above is None else f"above {above:.10g}, at most {most:.10g}"),
        ("relative width of the bracket", "" if above is None else f"{(most - above) / most:.2g}"),
        ("unstable modes of A", "open: one may lie on the axis" if count is None else str(count)),
    ]
    states = states or numbered("z", len(data["P"]))
    parts = [Table(("statement", "result"), rows), matrix_table("P", states, states, data["P"])]
    return Report(f"{verdict}: the solution of the game of {origin}", parts, data=data)


def lpv_report(proof: Statement, data: Content) -> Report:
    """The proved bounds and where the nodes are; the matrices are data."""
    model = proof.model
    assert model is not None
    places, unit, inputs = (
        np.array(proof.statement["table"]["places"]),
        model.schedule_unit,
        tuple(model.inputs),
    )
    names = {name: f"|{name} - interpolated| / |{name}|" for name in "ABK"}
    names["inputs"] = "|U0 - interpolated|, in nominal units"
    bounds = [(names[name], f"{most:.3g}") for name, most in data["error"].items()]
    steps, every = np.diff(places), "angle" if unit == "deg" else model.schedule
    records = [
        (place, name, row, column, value, unit_of(row, column))
        for k, place in enumerate(places.tolist())
        for name, entries, names_of_rows, columns, unit_of in (
            ("A", data["A"], model.linear, model.linear, model.entry_unit),
            ("B", data["B"], model.linear, inputs, model.entry_unit),
            (
                "K",
                data["K"],
                inputs,
                model.linear,
                lambda u, x: f"({model.unit(u)})/({model.unit(x)})",
            ),
            ("U0", data["inputs_offset"][..., None], inputs, ("",), lambda u, _: model.unit(u)),
        )
        for row, values in zip(names_of_rows, entries[k].tolist(), strict=True)
        for column, value in zip(columns, values, strict=True)
    ]
    return Report(
        title=f"Proved: {len(places)} models from {places[0]:g} to {places[-1]:g} {unit}, {model.title}, interpolate "
        f"linearly within {data['tolerance']:g}",
        parts=[
            Table((f"error at every {every} between, at most", "bound"), bounds),
            f"steps from {steps.min():g} to {steps.max():g} {unit}",
        ],
        data=data,
        records=Table((model.schedule_key, "matrix", "row", "column", "value", "unit"), records),
    )


def checked_report(found: Verified) -> Report:
    """The statement that was verified, in words and in data: proved on the whole interval or not,
    of which aircraft in which flight whatever the options of the command, and with which gains,
    limits and weights."""
    claim, model = found.statement, found.model
    low, high = claim["range"]
    what, parts, own = {"schedule": _schedule, "game": _game, "lpv": _lpv}[found.kind](found)
    boxes, proved = sum(map(len, found.boxes.values())), own.get("proved", True)
    data: Content = {"schema": SCHEMA, "statement": "check", "kind": found.kind}
    data |= {"boxes": boxes, "proved": proved, "written": found.written} | own
    digest, lines = _digest(claim["table"]), list[str]()
    data["table_sha256"] = digest
    lines.append(
        f"table of {', '.join(key for key in claim['table'] if key not in 'MNX')}: SHA-256 {digest[:16]}"
    )
    if model is None:
        what += "the plant of a file"
    else:
        what += f"{claim['over']} {low:g} {claim['unit']}" if low == high else _interval(claim)
        about, of_aircraft = _aircraft(claim, model)
        parts, data = [about, *parts], data | of_aircraft | place_data(model, [low, high])
        for key, name in (
            ("limits", "limits of the trims"),
            ("spread", "half widths of the parameters"),
        ):
            if claim[key]:
                data[key] = claim[key]
                ends = {
                    each: [model.describe(each, x) for x in np.atleast_1d(own)]
                    for each, own in claim[key].items()
                }
                lines.append(
                    f"{name}: "
                    + ", ".join(f"{each} {' to '.join(own)}" for each, own in ends.items())
                )
    if "game" in claim:
        data |= {"game": claim["game"]}
        lines += [f"{key} = {_matrix_said(value)}" for key, value in claim["game"].items()]
    parts += [
        "\n".join(lines),
        "written by hfa {version} on {date}: {command}".format(**found.written),
    ]
    verdict = "Verified, proved" if proved else "Verified, but not proved on the whole interval"
    return Report(f"{verdict}: {what}, {boxes} boxes", parts, data=data)


def _interval(claim: Content) -> str:
    low, high = claim["range"]
    return f"{claim['over']} from {low:g} to {high:g} {claim['unit']}"


def _aircraft(claim: Content, model: Model) -> tuple[str, Content]:
    flight = ", ".join(
        f"{held} {model.describe(held, value)}" for held, value in claim["imposed"].items()
    )
    data = {key: claim[key] for key in ("dynamics", "parameters")}
    if claim["source"] or set(claim["parameters"]) != set(Parameters._fields):
        numbers = "".join(f", {name} {value:.10g}" for name, value in claim["parameters"].items())
        source = f", file of SHA-256 {claim['source'][:16]}" if claim["source"] else ""
        return f"{model.title}{source}{numbers}\ntrims at {flight}", data | {
            "source": claim["source"]
        }
    values = Parameters(**claim["parameters"])
    known = [name for name in NAMED if load_parameters(name).values == values]
    data |= {
        "parameters": known[0] if known else "of the certificate",
        "parameter_hash": parameter_hash(values),
    }
    about = (
        f"{claim['dynamics']} dynamics, parameters {data['parameters']} ({data['parameter_hash']})"
    )
    return f"{about}\ntrims at {flight}", data


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()


def _matrix_said(value: Any) -> str:
    """A number; I; the diagonal; else the SHA-256 of the matrix, whose entries are data."""
    if not isinstance(value, list):
        return str(value)
    diagonal = np.diag(value).tolist()
    if np.array_equal(value, np.diag(diagonal)):
        return (
            "I"
            if set(diagonal) == {1.0}
            else f"diag({', '.join(f'{each:.10g}' for each in diagonal)})"
        )
    return f"matrix {len(value)} x {len(value[0])}, SHA-256 {_digest(value)[:16]}"


def require_same(claim: Content, own: Mapping[str, Any], what: str) -> None:
    """NoSolutionError unless the user's own data, by name, is exactly that of the certificate's
    part."""
    for name, value in own.items():
        if name not in claim:
            raise BadInputError(
                f"{what} gives {name}, which this certificate does not state; leave it out"
            )
        stated = np.inf if claim[name] == "inf" else claim[name]
        if not np.array_equal(np.asarray(stated, dtype=float), np.asarray(value, dtype=float)):
            raise NoSolutionError(f"the certificate is about another {name} than {what} gives")


def _schedule(found: Verified) -> tuple[str, list[Part], Content]:
    claim, covers = found.statement, found.covers
    parts, own = loop_statement(found, "motion" in covers)
    parted = ", ".join(f"{at:.10g}" for at in found.parted[:3])
    lines = [
        f"open: whether the trims before and after {parted} {claim['unit']} are one branch"
    ] * bool(parted)
    lines = lines or ["the trims of all boxes are one branch"]
    if widths := len(claim["spread"]):
        lines.append(
            f"for every value of {widths} parameters within the half widths that the certificate states"
        )
    own |= {name: joined(covers[name]) for name in ("loop", "modes")} | {
        "open": gaps(covers["loop"], *claim["range"])
    }
    own |= {
        "proved": own["proved"] and not parted,
        "one_branch": not parted,
        "crossings": crossings(found),
    }
    return "", ["\n".join(lines), *parts], own


def _game(found: Verified) -> tuple[str, list[Part], Content]:
    claim = found.statement
    rows = [(name, f"{low:.6g}", f"{high:.6g}") for name, (low, high) in claim["distances"].items()]
    ((*_, count),) = found.covers["loop"]
    lines = [
        f"A - B K with this gain is {'Hurwitz' if count == 0 else f'not Hurwitz: {count} unstable modes'}"
    ]
    own: Content = {"distances": claim["distances"], "closed_loop_hurwitz": count == 0}
    if "delta_min" in claim:
        own["delta_min_above"], own["delta_min_at_most"] = above, most = claim["delta_min"]
        lines.append(f"delta_min is above {above:.10g}, at most {most:.10g}")
    table = Table(("|X - X*| / |X*|, X* of the exact game", "at least", "at most"), rows)
    return "the exact game, ", [table, "\n".join(lines)], own


def _lpv(found: Verified) -> tuple[str, list[Part], Content]:
    error = {name: most for name, (_, most) in found.statement["distances"].items()}
    nodes = len(found.statement["table"]["places"])
    rows = [(name, f"{most:.3g}") for name, most in error.items()]
    table = Table(("error between the nodes, at most", "bound"), rows)
    return f"linear interpolation of {nodes} models, ", [table], {"error": error, "nodes": nodes}
