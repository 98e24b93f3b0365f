"""Checker of a region, which reads the statement and proves it by repeating the subdivision.

The theorem. S = {V <= rho} in the cube |y_i| <= 1, y = M z, meets no face of it. In S, V' < 0
except at the equilibrium: near it by the enclosed Jacobian, elsewhere on boxes that cover the cube.
All limits hold in S. A trajectory exists while it is in S, V decreases along it, and it never
leaves S. It converges to the only point of S where V' = 0 (LaSalle). Where the equations switch,
trajectories are those of Filippov. The search is not trusted: the checker uses only its multipliers
of extents and the number of boxes after which it gives up.

    loop.py       equilibrium, V', the hole     cover.py    branch and bound
    piece.py      V and its set                 statement.py  the claim
    ../enclosure/  Taylor models"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_boxes.check.equilibrium import check_near
from hfa_boxes.check.loop import Decrease, equilibrium_near
from hfa_boxes.check.statement import BoxStatement
from hfa_proof.checker.reading import naming, require
from hfa_proof.checker.sealed import claims_of, read_sealed, write_sealed
from hfa_support.progress import Progress

#: Kind of the certificate.
KIND = "region-boxes"
#: Largest number of boxes that a certificate may state.
_MOST_BOXES = 100_000_000


@dataclass(frozen=True, eq=False)
class BoxWitness:
    """Evidence for a region, which is not part of the claim.

    multipliers: (n, 2), factors of c - V in the proofs of the lower and upper extents
    boxes: number of boxes after which the checker ends
    """

    multipliers: np.ndarray
    boxes: int


@dataclass(frozen=True, eq=False)
class VerifiedBoxes:
    """A region that is proved.

    statement: the proved statement, every field of which the checker has interpreted
    boxes: number of boxes on which V' < 0 is proved
    written: version, command and date in the file, not verified
    """

    statement: BoxStatement
    boxes: int
    written: dict[str, str]


def check_region(
    statement: BoxStatement, witness: BoxWitness, progress: Progress | None = None
) -> int:
    """Return the number of boxes that prove the statement, or raise Rejected."""
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
    """Return the region that a file proves for a policy.

    path: the certificate
    policy: the user's policy, state deviations -> input deviations; None if the certificate stores
        its coefficients
    progress: called with the number of boxes
    model: the user's aircraft, for a certificate about it

    Raises BadInputError when the file is not a certificate, was edited, or is about another model
    or policy. Raises Rejected when entries are not understood or do not prove the statement.
    """
    content, written = read_sealed(path)
    with naming(path):
        statement, witness = read_content(content, model, policy)
        boxes = check_region(statement, witness, progress)
    return VerifiedBoxes(statement, boxes, written)


def read_content(
    content: dict[str, Any], model: Model | None, policy: ca.Function | None
) -> tuple[BoxStatement, BoxWitness]:
    """Return statement and witness of a certificate's content.

    Raises a Malformed, which names an invalid entry.
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
    """Write a certificate. Its digest does not cover `origin`."""
    evidence = {"multipliers": witness.multipliers.tolist(), "boxes": witness.boxes}
    write_sealed(path, KIND, statement.content(), evidence, origin)
