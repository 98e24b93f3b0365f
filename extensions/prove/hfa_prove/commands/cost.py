"""The command `hfa prove cost`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import input_file, number, one_of, positive, span
from hfa.options.game import GameGiven, GameWeights
from hfa.options.output import ProgressLine
from hfa.options.part import OfModel, option, part
from hfa.options.request import Request, command
from hfa.options.trim import Trim
from hfa_prove.commands.check import check
from hfa_prove.commands.options import refuse_no_certificate
from hfa_support.errors import BadInputError
from hfa_support.files import forget_read
from trim.point.linearize import linearize

if TYPE_CHECKING:
    from hfa_flight.problem import FlightProblem
    from hfa_prove.check import Proved
    from hfa_prove.search.cost import CostBound

_DEGREES = ("2", "4", "6", "8", "10", "12")


def _part(text: str) -> float:
    """Return the fraction in the text of an option.

    Raises BadInputError unless the text is a number from 0.0001 to 0.99.
    """
    part = number(text)
    if not 1e-4 <= part <= 0.99:
        raise BadInputError(f"is {text}; give a number from 0.0001 to 0.99")
    return part


@dataclass(frozen=True, kw_only=True, eq=False)
class CostRequest(Request):
    """Arguments of `hfa prove cost`."""

    aircraft: Aircraft = part(Aircraft, without=("units",))
    trim: Trim = part(Trim, without=("limit", "start"))
    game: GameGiven = part(
        GameGiven, without=("plant",), weights=part(GameWeights, without=("N", "delta"))
    )
    degree: int = option(
        "degree of the polynomial W: 2, 4, 6, 8, 10 or 12; default 4",
        "N",
        lambda text: int(one_of(*_DEGREES)(text)),
        default=4,
    )
    margin: float = option(
        "relative distance of W below the linear quadratic cost; a smaller distance requires more "
        "time; default 0.02",
        "PART",
        _part,
        default=0.02,
    )
    seconds: float = option(
        "limit of processor time for the proof, s; default 120",
        "S",
        positive,
        default=120.0,
    )
    limits: Mapping[str, tuple[float, float]] = option(
        "limits of a state, instead of the limits of the flight envelope, degrees for angles; "
        "repeatable",
        "NAME=LOW:HIGH",
        OfModel(span),
        names="--limit",
        named=True,
    )
    resume: bool = option("resume the proof of the unfinished certificate given by -o", rare=True)
    check: Path | None = option(
        "verify this certificate instead of proving a bound", "FILE", input_file(".json")
    )

    def problem(self) -> FlightProblem:
        """Return the optimal control problem of the flights to the trim."""
        from hfa_flight.problem import flight_problem

        aircraft = self.trim.aircraft
        point = self.trim.point()
        game = self.game.weights.game(linearize(aircraft, point))
        return flight_problem(aircraft, point, game.Q, game.R, limits=self.limits)


@command(CostRequest)
def cost(request: CostRequest) -> int:
    """Prove a lower bound on the cost of every flight of the nonlinear aircraft to its trim.

    The cost is the integral of x'Qx + u'Ru, in deviations from the trim. The bound consists of a
    polynomial W in the initial condition and a level. Every flight that ends at the trim, within
    the envelope and the limits of the inputs, costs at least the smaller of W and the level. -o
    FILE.json writes a certificate, also if the run is interrupted. --check FILE verifies a
    certificate. `hfa optimize --bound FILE` compares flights with the bound. Exit code 0 if the
    bound is proved. The command requires the package python-flint.
    """
    from verification.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    if request.check is not None:
        return check(request, request.check, "cost")
    refuse_no_certificate(request.output.file, resume=request.resume)
    return _prove(request)


def _prove(request: CostRequest) -> int:
    from hfa_prove.certificate import write_certificate
    from hfa_prove.report_cost import found_bound_report
    from hfa_prove.search.cost import bound_search
    from hfa_support.interruption import interruptible

    problem = request.problem()
    origin = request.provenance.to_dict()

    def save(found: CostBound) -> None:
        if request.output.file is not None:
            write_certificate(request.output.file, found.statement, found.witness.content(), origin)

    earlier = _earlier(request, problem)
    with interruptible(ProgressLine("cost")) as progress:
        search = bound_search(
            problem,
            degree=request.degree,
            margin=request.margin,
            seconds=request.seconds,
            progress=progress,
            save=save,
        )
        found = search.found(earlier)
    request.print(found_bound_report(found))
    return 0


def _earlier(request: CostRequest, problem: FlightProblem) -> Proved | None:
    """Return the verified bound in the output file of an earlier run, or None without --resume.

    Raises BadInputError if the earlier certificate is about other flights. Raises BadInputError or
    NoSolutionError if the certificate does not prove its statement.
    """
    from hfa_prove.bound import refuse_other
    from hfa_prove.certificate import read_certificate
    from hfa_prove.check import check as proved_by
    from hfa_prove.problem import given_of
    from hfa_prove.statements.plant import Subject

    if not request.resume:
        return None
    assert request.output.file is not None
    path = request.output.file
    given = given_of(problem, "this command", {"Q": problem.Q, "R": problem.R})
    certificate = read_certificate(path, Subject(problem.model))
    refuse_other(path, given, certificate.statement, "; write to another file")
    proved = proved_by(certificate, ProgressLine("check"))
    forget_read(path)
    return proved
