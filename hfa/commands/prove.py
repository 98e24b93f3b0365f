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
from controller.game.user_files import UNNAMED, PlantNames
from controller.servo.scheduled_controller import load_controller
from hfa.options.argument_types import input_file, interval, number, one_of, positive
from hfa.options.command import command
from hfa.options.games import PlantOptions, design_option
from hfa.options.request import option
from hfa.options.trims import OF_THE_TRIM, OutputOptions, called_at, scheduled
from hfa.output import ProgressLine, print_report, show
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, said_of
from hfa_support.files import MATRIX_FILES
from hfa_support.schema import Number

if TYPE_CHECKING:
    from verification.proof.checker.checker import Verified
    from verification.proof.enclosures.trim_branch import Family
    from verification.proof.search.scheduled_loop import LoopTable

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
        "with --bandwidth: each command is late by up to S seconds, changing at any time; default 0",
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
        from verification.proof.enclosures.trim_branch import Family

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
            raise BadInputError(
                f"give the interval of {family.over or 'the scheduling variable'} as --{called_at(self.model)} LOW:HIGH"
            )
        low, high = self.at
        family.check(low, high)
        return low, high

    def uncertain(self) -> dict[str, Any]:
        """What is uncertain about the actuators."""
        intervals = {name: getattr(self, name) for name in _INTERVALS}
        return {name: value for name, value in intervals.items() if value is not None}


@command(ProveRequest)
def prove(request: ProveRequest) -> int:
    """Statements with a proof in ball arithmetic, for every angle of an interval and not for the
    points of a grid.

    schedule: at every dihedral of LOW:HIGH the trim exists within its limits and the scheduled gain
    makes the loop Hurwitz, with --bandwidth through all actuators of intervals, also delayed and of
    less effect. solution: the game has one stabilizing solution within a radius of P, its value;
    with a bracket of delta_min. critic FILE: the distance of W, P or K in a file from the exact
    solution, from below and from above. models: linear models on the coarsest grid whose A, B, U0
    and exact K are off by --limit-error at most between its points. -o FILE.json writes a certificate; --check FILE verifies
    it, by other means than it was made with. Exit 0: proved. Exit 1: refuted, or left open. Needs
    python-flint (`pip install .[proof]`)."""
    from verification.proof.arithmetic import flint_or_refusal

    flint_or_refusal()
    statement, target = request.statement, request.output
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
    from verification.proof.checker.checker import check_certificate
    from verification.proof.search.proof_report import checked_report

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
    )
    request.refuse(
        of_certificate,
        "does not go with --check: the certificate says which aircraft it is about",
    )
    own = request.model if request.own else None
    found = check_certificate(certificate, ProgressLine("check"), own)
    _require_same(found, request)
    report = checked_report(found)
    show(report, request)
    return 0 if report.data["proved"] else 1


