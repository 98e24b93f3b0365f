"""Proof of the value of a nonlinear game about a trim, as a polynomial."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from controller.expansion.expansion import Expansion
from hfa_prove.certificate import write_certificate
from hfa_prove.check.game import riccati_S
from hfa_prove.check.value import ValueEquation, check_value
from hfa_prove.enclosure.balls import matrix
from hfa_prove.problem import plant_at
from hfa_prove.search.lines import find_line
from hfa_prove.search.proof import witness_content
from hfa_prove.statements.game import Weights
from hfa_prove.statements.value import LARGEST_RESIDUAL, ValueStatement, ValueWitness
from hfa_support.errors import NoSolutionError
from hfa_support.provenance import Provenance
from trim.point.operating_point import OperatingPoint

#: Factor on the enclosed residual that is claimed.
_CLAIMED = 1.01


@dataclass(frozen=True, eq=False)
class ValueProof:
    """A proved value with the data for its certificate.

    rays: number of rays of the proof
    """

    statement: ValueStatement
    witness: ValueWitness
    rays: int

    def write(self, path: Path, origin: Provenance) -> None:
        """Write the certificate."""
        line = self.witness.loop
        content: dict[str, Any] = witness_content({"H": line.H, "turn": line.turn})
        write_certificate(path, self.statement, content, origin.to_dict())


def prove_value(expansion: Expansion, point: OperatingPoint) -> ValueProof:
    """Return a proof that V and u of an expansion satisfy the equation of the game.

    point: the trim of the expansion

    Raises NoSolutionError if the checker does not prove it.
    """
    game = expansion.game
    game.refuse_cross_weights("a certificate of hfa prove")
    weights = Weights(game.Q, game.R, game.E, game.delta)
    plant = plant_at(point)
    claimed = ValueStatement(
        plant, weights, expansion.order, expansion.weights, expansion.policy_weights, 0.0
    )
    equation = ValueEquation(claimed)
    equation.check_trim()
    residual = _CLAIMED * float(equation.residual().upper())
    if not residual <= LARGEST_RESIDUAL:
        raise NoSolutionError(
            f"the coefficients leave a residual of {residual:.2g}, above {LARGEST_RESIDUAL:g}; "
            "choose a lower order"
        )
    loop = equation.A - riccati_S(weights, equation.B) * matrix(claimed.P)
    found = find_line(loop)
    if found is None:
        raise NoSolutionError("A - S P is not proved Hurwitz")
    statement = replace(claimed, residual=residual)
    witness = ValueWitness(found[1])
    return ValueProof(statement, witness, check_value(statement, witness))
