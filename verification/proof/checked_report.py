"""What the checker verified, as a report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hfa_model.reporting.report import Report
from hfa_model.reporting.text import Table
from verification.proof.proof_report import SCHEMA
from verification.proof.schedule_proof import joined

if TYPE_CHECKING:
    from verification.checker.checker import Verified

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
    data |= {"boxes": boxes, "proved": proved} | own
    return Report(title=f"{verdict}: {title}, {boxes} boxes", parts=parts, data=data)


def _schedule(found: Verified) -> tuple[str, list[Any], dict[str, Any]]:
    claim, runs = found.statement, {name: joined(each) for name, each in found.covers.items()}
    lines = [f"decay rate of the loop: {found.rate:.6g} 1/s"]
    if "motion" in runs:
        lines.append(f"stable while the dihedral moves by at most {claim['dihedral_rate']:.4g} deg/s, however it does")
    if claim["spread"]:
        lines.append(
            f"for every value of {len(claim['spread'])} parameters within the half widths that the certificate states"
        )
    whole = [(*claim["dihedral_deg"], 0)]
    tables = [
        Table((head, "unstable modes"), [(f"{a:.10g} to {b:.10g}", str(count)) for a, b, count in runs[name]])
        for head, name in ((_LOOP, "loop"), (_MODES, "modes"))
    ]
    proved = runs["loop"] == whole and runs.get("motion", whole) == whole
    own: dict[str, Any] = {"proved": proved, "decay_rate": found.rate, "loop": runs["loop"], "modes": runs["modes"]}
    own |= {"dihedral_rate_deg_s": claim["dihedral_rate"]} if "motion" in runs else {}
    return "", ["\n".join(lines), *tables], own


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
