"""The command `hfa prove schedule`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import input_file
from hfa.options.game import GameGiven, GameWeights
from hfa.options.output import ProgressLine
from hfa.options.part import option, part
from hfa.options.request import Request, command
from hfa.options.trim import Trim, called_at, scheduled
from hfa_design.options import design_option
from hfa_prove.commands.options import (
    family_of,
    interval_of,
    loop_of_file,
    not_negative,
    positive_interval,
    refuse_no_certificate,
)
from hfa_support.errors import BadInputError
from hfa_support.files import MATRIX_FILES

if TYPE_CHECKING:
    from hfa_prove.search.family import Family
    from hfa_prove.search.loops import Intervals

#: Options of uncertain actuators.
_INTERVALS = ("bandwidth", "effectiveness", "delay")


@dataclass(frozen=True, kw_only=True, eq=False)
class ScheduleRequest(Request):
    """Options of `hfa prove schedule`."""

    aircraft: Aircraft = part(Aircraft, without=("units",))
    trim: Trim = part(
        Trim,
        without=("start",),
        at=scheduled(interval_of, "LOW:HIGH", "interval that the proof covers"),
    )
    game: GameGiven = part(GameGiven, without=("plant",), weights=part(GameWeights, without=("N",)))
    weights: Path | None = option(
        "file with gains K at values of the scheduling variable; default: gains of the exact game",
        "FILE",
        input_file(*MATRIX_FILES),
    )
    design: Any = design_option("design that defines the actuators of the controller in --weights")
    rate: bool = option(
        "also prove stability for a moving scheduling variable, up to a rate that the proof finds",
        rare=True,
    )
    error: float = option(
        "number of standard errors of the parameters that the proof covers; default 0",
        "N",
        not_negative,
        default=0.0,
        rare=True,
    )
    bandwidth: tuple[float, float] | None = option(
        "interval of actuator bandwidths that the proof covers, rad/s",
        "LOW:HIGH",
        positive_interval,
    )
    effectiveness: tuple[float, float] | None = option(
        "interval of time-varying actuator effectiveness that the proof covers; default 1; "
        "requires --bandwidth",
        "LOW:HIGH",
        positive_interval,
        rare=True,
    )
    delay: float | None = option(
        "largest time-varying delay of each command that the proof covers, s; default 0; requires "
        "--bandwidth",
        "S",
        not_negative,
        rare=True,
    )
    resume: bool = option("resume the proof of the unfinished certificate given by -o", rare=True)

    def ends(self, family: Family) -> tuple[float, float]:
        """Return LOW and HIGH of the scheduling variable, as typed.

        Raises BadInputError if the interval is missing, or if proofs do not support its trims.
        """
        if len(self.trim.at or ()) != 2:
            scheduled_name = family.model.schedule or "the scheduling variable"
            raise BadInputError(
                f"the interval of {scheduled_name} is missing; give --{called_at(self.model)} "
                "LOW:HIGH"
            )
        low, high = self.trim.at
        family.check(low, high)
        return low, high

    def intervals(self) -> Intervals | None:
        """Return the intervals of uncertain actuators, or None if --bandwidth is not given.

        Raises BadInputError for another interval without --bandwidth, and for --rate with
        --bandwidth.
        """
        from hfa_prove.search.loops import Intervals

        if self.bandwidth is None:
            self.refuse(
                _INTERVALS,
                "requires uncertain actuators; add --bandwidth LOW:HIGH (rad/s), or remove this "
                "option",
            )
            return None
        if self.rate:
            raise BadInputError("--rate and --bandwidth cannot be combined; remove one of the two")
        effectiveness = self.effectiveness or (1.0, 1.0)
        return Intervals(self.bandwidth, effectiveness, self.delay or 0.0)


@command(ScheduleRequest)
def schedule(request: ScheduleRequest) -> int:
    """Prove in ball arithmetic that a gain schedule stabilizes at every value of LOW:HIGH.

    At every value, and not only on a grid, the trim is proved to exist within its limits and the
    loop to be Hurwitz. With --bandwidth, every actuator with a bandwidth in an interval is covered.
    -o FILE.json writes a certificate for `hfa prove --check FILE`. Exit code 0: the statement is
    proved. Exit code 1: the statement is refuted or remains open. The command requires
    the package python-flint, and --bandwidth also cvxpy."""
    from hfa_prove.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    refuse_no_certificate(request.output.file, resume=request.resume)
    from hfa_prove.search.loops import exact_gains
    from hfa_prove.search.proof import CertificateFile
    from hfa_prove.search.schedule import prove_schedule

    intervals = request.intervals()
    family = family_of(request.aircraft, request.trim, request.error)
    low, high = request.ends(family)
    if request.weights is not None:
        request.refuse(
            ("game.weights.delta", "game.weights.Q", "game.weights.R"),
            "cannot be combined with --weights, which gives the gains; remove this option",
        )
        loop = loop_of_file(request.weights, request.design, family.model, intervals)
    else:
        request.refuse(
            ("design",),
            "requires a controller; add --weights FILE.npz with the controller, or remove this "
            "option",
        )
        changes = request.game.weights.changed
        loop = exact_gains(family, low, high, intervals, **changes)
    file = None
    if request.output.file is not None:
        file = CertificateFile(request.output.file, request.provenance, resume=request.resume)
    progress = ProgressLine("prove")
    proof = prove_schedule(
        family, loop, low, high, moving=request.rate, file=file, progress=progress
    )
    request.print(proof.report())
    return 0 if proof.proved else 1
