"""What a proof says."""

from __future__ import annotations

from hfa_model.reporting.report import Report
from hfa_model.reporting.text import Table
from hfa_model.vectors import INPUTS, LINEAR_STATES
from verification.proof.rate_proof import RateProof
from verification.proof.schedule_proof import Cover, ScheduleProof

SCHEMA = "hfa.proof/1"


def schedule_report(proof: ScheduleProof, motion: RateProof | None = None) -> Report:
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
