"""Checker of a lower bound of the cost, by subdivision into boxes.

`cost.py` states the theorem. Of the search, the checker uses the choice of the unknown states and
inputs at the equilibrium, and the number of boxes after which the checker stops.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_boxes.check.cost import CostInequality
from hfa_boxes.check.cost_statement import CostStatement
from hfa_boxes.check.equilibrium import Equilibrium, check_near, open_rates, zero_near
from hfa_boxes.check.plant import Plant
from hfa_proof.checker.reading import Rejected, naming, require
from hfa_proof.checker.sealed import claims_of, read_sealed, write_sealed
from hfa_support.progress import Progress

#: Kind of the certificate.
KIND = "cost-boxes"
#: Largest number of boxes that a certificate may state.
_MOST_BOXES = 1_000_000_000


@dataclass(frozen=True, eq=False)
class CostWitness:
    """Data for the proof of a lower bound of the cost, not part of the claim.

    solved: names of the states and inputs that are the unknowns of the equilibrium
    boxes: number of boxes for each piece after which the checker stops
    """

    solved: tuple[str, ...]
    boxes: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class VerifiedCost:
    """A lower bound of the cost that the checker has proved.

    statement: the proved statement
    witness: data for the proof, stored in the certificate
    boxes: number of boxes that the proof of each piece evaluated
    written: version, command and date stored in the certificate, not verified
    """

    statement: CostStatement
    witness: CostWitness
    boxes: tuple[int, ...]
    written: dict[str, str]


def equilibrium_of(plant: Plant, x: np.ndarray, solved: tuple[int, ...]) -> Equilibrium:
    """Return an enclosure of the equilibrium states and inputs near x (n + m,).

    solved: indices of the unknown entries of x, as many as there are states

    The other entries keep their values in x.

    Raises Rejected if no equilibrium is proved.
    """
    return zero_near(open_rates(plant), x, plant.nominal, solved)


def check_cost(
    statement: CostStatement, witness: CostWitness, progress: Progress | None = None
) -> tuple[int, ...]:
    """Prove a lower bound of the cost and return the number of boxes evaluated for each piece.

    Raises Rejected if the statement is not proved, or if the witness does not name as many unknowns
    as there are states.
    """
    plant = statement.plant
    names = (*plant.states, *plant.inputs)
    stated = np.array([statement.equilibrium[name] for name in names])
    trim = np.array([{**plant.trim, **plant.inputs}[name] for name in names])
    solved = tuple(names.index(name) for name in witness.solved)
    if len(set(solved)) != len(plant.states):
        raise Rejected(
            f"the numbers of unknowns of the equilibrium ({len(set(solved))}) and of states "
            f"({len(plant.states)}) differ"
        )
    equilibrium = equilibrium_of(plant, stated, solved)
    check_near(equilibrium, stated, plant.nominal, "the stated equilibrium")
    check_near(equilibrium, trim, plant.nominal, "the trim")
    counts = []
    for piece, most in zip(statement.pieces, witness.boxes, strict=True):
        inequality = CostInequality(plant, equilibrium, piece, statement.Q, statement.R)
        counts.append(inequality.proved(most, progress))
    return tuple(counts)


def check_cost_certificate(
    path: Path,
    progress: Progress | None = None,
    model: Model | None = None,
    agrees: Callable[[CostStatement], object] | None = None,
) -> VerifiedCost:
    """Return the lower bound of the cost that a certificate proves.

    path: file of the certificate
    progress: callback for the progress of the proof, or None
    model: the user's aircraft, or None if the certificate concerns a built-in model
    agrees: function of the statement, called before the proof, that raises an error if the user's
        data differ from the statement, or None

    Raises BadInputError if the file is not a certificate, was edited, or concerns another model.
    Raises Rejected if an entry is not understood or the statement is not proved.
    """
    content, written = read_sealed(path)
    with naming(path):
        statement, witness = read_cost(content, model)
    if agrees is not None:
        agrees(statement)
    with naming(path):
        boxes = check_cost(statement, witness, progress)
    return VerifiedCost(statement, witness, boxes, written)


def read_cost(content: dict[str, Any], model: Model | None) -> tuple[CostStatement, CostWitness]:
    """Return the statement and the witness of a certificate about a lower bound of the cost.

    content: the entries of the file
    model: the user's aircraft, or None if the certificate concerns a built-in model

    Raises Malformed for the first invalid entry.
    Raises BadInputError if the certificate concerns another model.
    """
    entries = claims_of(content)
    entries.same("kind", KIND)
    statement = CostStatement.read(entries.value("statement", lambda value: True), model)
    found = entries.fields("witness")
    names = (*statement.plant.states, *statement.plant.inputs)
    solved = found.texts("solved", names)
    require(len(set(solved)) == len(solved), "witness: solved", list(solved))
    counts = found.array("boxes", len(statement.pieces))
    require(bool(np.all(counts <= _MOST_BOXES)), "witness: boxes", counts.tolist())
    if found.has("longer"):  # entry of earlier versions, not used
        found.array("longer", len(statement.pieces), len(statement.plant.states))
    witness = CostWitness(solved, tuple(int(count) for count in counts))
    found.close()
    entries.close()
    return statement, witness


def write_cost_certificate(
    path: Path, statement: CostStatement, witness: CostWitness, origin: dict[str, Any]
) -> None:
    """Write a certificate of a lower bound of the cost.

    path: file of the certificate
    statement: the claim
    witness: data for the proof
    origin: version, command and date, which the digest of the file does not cover
    """
    evidence = {
        "solved": list(witness.solved),
        "boxes": list(witness.boxes),
    }
    write_sealed(path, KIND, statement.content(), evidence, origin)
