"""The command `hfa prove`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from controller.game.basis import basis
from controller.game.gain_schedule import load_gain_schedule
from controller.game.names import UNNAMED, PlantNames
from hfa.options.argument_types import input_file, interval, number, one_of, positive
from hfa.options.command import command
from hfa.options.games import PlantOptions, design_option
from hfa.options.request import option
from hfa.options.trims import OF_THE_TRIM, OutputOptions, called_at, scheduled
from hfa.output import ProgressLine, print_report, show
from hfa_aircraft.model import Model
from hfa_servo.scheduled_controller import load_controller
from hfa_support.errors import BadInputError, said_of
from hfa_support.files import MATRIX_FILES
from hfa_support.schema import Number

if TYPE_CHECKING:
    from hfa_proof.checker.checker import Verified
    from hfa_proof.search.family import Family
    from hfa_proof.search.loops import Intervals, Loop

#: Of uncertain actuators.
_INTERVALS = ("bandwidth", "effectiveness", "delay")
#: Statement -> options that do not belong to it.
_SCHEDULES = ("design", "weights", "resume", "rate", "error", *_INTERVALS)
_GAMES = ("delta", "Q", "R")
STATEMENTS = {
    "schedule": ("start", "basis", "plant", "file", "limit_error"),
    "solution": ("basis", "file", "limit_error", *_SCHEDULES),
    "critic": ("limit_error", *_SCHEDULES),
    "models": ("start", "basis", "plant", "file", *_GAMES, *_SCHEDULES),
}


def _interval(text: str) -> tuple[float, float]:
    ends = interval(text)
    if not ends[0] > 0.0:
        raise BadInputError(f"is {text}; it must be positive")
    return ends[0], ends[-1]


_not_negative = partial(number, declared=Number(0.0))


def _interval_of(model: Model, text: str) -> tuple[float, ...]:
    """LOW:HIGH of the scheduling variable, or one value, as written."""
    return interval(text)


@dataclass(frozen=True, kw_only=True, eq=False)
class ProveRequest(PlantOptions, OutputOptions):
    """A statement to be proved, or a certificate to be checked."""

    at: Any = scheduled(_interval_of, "DEG|LOW:HIGH", "what is proved holds at every value between")
    statement: str | None = option(
        f"what to prove: {', '.join(STATEMENTS)}",
        "STATEMENT",
        one_of(*STATEMENTS),
        names="statement",
        count="?",
    )
    file: Path | None = option(
        f"of `critic`: W, P or K ({' '.join(MATRIX_FILES)})",
        "FILE",
        input_file(*MATRIX_FILES),
        names="file",
        count="?",
    )
    basis: str = option(
        "of the W of `critic`; default quadratic", "NAME", default="quadratic", rare=True
    )
    check: Path | None = option(
        "verify a certificate instead of proving", "FILE", input_file(".json")
    )
    weights: Path | None = option(
        "gains K over dihedral_deg; default: the exact game's", "FILE", input_file(*MATRIX_FILES)
    )
    design: Any = design_option(
        "of `schedule`: --weights is a controller with memory, on the actuators of this design"
    )
    rate: bool = option("of `schedule`: also how fast the dihedral may move", rare=True)
    error: float = option(
        "of `schedule`: for all parameters within N standard errors; default 0",
        "N",
        _not_negative,
        default=0.0,
        rare=True,
    )
    bandwidth: tuple[float, float] | None = option(
        "of `schedule`: through actuators of any bandwidth, rad/s", "LOW:HIGH", _interval
    )
    effectiveness: tuple[float, float] | None = option(
        "with --bandwidth: share of each command that arrives, changing at any time; default 1",
        "LOW:HIGH",
        _interval,
        rare=True,
    )
    delay: float | None = option(
        "with --bandwidth: each command is late by up to S seconds, changing at any time;"
        " default 0",
        "S",
        _not_negative,
        rare=True,
    )
    resume: bool = option("go on with the unfinished certificate that -o names", rare=True)
    limit_error: float = option(
        "of `models`: of the interpolation, relative; default 1e-3",
        "X",
        positive,
        default=1e-3,
        rare=True,
    )

    def origin(self) -> Mapping[str, Any]:
        """The aircraft; nothing of a check, whose certificate says which aircraft it is about."""
        return {} if self.check is not None else super().origin()

    def family(self, errors: float = 0.0) -> Family:
        """The aircraft and the flights that the options name; the scheduling variable is left.

        errors: every identified parameter may be off by this many of its standard errors."""
        from hfa_proof.search.family import Family

        with_errors = not self.own and self.dynamics != "unsteady"
        standard_errors = self.parameter_set.standard_errors if with_errors else {}
        if errors and not standard_errors:
            raise BadInputError("the parameters have no standard errors; leave --error out")
        spread = {
            name: errors * error for name, error in standard_errors.items() if errors * error > 0.0
        }
        return Family(self.flown_aircraft(), self.common_condition(), spread)

    def ends(self, family: Family) -> tuple[float, float]:
        """LOW:HIGH of --at, as typed; refused where no trim can be."""
        if len(self.at or ()) != 2:
            scheduled_name = family.model.schedule or "the scheduling variable"
            raise BadInputError(
                f"give the interval of {scheduled_name} as --{called_at(self.model)} LOW:HIGH"
            )
        low, high = self.at
        family.check(low, high)
        return low, high

    def intervals(self) -> Intervals | None:
        """What is uncertain about the actuators, if anything."""
        from hfa_proof.search.loops import Intervals

        if self.bandwidth is None:
            self.refuse(_INTERVALS, "is of actuators: give --bandwidth LOW:HIGH too, rad/s")
            return None
        if self.rate:
            raise BadInputError("--rate does not go with --bandwidth; leave one out")
        effectiveness = self.effectiveness or (1.0, 1.0)
        return Intervals(self.bandwidth, effectiveness, self.delay or 0.0)


@command(ProveRequest)
def prove(request: ProveRequest) -> int:
    """Statements with a proof in ball arithmetic, for every angle of an interval and not for the
    points of a grid.

    schedule: at every dihedral of LOW:HIGH the trim exists within its limits and the scheduled gain
    makes the loop Hurwitz, with --bandwidth through all actuators of intervals, also delayed and of
    less effect. solution: the game has one stabilizing solution within a radius of P, its value;
    with a bracket of delta_min. critic FILE: whether the gain in a file stabilizes, and the
    distance of its W, P or K from the exact solution, from below and from above. models: the fewest
    linear models between which A, B, the inputs and the exact K are interpolated within
    --limit-error. -o FILE.json writes a certificate; --check FILE verifies it. Exit 0: proved. Exit
    1: refuted, or left open. Needs python-flint, with --bandwidth also cvxpy (`pip install
    .[proof]`)."""
    from hfa_proof.arithmetic import flint_or_refusal

    flint_or_refusal()
    statement = request.statement
    target = request.output
    if request.check is not None:
        return _check(request, request.check)
    if statement is None:
        raise BadInputError(f"say what to prove, one of {', '.join(STATEMENTS)}, or --check FILE")
    request.refuse(STATEMENTS[statement], f"does not go with `hfa prove {statement}`; leave it out")
    if statement == "models":
        return _models(request)
    if target is not None and target.suffix.lower() != ".json":
        raise BadInputError(f"{target}: a certificate is a .json file; name one")
    return _schedule(request) if statement == "schedule" else _game(request)


def _check(request: ProveRequest, certificate: Path) -> int:
    from hfa_proof.checker.checker import check_certificate
    from hfa_proof.search.report import checked_report

    if request.statement is not None:
        raise BadInputError("--check verifies a certificate as it is; leave the statement out")
    of_certificate = (
        *OF_THE_TRIM,
        "parameters",
        "rate",
        "resume",
        "basis",
        "plant",
        "bandwidth",
        "limit_error",
    )
    request.refuse(
        of_certificate,
        "does not go with --check: the certificate says which aircraft it is about",
    )
    own = request.model if request.own else None
    verified = check_certificate(certificate, ProgressLine("check"), own)
    _require_same(verified, request)
    report = checked_report(verified)
    show(report, request)
    return 0 if report.data["proved"] else 1


def _require_same(verified: Verified, request: ProveRequest) -> None:
    """NoSolutionError unless the data that the user gave beside --check are those of the
    certificate: --dihedral, --weights, --delta, --Q, --R.

    verified: the certificate's statement
    request: of the user; an option that was not given is not compared

    BadInputError for an option that the certificate says nothing of.
    """
    from hfa_proof.checker.statement import (
        Flight,
        GameStatement,
        ScheduleStatement,
        content_of,
    )
    from hfa_proof.search.report import require_same

    statement = verified.statement
    content = content_of(statement)
    if request.at:
        low = request.at[0]
        high = request.at[-1]
        require_same(content.get("flight", {}), {"range": [low, high]}, "--at")
    for name, value in request.changed_weights().items():
        stored_value = "inf" if name == "delta" and math.isinf(value) else value
        require_same(content.get("weights", {}), {name: stored_value}, f"--{name}")
    if request.weights is None:
        return
    option_text = f"--weights {request.weights}"
    if isinstance(statement, GameStatement):
        model = statement.plant.model if isinstance(statement.plant, Flight) else None
        parts = _critic_parts(request.weights, model, len(statement.weights.Q))
        require_same(statement.critic, parts, option_text)
        return
    model = statement.flight.model
    if not isinstance(statement, ScheduleStatement):
        gains = load_gain_schedule(request.weights, model)
        table = {"breakpoints": gains.file_breakpoints, "K": gains.gains}
        require_same(content, table, option_text)
        return
    loop = _loop(request.weights, request, model, _stated_intervals(statement))
    require_same(vars(statement.controller), vars(loop.controller), option_text)
    if (loop.actuators is None) != (statement.actuators is None):
        raise BadInputError(f"{option_text}: the certificate has other actuators; give --design")
    if loop.actuators is not None:
        require_same(vars(statement.actuators), vars(loop.actuators), option_text)


def _stated_intervals(statement: Any) -> Intervals | None:
    from hfa_proof.checker.statement import UncertainActuators
    from hfa_proof.search.loops import Intervals

    actuators = statement.actuators
    if not isinstance(actuators, UncertainActuators):
        return None
    return Intervals(actuators.bandwidth, actuators.effectiveness, actuators.delay)


def _critic_parts(weights: Path, model: Model | None, states: int) -> dict[str, Any]:
    """K, P and W of a file, W as a column."""
    from controller.critic.critic_file import stored_parts

    plant = UNNAMED
    if model is not None:
        plant = PlantNames(model.linear, tuple(model.inputs), model.units(model.linear))
    parts = dict(stored_parts(weights, plant, basis("quadratic", states)))
    if "W" in parts:
        parts["W"] = parts["W"][:, None]
    return parts


def _loop(weights: Path, request: ProveRequest, model: Model, intervals: Intervals | None) -> Loop:
    """The gains of --weights; with --design a controller with memory on its actuators."""
    from hfa_proof.search.loops import loop_of_schedule, loop_of_servo

    if request.design is None:
        return loop_of_schedule(load_gain_schedule(weights, model), intervals)
    controller = load_controller(weights, model)
    return loop_of_servo(controller, request.design.of(model).actuators, model, intervals)


def _schedule(request: ProveRequest) -> int:
    from hfa_proof.search.certificate import CertificateFile
    from hfa_proof.search.loops import exact_gains
    from hfa_proof.search.schedule_proof import prove_schedule

    if request.resume and request.output is None:
        raise BadInputError("--resume needs the certificate to go on with; add -o FILE.json")
    intervals = request.intervals()
    family = request.family(request.error)
    low, high = request.ends(family)
    if request.weights is not None:
        request.refuse(
            _GAMES,
            "does not go with --weights, which gives the gains; leave it out",
        )
        loop = _loop(request.weights, request, family.model, intervals)
    else:
        request.refuse(("design",), "goes with a controller; name its file by --weights FILE.npz")
        changes = request.changed_weights()
        loop = exact_gains(family, low, high, intervals, **changes)
    file = None
    if request.output is not None:
        file = CertificateFile(request.output, request.provenance, resume=request.resume)
    progress = ProgressLine("prove")
    proof = prove_schedule(
        family, loop, low, high, moving=request.rate, file=file, progress=progress
    )
    print_report(proof.report(), request)
    return 0 if proof.proved else 1


def _game(request: ProveRequest) -> int:
    """`solution` and `critic`: of the model at one breakpoint, or of a plant of the user's own."""
    from hfa_proof.search.report import game_report
    from hfa_proof.search.solution_proof import prove_critic, prove_solution

    critic = request.file
    typed = request.at
    if request.statement == "critic" and critic is None:
        raise BadInputError("name the file of the critic: `hfa prove critic FILE --dihedral DEG`")
    if typed is not None and len(typed) != 1:
        raise BadInputError(
            f"a game is at one value; give --{called_at(request.model)} with one value"
        )
    if typed is not None:  # from here on as in the commands of one trim
        in_degrees = request.model.schedule_unit == "deg"
        request = replace(request, at=math.radians(typed[0]) if in_degrees else typed[0])
    named = request.game()
    family = None
    value = None
    if request.plant is None:
        family, value = _flights_at(request, typed)
    if critic is not None:
        from controller.critic.critic_file import Reading, critic_in

        stored = critic_in(critic, named.game, Reading(request.basis))
        with said_of(critic):
            proof = prove_critic(named.game, stored, family, value)
    else:
        progress = ProgressLine("prove")
        proof = prove_solution(named.game, family, value, progress)
    if request.output is not None and proof.witness:
        proof.write(request.output, request.provenance)
    names = named.game.names
    report = game_report(proof.data, names.states, names.origin, str(critic or ""))
    print_report(report, request)
    return 0 if proof.proved else 1


def _flights_at(request: ProveRequest, typed: Any) -> tuple[Family, float]:
    """The flights, and the scheduling value as typed, or that of the trim."""
    family = request.family()
    model = family.model
    start = model.signals[model.schedule].start if model.schedule else 0.0
    value = {**model.trim, **request.hold}.get(model.schedule, start)
    if typed:
        value = typed[0]
    elif model.schedule_unit == "deg":
        value = math.degrees(value)
    family.check(value, value)
    return family, value


def _models(request: ProveRequest) -> int:
    from hfa_proof.search.models_grid import prove_models

    family = request.family()
    low, high = request.ends(family)
    progress = ProgressLine("prove")
    proof = prove_models(family, low, high, request.limit_error, progress=progress)
    if request.output is not None and request.output.suffix.lower() == ".json":
        proof.write(request.output, request.provenance)
        print_report(proof.report(), request)
    else:
        show(proof.report(), request)
    return 0
