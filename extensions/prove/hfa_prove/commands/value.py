"""The command `hfa prove value`."""

from __future__ import annotations

from dataclasses import dataclass

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import whole
from hfa.options.game import GameGiven, GameWeights
from hfa.options.output import ProgressLine
from hfa.options.part import option, part
from hfa.options.request import Request, command
from hfa.options.trim import Trim
from hfa_prove.commands.options import refuse_no_certificate


@dataclass(frozen=True, kw_only=True, eq=False)
class ValueRequest(Request):
    """Options of `hfa prove value`."""

    aircraft: Aircraft = part(Aircraft, without=("units",))
    trim: Trim = part(Trim)
    game: GameGiven = part(GameGiven, without=("plant",), weights=part(GameWeights, without=("N",)))
    order: int = option("degree D of V, 2 to 5; default 4", "D", whole(2, 5), default=4)


@command(ValueRequest)
def value(request: ValueRequest) -> int:
    """Prove that V and u are value and policy of the nonlinear game about the trim, to a degree.

    Each coefficient of the Hamilton-Jacobi-Isaacs equation up to degree D is enclosed in ball
    arithmetic, from the derivatives of the equations. The quadratic part of V is proved to be
    positive definite and stabilizing. -o FILE.json writes a certificate for `hfa prove --check
    FILE`. Not covered: the set in which V is the value, terms beyond degree D, and limits of the
    inputs. Exit code 0 if the statement is proved. The command requires the package python-flint.
    """
    from controller.expansion.expansion import expand
    from controller.riccati.gare import solve
    from hfa_prove.enclosure.precision import flint_or_refusal
    from hfa_prove.report_value import found_value_report
    from hfa_prove.search.value import prove_value

    flint_or_refusal()
    refuse_no_certificate(request.output.file)
    named = request.game.game(request.aircraft, request.trim)
    assert named.linear is not None  # of an aircraft
    progress = ProgressLine("prove")
    expansion = expand(named.linear, solve(named.game, progress), request.order)
    progress(0.5, 1.0, "enclosing the coefficients")
    proof = prove_value(expansion, named.linear.point)
    if request.output.file is not None:
        proof.write(request.output.file, request.provenance)
    request.print(found_value_report(proof.statement, proof.rays))
    return 0
