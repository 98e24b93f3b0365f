"""For every place of an interval: the trim exists, so many modes are unstable, the scheduled gain stabilizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from controller.policy.gain_table import GainTable
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import doubles
from verification.enclosures.eigenvalue_signs import counted
from verification.enclosures.place_box import PlaceBox, bisected
from verification.enclosures.trim_branch import Family, ModelForms, TrimBranch
from verification.proof.certificate import CertificateFile, Content, Proof, flights_claim, proved_box
from verification.proof.proof_report import SCHEMA, loop_statement, place_data
from verification.proof.rate_proof import proved_motion
from verification.proof.scheduled_loop import LoopTable, closed_loop, segments
from verification.proof.uncertain_loop import proved_pieces

#: Narrower boxes, in steps of the family, are not tried: they stay open. With errors of the parameters or actuators,
#: which do not become smaller with the box, one gives up earlier.
NARROWEST, NARROWEST_WITH_ERRORS, NARROWEST_WITH_ACTUATORS = 2.0**-10, 2.0**-5, 2.0**-3
#: The part of the middle's decay rate that is claimed for the whole box.
RATE_SHARE = 0.9


def prove_schedule(
    family: Family,
    table: GainTable | LoopTable,
    low: float,
    high: float,
    *,
    moving: bool = False,
    file: CertificateFile | None = None,
    progress: Progress | None = None,
) -> Proof:
    """Prove or refute, box by box, that the loop is Hurwitz; count the unstable modes of A, and bound them elsewhere.

    moving: also prove how fast the scheduling variable may move. file: of the certificate, which is written on the way.
    Raises NoSolutionError where a place has no trim, BadInputError when the table or the model does not reach.
    """
    branch, table = TrimBranch(family), LoopTable.of(table)
    parts, model = segments(table, low, high), family.model
    statement = flights_claim(family, low, high) | {"table": table.stated()}
    if table.actuators is not None:
        statement |= {"actuators": vars(table.actuators)}

    @lru_cache(maxsize=64)
    def forms(box: PlaceBox) -> ModelForms:
        found = branch.forms(box)
        beyond = branch.beyond_limits(found)
        if beyond is not None:
            raise Undecided(f"{beyond} may lie beyond its limits")
        return found

    known: Content = {"boxes": {}, "open": {}} if file is None else file.known(statement, model)
    boxes: dict[str, list[Content]] = {name: [] for name in ("loop", "modes", "least", "most")}
    gaps: dict[str, list[list[float]]] = {"loop": [], "modes": []}
    for name, own in gaps.items():
        boxes[name] += known["boxes"].get(name, [])
        own += [ends for ends in known["open"].get(name, []) if ends[1] != high]

    def frontier(name: str) -> float:
        """Up to which place everything from `low` on is proved or known to stay open."""
        return max([low, *(box["range"][1] for box in boxes[name]), *(ends[1] for ends in gaps[name])])

    def so_far() -> Proof:
        still = {name: own + [[frontier(name), high]] * (frontier(name) < high) for name, own in gaps.items()}
        return Proof("schedule", statement, boxes, still, model)

    narrowest = [NARROWEST_WITH_ERRORS if family.spread else NARROWEST] * 2
    if table.actuators is not None:
        narrowest[0] = NARROWEST_WITH_ACTUATORS
    proofs: tuple[Callable[[PlaceBox], Content | None], ...] = (
        lambda box: _prove(forms(box), table, family),
        lambda box: _prove(forms(box), None, family),
    )
    for index, (name, prove) in enumerate(zip(gaps, proofs, strict=True)):
        for box, proved in bisected(parts, prove, narrowest[index] * family.step, frontier(name)):
            if proved is not None:
                boxes[name].append(proved)
            else:
                gaps[name].append([box.low, box.high])
            if file is not None:
                file.save(so_far())
            if progress is not None:
                progress(round(500 * (index + (box.high - low) / (high - low))), 1000)
    for name, side in (("least", 1), ("most", -1)):
        bounds = (_bound(forms, PlaceBox(*ends), family, side) for ends in gaps["modes"])
        boxes[name] += [each for each in bounds if each is not None]
    if moving:
        more, moved = proved_motion(branch, table, low, high, progress=progress)
        if moved:
            statement, boxes = statement | more, boxes | {"motion": moved}
    found = Proof("schedule", statement, boxes, gaps, model)
    if file is not None:
        file.save(found, finished=True)
    data: Content = {
        "schema": SCHEMA,
        "statement": "schedule",
        "dynamics": model.name,
        **place_data(model, [low, high]),
    }
    entries = [place_data(model, box["range"]) | {key: box[key] for key in "AB"} for box in boxes["loop"]]
    return replace(found, data=data | loop_statement(found, moving)[1] | {"boxes": entries})


def _bound(forms: Callable[[PlaceBox], ModelForms], box: PlaceBox, family: Family, side: int) -> Content | None:
    """How many modes of A lie right of the first line, on a side of the axis, 1 or -1, that is proved to have none."""
    try:
        model = forms(box)
    except Undecided:
        return None
    values = sorted(np.linalg.eigvals(doubles(model.A.parts[0])).real.tolist())
    lines = [(a + b) / 2 for a, b in pairwise(values) if b > a and side * (a + b) > 0.0]
    for line in sorted(lines, key=abs):
        found = counted(model.A, -line)
        if found is not None:
            return proved_box(model, family, **found._asdict() | {"rate": -line})
    return None


def _prove(model: ModelForms, table: LoopTable | None, family: Family) -> Content | None:
    """The loop of a table on a box, or without one A: so many eigenvalues have Re λ > -rate, and none Re λ = -rate."""
    if table is not None and table.actuators is not None:
        pieces = proved_pieces(table, model)
        return None if pieces is None else proved_box(model, family, pieces=[each._asdict() for each in pieces])
    form, rate = model.A if table is None else closed_loop(table, model), 0.0
    middle = doubles(form.parts[0])
    if not np.isfinite(middle).all():
        raise BadInputError("the loop's entries are too large to compute with; check the gains of the table")
    if table is not None:
        rate = RATE_SHARE * max(0.0, -float(np.linalg.eigvals(middle).real.max()))
    found = counted(form, rate)
    return None if found is None else proved_box(model, family, **found._asdict() | {"rate": rate})
