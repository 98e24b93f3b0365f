"""The command `hfa prove schedule`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from hfa.options.argument_types import input_file, number, output_file, positive
from hfa.options.command import Outcome, ProgressLine, Request, command, provenance
from hfa.options.games import WeightOptions, given_weights
from hfa.options.parser import PAPER, option, refuse
from hfa.options.trims import (
    TrimInput,
    TrimOptions,
    at_name,
    trim_input,
)
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, shortened
from hfa_support.files import MATRIX_FILES, Number

if TYPE_CHECKING:
    from hfa_prove.statements.schedule import Gains


@dataclass(frozen=True, kw_only=True, eq=False)
class ScheduleRequest(Request, TrimOptions, WeightOptions):
    """Options of `hfa prove schedule`."""

    units: None = None
    start: None = None
    conditions: None = None
    row: None = None
    output: Path | None = option(
        "write the certificate: .json", "FILE", output_file(".json"), names="-o --output"
    )
    at: str | None = option("interval that the proof covers", "LOW:HIGH")
    dihedral: str | None = option(
        "interval of the dihedral angle, degrees", "LOW:HIGH", group=PAPER, first=True
    )
    weights: Path | None = option(
        "file with a constant gain K, or gains K at values of the scheduling variable; default: "
        "gains of the exact game, at most 2 deg apart",
        "FILE",
        input_file(*MATRIX_FILES),
    )
    decay: float | None = option(
        "decay rate to prove, 1/s; default: 0.99 of the lowest of samples",
        "RATE",
        partial(number, declared=Number(0.0)),
    )
    rate: float | None = option(
        "also prove stability for a moving scheduling variable: up to this rate, or without a "
        "number up to a rate that the search finds",
        "N",
        positive,
        alone=0.0,
    )


@command(ScheduleRequest)
def schedule(request: ScheduleRequest) -> Outcome:
    """Prove that a gain schedule stabilizes at every value of LOW:HIGH.

    At every value, and not only on a grid, the trim is proved to exist within its limits and the
    eigenvalues of A - B K to have real parts below a decay rate. -o FILE.json writes a certificate
    for `hfa prove --check FILE`. Not covered: actuators, delay, the nonlinear aircraft. Exit code
    0: the statement is proved. Exit code 1: it is false or open; the message states where."""
    from hfa_prove.certificate import write_certificate
    from hfa_prove.search.schedule import Family, breakpoints_of, exact_gains, prove_schedule

    asked = trim_input(request, scheduled=interval_of)
    low, high = _ends(asked)
    given = asked.trim(at=None, hold=asked.held())  # one condition for the whole interval
    family = Family(given.model, given.common)
    family.check(low, high)
    if request.weights is not None:
        refuse_weights(request)
        gains = gains_of_file(request.weights, family.model)
    else:
        weights = given_weights(request, family.model)
        gains = exact_gains(family, breakpoints_of(family, low, high), **weights)
    found = prove_schedule(
        family,
        gains,
        low,
        high,
        decay_rate=request.decay,
        scheduled_rate="largest" if request.rate == 0.0 else request.rate,  # 0: --rate alone
        progress=ProgressLine("prove"),
    )

    def write(path: Path) -> None:
        origin = provenance(request, given.source).to_dict()
        write_certificate(path, found.statement, found.witness, origin)

    # With --rate alone, the search may find no rate.
    is_asked = not (found.open_claim and request.rate)
    return Outcome(report=found.report(), ok=is_asked, source=given.source, write=write)


def interval_of(_model: Model, _name: str, text: str) -> tuple[float, ...]:
    """Return the ends LOW and HIGH of the scheduling variable, or one value, in the unit typed.

    Raises BadInputError unless there is one number, or LOW < HIGH.
    """
    ends = tuple(number(part) for part in text.split(":"))
    if len(ends) > 2 or (len(ends) == 2 and not ends[0] < ends[1]):
        raise BadInputError(f"is {shortened(text)!r}; give one number, or LOW:HIGH with LOW < HIGH")
    return ends


def refuse_weights(request: Request) -> None:
    """Raise BadInputError for weights of a game, which gains in a file exclude."""
    reason = "cannot be combined with --weights, which gives the gains; remove this option"
    refuse(request, ("delta", "Q", "R", "sizes", "N"), reason)


def _ends(asked: TrimInput) -> tuple[float, float]:
    """Return LOW and HIGH of the scheduling variable, as typed."""
    model = asked.model
    if asked.at is None or len(asked.at) != 2:
        name = model.schedule or "the scheduling variable"
        raise BadInputError(f"the interval of {name} is missing; give --{at_name(model)} LOW:HIGH")
    return asked.at[0], asked.at[1]


def gains_of_file(path: Path, model: Model) -> Gains:
    """Return the gain or gain table in a file, with breakpoints in the unit of the user."""
    from hfa_flight.schedule.gain_schedule import load_gain_schedule
    from hfa_prove.statements.schedule import Gains

    stored = load_gain_schedule(path, model)
    return Gains(stored.file_breakpoints, stored.gains)
