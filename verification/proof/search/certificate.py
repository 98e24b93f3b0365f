"""What is proved: a statement and the boxes that prove it, as a certificate has them; its file."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hfa_aircraft.model import Model
from hfa_model.provenance import Provenance
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.files import forget_read, write_text
from hfa_support.jsonable import jsonable
from hfa_support.reporting.report import Report, Reported
from hfa_support.version import VERSION
from verification.proof.arithmetic.balls import TaylorModel, exact
from verification.proof.checker.checker import (
    SCHEMA,
    Rejected,
    Statement,
    check_certificate,
    sealed,
)
from verification.proof.checker.structure import Content, facts_of
from verification.proof.enclosures.matrix_balls import roomy
from verification.proof.enclosures.trim_branch import Family, ModelForms
from verification.proof.search.proof_report import game_report, lpv_report, schedule_report

#: Least time between two writings of an unfinished certificate, s, and in writing times: writing
#: takes a tenth at most.
_PAUSE, _RARELY = 2.0, 9.0
#: Entries are stated this much wider than proved, so that another enclosure, a little wider, agrees
#: with it; with errors of the parameters, whose products the checker encloses in another way, by
#: more.
_WIDER, _WIDER_WITH_ERRORS = 1.5, 4.0
#: ... and by this part of the largest entry of their row, which those that cancel to 0 need.
_FLOOR = 1e-6
#: A trim is sought within so many times, and the root of the number of unknowns, of what the
#: equations leave along the stated polynomial, in Newton's steps; at least within so many nominal
#: values.
_ROOM, FINEST = 1.5, 1e-46


@dataclass(frozen=True, eq=False, repr=False)
class Proof(Reported, Statement):
    """Boxes in increasing order. open: list -> [low, high] of what is left open. data: the result
    as JSON has it."""

    open: dict[str, list[list[float]]] = field(default_factory=dict)
    data: Content = field(default_factory=dict)

    @property
    def proved(self) -> bool:
        """All that was asked; of distances and grids whatever was found is."""
        return bool(self.data.get("proved", True))

    def report(self) -> Report:
        """What is proved, in words, tables and data."""
        if self.kind == "game":
            return game_report(self.data)
        return {"schedule": schedule_report, "lpv": lpv_report}[self.kind](self, self.data)

    def write(self, path: Path, origin: Provenance) -> None:
        """The certificate, every number a double in full; of which run it is is not in its digest.

        NoSolutionError where nothing is proved that it could state.
        """
        if not self.boxes:
            raise NoSolutionError("a mode may lie on the axis; there is nothing to certify")
        own: Content = {"schema": SCHEMA, "kind": self.kind, "toolchain": VERSION}
        own |= {"statement": self.statement, "boxes": self.boxes}
        content = jsonable(own | ({"open": self.open} if self.kind == "schedule" else {}))
        write_text(path, sealed(json.dumps(content)[:-1], json.dumps(jsonable(origin.to_dict()))))


class CertificateFile:
    """The file of a proof while it runs: whole at any time, with what is proved so far."""

    def __init__(self, path: Path, origin: Provenance, *, resume: bool = False) -> None:
        self.path, self._origin, self._resume, self._next = (
            path,
            origin,
            resume,
            time.monotonic() + _PAUSE,
        )

    def save(self, proof: Proof, *, finished: bool = False) -> None:
        """Write what there is, unless it was written a short time ago and is not all."""
        start = time.monotonic()
        if finished or start > self._next:
            proof.write(self.path, self._origin)
            now = time.monotonic()
            self._next = now + max(_PAUSE, _RARELY * (now - start))

    def known(self, statement: Content, model: Model) -> Content:
        """Boxes and open intervals that an earlier run left; verified here, so that nothing in the
        file is believed.

        BadInputError when the file is not the certificate of this statement, or does not prove what
        it states."""
        if not self._resume:
            return {"boxes": {}, "open": {}}
        try:
            stated = check_certificate(self.path, model=model).statement
        except Rejected as error:
            raise BadInputError(f"{error}; remove the file and begin again") from error
        forget_read(self.path)
        content: Content = json.loads(self.path.read_text(encoding="utf-8"))
        same = all(stated.get(key) == value for key, value in jsonable(statement).items())
        if not same or content["toolchain"] != VERSION:
            raise BadInputError(
                f"{self.path}: is of another statement or version; write to another file"
            )
        return content


def flights_claim(family: Family, low: float, high: float) -> Content:
    """Which model, which trims and which places a statement is about."""
    model = family.model
    return {
        **facts_of(model),
        "parameters": {name: signal.start for name, signal in model.parameters.items()},
        "spread": {name: width for name, width in family.spread.items() if width > 0.0},
        "imposed": family.imposed(),
        "limits": family.limits(),
        "range": [low, high],
    }


def proved_box(forms: ModelForms, family: Family, **proof: Any) -> Content:
    """The trims and the linear model on one box, in doubles that are rounded outward, and their
    proved properties.

    trim: unknown -> (c_0, c_1, c_2, radius, z_1, ..): sought within its radius of c_0 + c_1 s + c_2
    s² + Σ z_k t_k, s from -1 to 1 over the box, t the errors of the parameters in their half
    widths; the checker proves it (the prover's own enclosure is Lagrange's, which is wider). A: (n,
    n, 2), B: (n, m, 2): lowest and highest entries."""
    signals, trim, room = family.model.signals, {}, _ROOM * math.sqrt(len(forms.trim))
    for name, (c0, c1, c2, step, *slopes) in forms.trim.items():
        trim[name] = [c0, c1, c2, room * step + FINEST * signals[name].nominal, *slopes]
    own = {
        "range": [forms.box.low, forms.box.high],
        "decimals": family.decimals,
        "unstable": 0,
        "rate": 0.0,
    }
    return own | {"trim": trim, "A": _ends(forms.A), "B": _ends(forms.B)} | proof


def _ends(form: TaylorModel) -> list[list[tuple[float, float]]]:
    """Lowest and highest value of each entry."""
    found, wider = [], _WIDER_WITH_ERRORS if form.parts[4:] else _WIDER
    for row, rests in zip(roomy(form).range().tolist(), form.parts[3].tolist(), strict=True):
        floor, ends = _FLOOR * max(abs(float(entry.mid())) for entry in row), []
        for entry, rest in zip(row, rests, strict=True):
            half = wider * float(entry.rad()) + (floor + _ROOM * float(abs(rest).upper()))
            low, high = float(entry.mid()) - half, float(entry.mid()) + half
            if not exact(low) <= entry <= exact(high):
                raise ArithmeticError("an enclosure was not rounded outward")
            ends.append((low, high))
        found.append(ends)
    return found