def _require_same(found: Verified, request: ProveRequest) -> None:
    """Bind the certificate to the user's own data: --dihedral, --weights, --delta, --Q, --R must be
    what it states."""
    from verification.proof.search.proof_report import require_same

    claim, own = found.statement, dict[str, Any]()
    if ends := request.at:
        require_same(claim, {"range": ends * (2 // len(ends))}, "--at")
    for name, value in request.changed_weights().items():
        require_same(claim.get("game", {}), {name: value}, f"--{name}")
    weights = request.weights
    if weights is None:
        return
    if found.kind == "game":
        of = found.model
        plant = PlantNames(of.linear, tuple(of.inputs), of.units(of.linear)) if of else UNNAMED
        from controller.critic.critic_file import stored_parts

        functions = basis("quadratic", len(claim["game"]["Q"]))
        own = dict(stored_parts(weights, plant, functions))
        if "W" in own:
            own["W"] = own["W"][:, None]
    else:
        assert found.model is not None
        actuators = claim.get("actuators") or {}
        uncertain = {name: actuators[name] for name in _INTERVALS if actuators}
        table = _table(weights, request, found.model, claim["imposed"].get("speed", 0.0), uncertain)
        own = {
            key: getattr(table, key)
            for key in ("places", *"KMNX"[: 4 if found.kind == "schedule" else 1])
        }
        if table.actuators is not None:
            require_same(actuators, vars(table.actuators), f"--weights {weights}")
    require_same(claim["table"], own, f"--weights {weights}")


def _table(
    weights: Path, request: ProveRequest, of: Model, speed: float, uncertain: dict[str, Any]
) -> LoopTable:
    """The gains of --weights; with --design a controller with memory on its actuators. speed: of
    the trims, ft/s."""
    from verification.proof.search.scheduled_loop import LoopTable, servo_table

    if request.design is not None:
        controller = load_controller(weights, of)
        return servo_table(controller, request.design.of(of).actuators, speed, of, **uncertain)
    table = LoopTable.of(load_gain_schedule(weights, of))
    return table.through(**uncertain) if uncertain else table


def _schedule(request: ProveRequest) -> int:
    from verification.proof.search.certificate import CertificateFile
    from verification.proof.search.schedule_proof import prove_schedule
    from verification.proof.search.scheduled_loop import exact_gains

    if request.resume and request.output is None:
        raise BadInputError("--resume needs the certificate to go on with; add -o FILE.json")
    uncertain = request.uncertain()
    if request.bandwidth is None:
        request.refuse(_INTERVALS, "is of actuators: give --bandwidth LOW:HIGH too, rad/s")
    elif request.rate:
        raise BadInputError("--rate does not go with --bandwidth; leave one out")
    family = request.family(request.error)
    low, high = request.ends(family)
    if request.weights is not None:
        request.refuse(
            _GAMES,
            "does not go with --weights, which gives the gains; leave it out",
        )
        speed = family.condition(low).imposed.get("speed", 0.0)
        table = _table(request.weights, request, family.model, speed, uncertain)
    else:
        request.refuse(("design",), "goes with a controller; name its file by --weights FILE.npz")
        changes = request.changed_weights()
        table = exact_gains(family, low, high, uncertain, **changes)
    place, progress = request.output, ProgressLine("prove")
    file = (
        None if place is None else CertificateFile(place, request.provenance, resume=request.resume)
    )
    proof = prove_schedule(
        family, table, low, high, moving=request.rate, file=file, progress=progress
    )
    print_report(proof.report(), request)
    return 0 if proof.proved else 1


def _game(request: ProveRequest) -> int:
    """`solution` and `critic`: of the model at one place, or of a plant of the user's own."""
    from verification.proof.search.proof_report import game_report
    from verification.proof.search.solution_proof import prove_critic, prove_solution

    critic, typed = request.file, request.at
    if request.statement == "critic" and critic is None:
        raise BadInputError("name the file of the critic: `hfa prove critic FILE --dihedral DEG`")
    if typed is not None and len(typed) != 1:
        raise BadInputError(
            f"a game is at one place; give --{called_at(request.model)} with one value"
        )
    if typed is not None:  # from here on as in the commands of one trim
        in_degrees = request.model.schedule_unit == "deg"
        request = replace(request, at=math.radians(typed[0]) if in_degrees else typed[0])
    named, of = request.game(), tuple[Any, ...]()
    if request.plant is None:
        family = request.family()
        start = family.model.signals[family.over].start if family.over else 0.0
        value = {**family.model.trim, **request.hold}.get(family.over, start)
        place = typed[0] if typed else math.degrees(value) if family.unit == "deg" else value
        family.check(place, place)
        of = (family, place)
    if critic is not None:
        from controller.critic.critic_file import Reading, critic_in

        stored = critic_in(critic, named.game, named.plant, Reading(request.basis))
        with said_of(critic):
            proof = prove_critic(named.game, stored, *of)
    else:
        proof = prove_solution(named.game, *of)
    if request.output is not None and proof.proved:
        proof.write(request.output, request.provenance)
    report = game_report(proof.data, named.states, named.origin, str(critic or ""))
    print_report(report, request)
    return 0 if proof.proved else 1


def _models(request: ProveRequest) -> int:
    from verification.proof.search.lpv_grid import coarsest_grid

    family = request.family()
    low, high = request.ends(family)
    proof = coarsest_grid(family, low, high, request.limit_error, progress=ProgressLine("prove"))
    if request.output is not None and request.output.suffix.lower() == ".json":
        proof.write(request.output, request.provenance)
        print_report(proof.report(), request)
    else:
        show(proof.report(), request)
    return 0
