"""Checker of a region of attraction, by subdivision into boxes.

Theorem. Let z be the deviation from the equilibrium, y = M z, and S = {V <= rho} within the cube
|y_i| <= 1. Suppose that S meets no face of the cube, that V' < 0 in S except at the equilibrium,
and that all limits hold in S. Then every trajectory that begins in S exists for all time, stays in
S and converges to the equilibrium (LaSalle). Where the equations switch, trajectories are Filippov
solutions.

Of the search, the checker uses the multipliers of the extents and the number of boxes after which
the checker stops.

    loop.py         equilibrium, V', and V' < 0 near the equilibrium
    cover.py        branch and bound
    piece.py        V and its set
    statement.py    the claim
    ../enclosure/   Taylor models
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.certificate import claims_of, read_sealed, write_sealed
from hfa_prove.check.equilibrium import check_near
from hfa_prove.check.loop_boxes import Decrease, equilibrium_near
from hfa_prove.fields import naming, require
from hfa_prove.statements.region_boxes import BoxStatement
from hfa_support.progress import Progress

#: Kind of the certificate.
KIND = "region-boxes"
#: Largest number of boxes that a certificate may state.
_MOST_BOXES = 100_000_000


@dataclass(frozen=True, eq=False)
class BoxWitness:
    """Data for the proof of a region, not part of the claim.

    The bounds of the deviations z are proved with multiples of rho - V.

    multipliers: (n, 2), nonnegative factors of rho - V for the lower and upper bound of each z_i
    boxes: number of boxes after which the checker stops
    """

    multipliers: np.ndarray
    boxes: int


@dataclass(frozen=True, eq=False)
class VerifiedBoxes:
    """A region of attraction that the checker has proved.

    statement: the proved statement
    boxes: number of boxes that the proof evaluated
    written: version, command and date stored in the certificate, not verified
    """

    statement: BoxStatement
    boxes: int
    written: dict[str, str]


def check_region(
    statement: BoxStatement, witness: BoxWitness, progress: Progress | None = None
) -> int:
    """Prove a statement about a region and return the number of boxes that the proof evaluated.

    Raises Rejected if the statement is not proved.
    """
    loop = statement.loop
    stated = np.array(list(statement.equilibrium.values()))
    equilibrium = equilibrium_near(loop, stated)
    check_near(equilibrium, stated, loop.nominal[: len(loop.states)], "the stated one")
    extents = np.array([statement.extents[name] for name in loop.states])
    decrease = Decrease(loop, equilibrium, statement.piece, extents, witness.multipliers)
    return decrease.proved(witness.boxes, progress)


def check_certificate(
    path: Path,
    policy: ca.Function | None,
    progress: Progress | None = None,
    model: Model | None = None,
) -> VerifiedBoxes:
    """Return the region of attraction that a certificate proves.

    path: file of the certificate
    policy: the user's policy, state deviations -> input deviations, or None if the certificate
        stores the coefficients of the policy
    progress: callback for the progress of the proof, or None
    model: the user's aircraft, or None if the certificate concerns a built-in model

    Raises BadInputError if the file is not a certificate, was edited, or concerns another model or
    policy. Raises Rejected if an entry is not understood or the statement is not proved.
    """
    content, written = read_sealed(path)
    with naming(path):
        statement, witness = read_content(content, model, policy)
        boxes = check_region(statement, witness, progress)
    return VerifiedBoxes(statement, boxes, written)


def read_content(
    content: dict[str, Any], model: Model | None, policy: ca.Function | None
) -> tuple[BoxStatement, BoxWitness]:
    """Return the statement and the witness of a certificate.

    content: the entries of the file
    model: the user's aircraft, or None if the certificate concerns a built-in model
    policy: the user's policy, or None if the certificate stores the coefficients of the policy

    Raises Malformed for the first invalid entry.
    Raises BadInputError if the certificate concerns another model or policy.
    """
    entries = claims_of(content)
    entries.same("kind", KIND)
    statement = BoxStatement.read(entries.value("statement", lambda value: True), model, policy)
    found = entries.fields("witness")
    n = len(statement.loop.states)
    multipliers = found.array("multipliers", n, 2)
    require(bool(np.all(multipliers >= 0.0)), "witness: multipliers")
    witness = BoxWitness(multipliers, found.count("boxes", _MOST_BOXES))
    found.close()
    entries.close()
    return statement, witness


def write_certificate(
    path: Path, statement: BoxStatement, witness: BoxWitness, origin: dict[str, Any]
) -> None:
    """Write a certificate of a region of attraction.

    path: file of the certificate
    statement: the claim
    witness: data for the proof
    origin: version, command and date, which the digest of the file does not cover
    """
    evidence = {"multipliers": witness.multipliers.tolist(), "boxes": witness.boxes}
    write_sealed(path, KIND, statement.content(), evidence, origin)
