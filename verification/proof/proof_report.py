"""What a proof says: of a schedule, of a solution of the game, of a critic."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_model.parameters import NAMED, Parameters, named_parameters
from hfa_model.provenance import parameter_hash
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, matrix_table
from trim.point.condition import describe
from verification.proof.rate_proof import RateProof
from verification.proof.schedule_proof import Cover, ScheduleProof, joined
from verification.proof.solution_proof import CriticProof, SolutionProof

if TYPE_CHECKING:
    from verification.checker.checker import Verified

SCHEMA = "hfa.proof/1"


def schedule_proof_report(proof: ScheduleProof, motion: RateProof | None = None) -> Report:
    """The verdict, how many modes are unstable where, what is open, and the enclosures of the model's entries."""
    loop, modes = _runs(proof.loop), _runs(proof.modes, proof.crossings)
    where = f"every dihedral from {proof.low:g} to {proof.high:g} deg, {proof.family.aircraft.variant.name} dynamics"
    data = {
        "schema": SCHEMA,
        "statement": "schedule",
        "proved": proof.proved,
        "dynamics": proof.family.aircraft.variant.name,
        "dihedral_deg": [proof.low, proof.high],
        "decay_rate": proof.rate,
        "loop": _data(proof.loop),
        "modes": _data(proof.modes)
        | {
            "open": [
                {"from_deg": low, "to_deg": high, "at_least": least, "at_most": most}
                for low, high, (least, most) in proof.crossings
            ]
        },
        "refuted": [{"from_deg": low, "to_deg": high, "unstable": count} for low, high, count in proof.refuted],
        "boxes": [
            {"dihedral_deg": [each.box.low, each.box.high], "A": each.model.A, "B": each.model.B}
            for each in proof.loop.proved
        ],
    }
    if motion is not None:
        data |= {"dihedral_rate_deg_s": motion.rate, "lyapunov": {"dihedral_deg": motion.dihedral_deg, "P": motion.P}}
    return Report(
        title=f"{_verdict(proof)}: {where}",
        parts=[
            _said(proof),
            *([] if motion is None else [_motion(motion)]),
            Table(("loop A - B K: dihedral, deg", "unstable modes"), loop),
            Table(("aircraft A: dihedral, deg", "unstable modes"), modes),
            _enclosures(proof),
        ],
        data=data,
    )


def _verdict(proof: ScheduleProof) -> str:
    if proof.proved:
        return "Proved"
    return "Refuted" if proof.refuted else "Left open"


def _said(proof: ScheduleProof) -> str:
    lines = []
    for low, high, count in proof.refuted:
        lines.append(f"the loop has {count} unstable modes at every angle from {low:.10g} to {high:.10g} deg")
    for low, high in proof.loop.gaps:
        lines.append(f"open: the loop from {low:.10g} to {high:.10g} deg")
    if proof.proved:
        lines.append("the trim exists within its limits and A - B K is Hurwitz at every angle")
    lines.append(f"decay rate where the loop is Hurwitz: {proof.rate:.6g} 1/s")
    lines.append(f"boxes: {len(proof.loop.proved)} for the loop, {len(proof.modes.proved)} for the aircraft's modes")
    return "\n".join(lines)


def _motion(motion: RateProof) -> str:
    if motion.rate <= 0.0:
        return "open: no rate of the dihedral is proved"
    return f"stable while the dihedral moves by at most {motion.rate:.4g} deg/s, however it does"


def _runs(cover: Cover, crossings: list[tuple[float, float, tuple[int, int]]] | None = None) -> list[tuple[str, str]]:
    rows = [(low, f"{low:.10g} to {high:.10g}", str(count)) for low, high, count in cover.counts]
    if crossings is None:
        rows += [(low, f"{low:.10g} to {high:.10g}", "open") for low, high in cover.gaps]
    rows += [(low, f"{low:.10g} to {high:.10g}", f"{a} to {b}") for low, high, (a, b) in crossings or ()]
    return [(where, count) for _, where, count in sorted(rows)]


def _data(cover: Cover) -> dict[str, object]:
    return {
        "proved": [{"from_deg": low, "to_deg": high, "unstable": count} for low, high, count in cover.counts],
        "open": [{"from_deg": low, "to_deg": high} for low, high in cover.gaps],
        "boxes": len(cover.proved),
    }


def _enclosures(proof: ScheduleProof) -> Table:
    """Lowest and highest value of each entry over all proved boxes."""
    rows = []
    models = [each.model for each in proof.loop.proved]
    for name, columns in (("A", LINEAR_STATES), ("B", INPUTS)):
        for i, row in enumerate(LINEAR_STATES):
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
            "delta": proof.game.delta if math.isfinite(proof.game.delta) else None,
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


_LOOP, _MODES = "loop A - B K: dihedral, deg", "aircraft A: dihedral, deg"


def checked_report(found: Verified) -> Report:
    """The statement that was verified, in words and in data."""
    claim = found.statement
    low, high = claim["dihedral_deg"]
    data: dict[str, Any] = {"schema": SCHEMA, "statement": "check", "kind": found.kind, "dihedral_deg": [low, high]}
    boxes = sum(len(runs) for runs in found.covers.values())
    title, parts, own = {"schedule": _schedule, "game": _game, "lpv": _lpv}[found.kind](found)
    proved = own.get("proved", True)
    verdict = "Verified, proved" if proved else "Verified, but not proved on the whole interval"
    about = f"dihedral {low:g} deg" if low == high else f"dihedral from {low:g} to {high:g} deg"
    title += "the plant of a file" if "A" in claim else about
    data |= {"boxes": boxes, "proved": proved, "written": found.written} | own
    if "A" not in claim:
        about, of_aircraft = _aircraft(claim)
        parts, data = [about, *parts], data | of_aircraft
    lines, stated = _stated(claim)
    parts, data = [*parts, lines], data | stated
    parts = [*parts, "written by hfa {version} on {date}: {command}".format(**found.written)]
    return Report(title=f"{verdict}: {title}, {boxes} boxes", parts=parts, data=data)


