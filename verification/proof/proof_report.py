"""What a proof says: of a schedule, of a solution of the game, of a critic."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_model.parameters import NAMED, Parameters, load_parameters
from hfa_model.provenance import parameter_hash
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.model import Model
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table, matrix_table
from verification.proof.rate_proof import RateProof
from verification.proof.schedule_proof import Cover, Run, ScheduleProof, crossings, gaps, joined
from verification.proof.solution_proof import CriticProof, SolutionProof

if TYPE_CHECKING:
    from verification.checker.checker import Verified

SCHEMA = "hfa.proof/1"


def schedule_proof_report(proof: ScheduleProof, motion: RateProof | None = None) -> Report:
    """The verdict, how many modes are unstable where, open intervals, and the enclosures of the model's entries."""
    family, model = proof.family, proof.family.model
    over, unit, actuators = model.schedule, family.unit, proof.table.actuators
    verdict = "Proved" if proof.proved else "Refuted" if proof.refuted else "Left open"
    every = "angle" if unit == "deg" else over
    lines = [
        *(
            f"the loop has {n} unstable modes at every {every} from {a:.10g} to {b:.10g} {unit}"
            for a, b, n in proof.refuted
        ),
        *(f"open: the loop from {a:.10g} to {b:.10g} {unit}" for a, b in proof.loop.gaps),
    ]
    if proof.proved:
        what = "A - B K is Hurwitz" if actuators is None else "the loop through the actuators is stable"
        lines.append(f"the trim exists within its limits and {what} at every {every}")
    if actuators is None:
        lines.append(f"decay rate where the loop is Hurwitz: {proof.rate:.6g} 1/s")
    lines.append(f"boxes: {len(proof.loop.proved)} for the loop, {len(proof.modes.proved)} for the aircraft's modes")
    crossed = [{"at_least": least, "at_most": most} for _, _, (least, most) in proof.crossings]
    end = "_deg" * (unit == "deg")
    data: dict[str, Any] = {
        "schema": SCHEMA,
        "statement": "schedule",
        "proved": proof.proved,
        "dynamics": model.name,
        **scheduled(model, [proof.low, proof.high]),
        "decay_rate": proof.rate,
        "loop": _cover_data(proof.loop, end) | {"open": [_ends(gap, end) for gap in proof.loop.gaps]},
        "modes": _cover_data(proof.modes, end)
        | {"open": [_ends(run, end) | more for run, more in zip(proof.crossings, crossed, strict=True)]},
        "refuted": [_ends(run, end) | {"unstable": run[2]} for run in proof.refuted],
        "boxes": [
            {**scheduled(model, [each.box.low, each.box.high]), "A": each.model.A, "B": each.model.B}
            for each in proof.loop.proved
        ],
    }
    parts: list[Part] = ["\n".join(lines)]
    if actuators is not None:
        said, data["actuators"] = _actuators({key: getattr(actuators, key) for key in _INTERVALS})
        parts.append(said if proof.proved else f"asked {said}")
    if motion is not None:
        data |= {_rate_key(over): motion.rate, "lyapunov": {**scheduled(model, motion.places), "P": motion.P}}
        said = _motion(over, unit, motion.rate) if motion.rate > 0.0 else f"open: no rate of the {over} is proved"
        parts.append(said)
    parts.append(_not_covered(over, actuators is not None))
    data["not_covered"] = parts[-1]
    parts += [*_mode_tables(proof.covers, proof.low, proof.high, over, unit, len(model.linear)), _enclosures(proof)]
    where = f"every {over} from {proof.low:g} to {proof.high:g} {unit}, {model.title}"
    return Report(title=f"{verdict}: {where}", parts=parts, data=data)


def scheduled(model: Model | None, places: Any) -> dict[str, Any]:
    """Places as data: of the HFA dihedral_deg; of other models by the name of the scheduling variable."""
    return (
        {"dihedral_deg": places}
        if model is None or model.schedule == "dihedral"
        else {"scheduled": {model.schedule: places}}
    )


def _rate_key(over: str) -> str:
    return "dihedral_rate_deg_s" if over == "dihedral" else "scheduled_rate"


_INTERVALS = ("bandwidth", "effectiveness", "delay")


