"""The command `hfa prove value`, and the check of its certificates."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import whole
from hfa.options.game import GameGiven, GameWeights
from hfa.options.output import ProgressLine
from hfa.options.part import option, part
from hfa.options.request import Request, command
from hfa.options.trim import Trim
from hfa_prove.commands.options import refuse_no_certificate

if TYPE_CHECKING:
    from hfa_prove.commands.request import CheckRequest
    from hfa_prove.statements.value import ValueStatement
    from hfa_prove.subject import Given


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
    from hfa_prove.report_value import found_value_report
    from hfa_prove.search.value import prove_value
    from verification.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    refuse_no_certificate(request.output.file)
    named = request.game.game(request.aircraft, request.trim)
    assert named.linear is not None
    progress = ProgressLine("prove")
    expansion = expand(named.linear, solve(named.game, progress), request.order)
    progress(0.5, 1.0, "enclosing the coefficients")
    proof = prove_value(expansion, named.linear.point)
    if request.output.file is not None:
        proof.write(request.output.file, request.provenance)
    request.print(found_value_report(proof.statement, proof.rays))
    return 0


def check(request: CheckRequest, certificate: Path) -> int:
    """Verify a certificate of a value, print the report, and return exit code 0.

    Raises BadInputError for an option that does not apply. Raises BadInputError or NoSolutionError
    if the certificate contradicts the user's values or does not prove its statement.
    """
    from hfa_prove.certificate import read_certificate
    from hfa_prove.check import check as proved_by
    from hfa_prove.report_value import checked_value_report
    from hfa_prove.statements.plant import Subject
    from hfa_prove.subject import compare

    request.refuse(
        ("game.plant", "policy", "reading.basis", "reading.network", "set", "design"),
        "does not apply to the value of a nonlinear game; remove this option",
    )
    request.refuse(("game.weights.N",), "is not in a certificate of hfa prove; remove this option")
    own = request.model if request.aircraft.own else None
    read = read_certificate(certificate, Subject(own))
    not_given = compare(read.statement, _given(read.statement, request))
    request.show(checked_value_report(proved_by(read, ProgressLine("check")), not_given))
    return 0


def _given(statement: ValueStatement, request: CheckRequest) -> dict[str, Given]:
    """Return path of an entry of the statement -> the value that the user's options give."""
    from controller.critic.critic_file import entries_in
    from hfa_prove.commands.given import aircraft_option, at_one_value, names_aircraft
    from hfa_prove.problem import given_plant, plant_at
    from hfa_prove.subject import Given
    from hfa_support.errors import BadInputError

    given = {
        f"weights.{name}": Given(value, f"--{name}")
        for name, value in request.game.weights.changed.items()
    }
    given["plant.limits"] = Given({}, "a value, which has no limits,")
    if request.trim.at or names_aircraft(request):
        own = plant_at(at_one_value(request).trim.point())
        given |= given_plant(own, aircraft_option(request))
    if request.weights is not None:
        option_named = f"--weights {request.weights}"
        entries = entries_in(request.weights)
        for entry, stated in (("V", "W"), ("u", "policy_weights")):
            if stated not in entries:
                raise BadInputError(
                    f"{request.weights} contains no {stated}; give a file written by `hfa solve "
                    "--order`"
                )
            given[entry] = Given(entries[stated], option_named)
    return given