def _aircraft(claim: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Which aircraft the certificate is about, and in which flight, whatever the options of the command say."""
    values = Parameters(**claim["parameters"])
    known = [name for name in NAMED if named_parameters(name).values == values]
    name, digits = known[0] if known else "of the certificate", parameter_hash(values)
    flight = ", ".join(f"{held} {describe(held, value)}" for held, value in claim["imposed"].items())
    about = f"{claim['dynamics']} dynamics, parameters {name} ({digits})\ntrims at {flight}"
    return about, {"dynamics": claim["dynamics"], "parameters": name, "parameter_hash": digits}


def _stated(claim: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """What the theorem is about beside the aircraft: hash of the gains or of the critic, limits, errors, the game."""
    digest = _digest(claim["table"])
    data: dict[str, Any] = {"table_sha256": digest}
    lines = [f"table of {', '.join(key for key in claim['table'] if key not in 'MNX')}: SHA-256 {digest[:16]}"]
    for key, what in (("limits", "limits of the trims"), ("spread", "half widths of the parameters")):
        if claim.get(key):
            data[key] = claim[key]
            lines.append(
                f"{what}: " + ", ".join(f"{name} {_quantity_said(name, value)}" for name, value in claim[key].items())
            )
    if "game" in claim:
        data |= {"game": claim["game"]}
        lines += [f"{key} = {_matrix_said(value)}" for key, value in claim["game"].items()]
    return "\n".join(lines), data


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()


def _quantity_said(name: str, value: float | list[float]) -> str:
    return " to ".join(describe(name, end) for end in value) if isinstance(value, list) else f"{value:.4g}"


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
    claim, covers = found.statement, found.covers
    whole, gaps = [(*claim["dihedral_deg"], 0)], {name: _gaps(claim, covers[name]) for name in covers}
    runs = {name: joined(covers[name]) for name in covers}
    crossings = joined([(low, high, _bounds(covers, low, high)) for low, high in _parts(gaps["modes"], covers)])
    counts = {
        "loop": [*runs["loop"], *((low, high, "open") for low, high in gaps["loop"])],
        "modes": [*runs["modes"], *((low, high, f"{least} to {most}") for low, high, (least, most) in crossings)],
    }
    lines = [f"decay rate where the loop is Hurwitz: {found.rate:.6g} 1/s"]
    own: dict[str, Any] = {"decay_rate": found.rate, "crossings": crossings}
    if runs.get("motion") == whole:
        own["dihedral_rate_deg_s"] = claim["dihedral_rate"]
        lines.append(f"stable while the dihedral moves by at most {claim['dihedral_rate']:.4g} deg/s, however it does")
    lines += [f"open: a moving dihedral from {low:.10g} to {high:.10g} deg" for low, high in gaps.get("motion", ())]
    if claim["spread"]:
        lines.append(
            f"for every value of {len(claim['spread'])} parameters within the half widths that the certificate states"
        )
    tables = [
        Table(
            (head, "unstable modes"),
            [(f"{a:.10g} to {b:.10g}", str(count)) for a, b, count in sorted(counts[name], key=lambda run: run[0])],
        )
        for head, name in ((_LOOP, "loop"), (_MODES, "modes"))
    ]
    own |= {"proved": runs["loop"] == whole and runs.get("motion", whole) == whole}
    own |= {"loop": runs["loop"], "modes": runs["modes"], "open": gaps["loop"]}
    return "", ["\n".join(lines), *tables], own


def _gaps(claim: dict[str, Any], runs: list[tuple[float, float, int]]) -> list[tuple[float, float]]:
    """What the runs, in increasing order, leave of the interval."""
    low, high = claim["dihedral_deg"]
    ends = [low, *(end for run in sorted(runs) for end in run[:2]), high]
    return [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if a < b]


def _parts(
    gaps: list[tuple[float, float]], covers: dict[str, list[tuple[float, float, int]]]
) -> list[tuple[float, float]]:
    """The gaps, cut where a bound of the number of modes begins or ends."""
    cuts = sorted({end for name in ("least", "most") for run in covers[name] for end in run[:2]})
    return [part for a, b in gaps for part in pairwise([a, *(cut for cut in cuts if a < cut < b), b])]


def _bounds(covers: dict[str, list[tuple[float, float, int]]], low: float, high: float) -> tuple[int, int]:
    """The least and the most modes of A that may be unstable somewhere between, as far as it is proved."""
    least, most = ([n for a, b, n in covers[name] if a <= low and high <= b] for name in ("least", "most"))
    return max(least, default=0), min(most, default=len(LINEAR_STATES))


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
    table = Table(("error at every angle between, at most", "bound"), [(k, f"{v:.3g}") for k, v in error.items()])
    nodes = len(found.statement["table"]["dihedral_deg"])
    return f"linear interpolation of {nodes} models, ", [table], {"error": error, "nodes": nodes}