def _actuators(intervals: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """For which actuators a loop is proved."""
    (slow, fast), (least, most), delay = (intervals[key] for key in _INTERVALS)
    said = (
        f"for every actuator bandwidth from {slow:g} to {fast:g} rad/s, the same of all inputs; for effectiveness from "
        f"{least:g} to {most:g}\nand delay up to {delay:g} s of each input for itself, changing at any time, as when "
        "commands are sampled and held"
    )
    return said, {key: intervals[key] for key in _INTERVALS}


def _not_covered(over: str, uncertain: bool) -> str:
    """What a proof of a loop does not cover."""
    others = "other actuators than these" if uncertain else "other actuators than the loop's own, delay"
    return (
        f"not covered: {others}, sampling of a controller's own states, a {over} that the loop\n"
        "itself moves and that is not imposed from outside, limits of the inputs, the nonlinear aircraft"
    )


def _motion(over: str, unit: str, rate: float) -> str:
    return f"stable while the {over} moves by at most {rate:.4g} {unit}/s, however it does"


def _mode_tables(
    covers: dict[str, list[Run]], low: float, high: float, over: str, unit: str, states: int
) -> list[Table]:
    """How many modes of the loop and of A are unstable where, and the open intervals."""
    rows: dict[str, list[tuple[float, float, Any]]] = {
        "loop A - B K": [*joined(covers["loop"]), *((*gap, "open") for gap in gaps(covers["loop"], low, high))],
        "aircraft A": [
            *joined(covers["modes"]),
            *((a, b, f"{least} to {most}") for a, b, (least, most) in crossings(covers, low, high, states)),
        ],
    }
    return [
        Table(
            (f"{name}: {over}, {unit}", "unstable modes"),
            [(f"{a:.10g} to {b:.10g}", str(count)) for a, b, count in sorted(own, key=lambda run: run[0])],
        )
        for name, own in rows.items()
    ]


def _cover_data(cover: Cover, end: str) -> dict[str, Any]:
    return {"proved": [_ends(run, end) | {"unstable": run[2]} for run in cover.counts], "boxes": len(cover.proved)}


def _ends(run: tuple[Any, ...], end: str) -> dict[str, Any]:
    return {f"from{end}": run[0], f"to{end}": run[1]}


def _enclosures(proof: ScheduleProof) -> Table:
    """Lowest and highest value of each entry over all proved boxes."""
    rows, of = [], proof.family.model
    models = [each.model for each in proof.loop.proved]
    for name, columns in (("A", of.linear), ("B", of.inputs)):
        for i, row in enumerate(of.linear):
            for j, column in enumerate(columns):
                ends = [getattr(model, name)[i, j] for model in models]
                low, high = min((end[0] for end in ends), default=0.0), max((end[1] for end in ends), default=0.0)
                if max(abs(low), abs(high)) > 1e-3:
                    rows.append((f"{name}({row}, {column})", f"{low:.5g}", f"{high:.5g}"))
    return Table(("entry", "at least", "at most"), rows)


def solution_proof_report(proof: SolutionProof, states: tuple[str, ...], origin: str) -> Report:
    """The verdict, the statements one by one, and the P that the radius is about."""
    enclosed, delta = proof.enclosed, proof.delta
    modes = "open: one may lie on the axis" if proof.unstable is None else str(proof.unstable)
    bracket = "open" if delta is None else f"above {delta.refused:.10g}, at most {delta.value:.10g}"
    rows = [
        ("the stabilizing solution exists and is unique", "proved" if enclosed.stabilizing else "open"),
        ("P is positive definite", "proved" if enclosed.is_value else "open"),
        ("A - S P is Hurwitz", "proved" if enclosed.stabilizing else "open"),
        ("A - B K is Hurwitz", "proved" if enclosed.stable else "open"),
        ("relative radius about the printed P", f"{proof.radius:.3g}"),
        ("delta_min", bracket),
        ("relative width of the bracket", "" if delta is None else f"{delta.width:.2g}"),
        ("no value below the bracket because", "" if delta is None else delta.reason),
        ("unstable modes of A", modes),
    ]
    return Report(
        title=f"{'Proved' if proof.proved else 'Left open'}: the solution of the game of {origin}",
        parts=[Table(("statement", "result"), rows), matrix_table("P", states, states, proof.P)],
        data={
            "schema": SCHEMA,
            "statement": "solution",
            "proved": proof.proved,
            "P": proof.P,
            "relative_radius": proof.radius,
            "positive_definite": enclosed.is_value,
            "worst_case_hurwitz": enclosed.stabilizing,
            "closed_loop_hurwitz": enclosed.stable,
            "delta": proof.about.game.delta if math.isfinite(proof.about.game.delta) else None,
            "delta_min_above": None if delta is None else delta.refused,
            "delta_min_at_most": None if delta is None else delta.value,
            "unstable_modes": proof.unstable,
        },
    )


def critic_proof_report(proof: CriticProof, file: str, origin: str) -> Report:
    """Distances from below and from above, and whether the gain stabilizes."""
    rows = [(name, f"{found.at_least:.6e}", f"{found.at_most:.6e}") for name, found in proof.distances.items()]
    verdict = {True: "proved Hurwitz", False: "proved not Hurwitz", None: "open: a mode may lie on the axis"}
    return Report(
        title=f"Proved: the distance of {file} from the exact solution of the game of {origin}",
        parts=[
            Table(("|X - X*| / |X*|", "at least", "at most"), rows),
            f"A - B K with this gain: {verdict[proof.stabilizes]}",
        ],
        data={
            "schema": SCHEMA,
            "statement": "critic",
            "distances": {name: found._asdict() for name, found in proof.distances.items()},
            "closed_loop_hurwitz": proof.stabilizes,
        },
    )


def checked_report(found: Verified) -> Report:
    """The statement that was verified, in words and in data."""
    claim = found.statement
    low, high = claim["range"]
    data: dict[str, Any] = {"schema": SCHEMA, "statement": "check", "kind": found.kind}
    data |= scheduled(found.model, [low, high])
    boxes = sum(len(runs) for runs in found.covers.values())
    title, parts, own = {"schedule": _schedule, "game": _game, "lpv": _lpv}[found.kind](found)
    proved = own.get("proved", True)
    verdict = "Verified, proved" if proved else "Verified, but not proved on the whole interval"
    data |= {"boxes": boxes, "proved": proved, "written": found.written} | own
    if "A" in claim:
        title += "the plant of a file"
    else:
        over, unit = claim["over"], claim["unit"]
        title += f"{over} {low:g} {unit}" if low == high else f"{over} from {low:g} to {high:g} {unit}"
        about, of_aircraft = _aircraft(found)
        parts, data = [about, *parts], data | of_aircraft
    lines, stated = _stated(claim, found.model)
    parts, data = [*parts, lines], data | stated
    parts = [*parts, "written by hfa {version} on {date}: {command}".format(**found.written)]
    return Report(title=f"{verdict}: {title}, {boxes} boxes", parts=parts, data=data)


def _aircraft(found: Verified) -> tuple[str, dict[str, Any]]:
    """Which aircraft the certificate is about, and in which flight, whatever the options of the command say."""
    claim, model = found.statement, found.model
    assert model is not None
    flight = ", ".join(f"{held} {model.describe(held, value)}" for held, value in claim["imposed"].items())
    if claim["source"] or set(claim["parameters"]) != set(Parameters._fields):
        numbers = "".join(f", {name} {value:.10g}" for name, value in claim["parameters"].items())
        source = f", file of SHA-256 {claim['source'][:16]}" if claim["source"] else ""
        about = f"{model.title}{source}{numbers}\ntrims at {flight}"
        return about, {"dynamics": claim["dynamics"], "source": claim["source"], "parameters": claim["parameters"]}
    values = Parameters(**claim["parameters"])
    known = [name for name in NAMED if load_parameters(name).values == values]
    name, digits = known[0] if known else "of the certificate", parameter_hash(values)
    about = f"{claim['dynamics']} dynamics, parameters {name} ({digits})\ntrims at {flight}"
    return about, {"dynamics": claim["dynamics"], "parameters": name, "parameter_hash": digits}


def _stated(claim: dict[str, Any], model: Model | None) -> tuple[str, dict[str, Any]]:
    """The subject of the theorem besides the aircraft: hash of the gains or of the critic, limits, errors, the game."""
    digest = _digest(claim["table"])
    data: dict[str, Any] = {"table_sha256": digest}
    lines = [f"table of {', '.join(key for key in claim['table'] if key not in 'MNX')}: SHA-256 {digest[:16]}"]
    for key, what in (("limits", "limits of the trims"), ("spread", "half widths of the parameters")):
        if model is not None and claim.get(key):
            data[key] = claim[key]
            said = {name: value if isinstance(value, list) else [value] for name, value in claim[key].items()}
            ends = (f"{name} " + " to ".join(model.describe(name, end) for end in said[name]) for name in said)
            lines.append(f"{what}: {', '.join(ends)}")
    if "game" in claim:
        data |= {"game": claim["game"]}
        lines += [f"{key} = {_matrix_said(value)}" for key, value in claim["game"].items()]
    return "\n".join(lines), data


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


def require_same(claim: dict[str, Any], own: Mapping[str, Any], what: str) -> None:
    """NoSolutionError unless the user's own data, by name, is exactly that of the certificate's part."""
    for name, value in own.items():
        if name not in claim:
            raise BadInputError(f"{what} gives {name}, which this certificate does not state; leave it out")
        stated = np.inf if claim[name] == "inf" else claim[name]
        if not np.array_equal(np.asarray(stated, dtype=float), np.asarray(value, dtype=float)):
            raise NoSolutionError(f"the certificate is about another {name} than {what} gives")


def _schedule(found: Verified) -> tuple[str, list[Any], dict[str, Any]]:
    claim, covers, model = found.statement, found.covers, found.model
    assert model is not None
    (low, high), over, unit = claim["range"], claim["over"], claim["unit"]
    crossed = crossings(covers, low, high, len(model.linear))
    own: dict[str, Any] = {"decay_rate": found.rate, "crossings": crossed, "one_branch": not found.parted}
    lines = []
    if "actuators" in claim:
        said, own["actuators"] = _actuators(claim["actuators"])
        lines.append(said)
    else:
        lines.append(f"decay rate where the loop is Hurwitz: {found.rate:.6g} 1/s")
    still = gaps(covers["motion"], low, high) if "motion" in covers else []
    if "motion" in covers and not still:
        own[_rate_key(over)] = claim["place_rate"]
        lines.append(_motion(over, unit, claim["place_rate"]))
    lines += [f"open: a moving {over} from {a:.10g} to {b:.10g} {unit}" for a, b in still]
    if claim["spread"]:
        lines.append(
            f"for every value of {len(claim['spread'])} parameters within the half widths that the certificate states"
        )
    parted = ", ".join(f"{at:.10g}" for at in found.parted[:3])
    lines.append(
        f"open: whether the trims before and after {parted} {unit} are one branch"
        if parted
        else "the trims of all boxes are one branch"
    )
    runs, still_open = joined(covers["loop"]), gaps(covers["loop"], low, high)
    own |= {"proved": runs == [(low, high, 0)] and not still and not found.parted}
    own |= {"loop": runs, "modes": joined(covers["modes"]), "open": still_open}
    lines.append(_not_covered(over, "actuators" in claim))
    return "", ["\n".join(lines), *_mode_tables(covers, low, high, over, unit, len(model.linear))], own


def _game(found: Verified) -> tuple[str, list[Any], dict[str, Any]]:
    claim = found.statement
    rows = [(name, f"{low:.6g}", f"{high:.6g}") for name, (low, high) in claim["distances"].items()]
    ((*_, count),) = found.covers["loop"]
    lines = [f"A - B K with this gain is {'Hurwitz' if count == 0 else f'not Hurwitz: {count} unstable modes'}"]
    own: dict[str, Any] = {"distances": claim["distances"], "closed_loop_hurwitz": count == 0}
    if "delta_min" in claim:
        above, most = claim["delta_min"]
        lines.append(f"delta_min is above {above:.10g}, at most {most:.10g}")
        own |= {"delta_min_above": above, "delta_min_at_most": most}
    table = Table(("|X - X*| / |X*|, X* of the exact game", "at least", "at most"), rows)
    return "the exact game, ", [table, "\n".join(lines)], own


def _lpv(found: Verified) -> tuple[str, list[Any], dict[str, Any]]:
    error = {name: most for name, (_, most) in found.statement["distances"].items()}
    table = Table(("error between the nodes, at most", "bound"), [(k, f"{v:.3g}") for k, v in error.items()])
    nodes = len(found.statement["table"]["places"])
    return f"linear interpolation of {nodes} models, ", [table], {"error": error, "nodes": nodes}
