"""What a proof says: of a schedule, of a solution of the game, of a critic."""

from __future__ import annotations

import math

from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, matrix_table
from verification.proof.rate_proof import RateProof
from verification.proof.schedule_proof import Cover, ScheduleProof
from verification.proof.solution_proof import CriticProof, SolutionProof

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
