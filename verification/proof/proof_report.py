"""What a proof says: of a schedule, of a solution of the game, of a critic."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_model.parameters import NAMED, Parameters, named_parameters
from hfa_model.provenance import parameter_hash
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table, matrix_table
from trim.point.condition import describe
from verification.proof.rate_proof import RateProof
from verification.proof.schedule_proof import Cover, Run, ScheduleProof, crossings, gaps, joined
from verification.proof.solution_proof import CriticProof, SolutionProof

if TYPE_CHECKING:
    from verification.checker.checker import Verified

SCHEMA = "hfa.proof/1"


def schedule_proof_report(proof: ScheduleProof, motion: RateProof | None = None) -> Report:
    """The verdict, how many modes are unstable where, what is open, and the enclosures of the model's entries."""
    dynamics = proof.family.aircraft.variant.name
    verdict = "Proved" if proof.proved else "Refuted" if proof.refuted else "Left open"
    where = f"every dihedral from {proof.low:g} to {proof.high:g} deg, {dynamics} dynamics"
    lines = [
        *(f"the loop has {n} unstable modes at every angle from {a:.10g} to {b:.10g} deg" for a, b, n in proof.refuted),
        *(f"open: the loop from {a:.10g} to {b:.10g} deg" for a, b in proof.loop.gaps),
        *(["the trim exists within its limits and A - B K is Hurwitz at every angle"] * proof.proved),
        f"decay rate where the loop is Hurwitz: {proof.rate:.6g} 1/s",
        f"boxes: {len(proof.loop.proved)} for the loop, {len(proof.modes.proved)} for the aircraft's modes",
    ]
    crossed = [{"at_least": least, "at_most": most} for _, _, (least, most) in proof.crossings]
    data = {
        "schema": SCHEMA,
        "statement": "schedule",
        "proved": proof.proved,
        "dynamics": dynamics,
        "dihedral_deg": [proof.low, proof.high],
        "decay_rate": proof.rate,
        "loop": _cover_data(proof.loop) | {"open": [_ends(gap) for gap in proof.loop.gaps]},
        "modes": _cover_data(proof.modes)
        | {"open": [_ends(run) | more for run, more in zip(proof.crossings, crossed, strict=True)]},
        "refuted": [_ends(run) | {"unstable": run[2]} for run in proof.refuted],
        "boxes": [
            {"dihedral_deg": [each.box.low, each.box.high], "A": each.model.A, "B": each.model.B}
            for each in proof.loop.proved
        ],
    }
    parts: list[Part] = ["\n".join(lines)]
    if motion is not None:
        data |= {"dihedral_rate_deg_s": motion.rate, "lyapunov": {"dihedral_deg": motion.dihedral_deg, "P": motion.P}}
        parts.append(_motion(motion.rate) if motion.rate > 0.0 else "open: no rate of the dihedral is proved")
    parts += [*_mode_tables(proof.covers, proof.low, proof.high), _enclosures(proof)]
    return Report(title=f"{verdict}: {where}", parts=parts, data=data)


def _motion(rate: float) -> str:
    return f"stable while the dihedral moves by at most {rate:.4g} deg/s, however it does"


def _mode_tables(covers: dict[str, list[Run]], low: float, high: float) -> list[Table]:
    """How many modes of the loop and of A are unstable where, and what is open."""
    rows: dict[str, list[tuple[float, float, Any]]] = {
        "loop A - B K": [*joined(covers["loop"]), *((*gap, "open") for gap in gaps(covers["loop"], low, high))],
        "aircraft A": [
            *joined(covers["modes"]),
            *((a, b, f"{least} to {most}") for a, b, (least, most) in crossings(covers, low, high)),
        ],
    }
    return [
        Table(
            (f"{name}: dihedral, deg", "unstable modes"),
            [(f"{a:.10g} to {b:.10g}", str(count)) for a, b, count in sorted(own, key=lambda run: run[0])],
        )
        for name, own in rows.items()
    ]


def _cover_data(cover: Cover) -> dict[str, Any]:
    return {"proved": [_ends(run) | {"unstable": run[2]} for run in cover.counts], "boxes": len(cover.proved)}


def _ends(run: tuple[Any, ...]) -> dict[str, Any]:
    return {"from_deg": run[0], "to_deg": run[1]}


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
    low, high = claim["dihedral_deg"]
    lines = [f"decay rate where the loop is Hurwitz: {found.rate:.6g} 1/s"]
    own: dict[str, Any] = {"decay_rate": found.rate, "crossings": crossings(covers, low, high)}
    still = gaps(covers["motion"], low, high) if "motion" in covers else []
    if "motion" in covers and not still:
        own["dihedral_rate_deg_s"] = claim["dihedral_rate"]
        lines.append(_motion(claim["dihedral_rate"]))
    lines += [f"open: a moving dihedral from {a:.10g} to {b:.10g} deg" for a, b in still]
    if claim["spread"]:
        lines.append(
            f"for every value of {len(claim['spread'])} parameters within the half widths that the certificate states"
        )
    runs, still_open = joined(covers["loop"]), gaps(covers["loop"], low, high)
    own |= {"proved": runs == [(low, high, 0)] and not still}
    own |= {"loop": runs, "modes": joined(covers["modes"]), "open": still_open}
    return "", ["\n".join(lines), *_mode_tables(covers, low, high)], own


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
