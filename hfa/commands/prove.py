"""The commands `hfa prove` and `hfa lpv`."""

from __future__ import annotations

import argparse
import math
from functools import partial
from typing import TYPE_CHECKING, Any

from controller.game.basis import basis
from controller.game.gain_schedule import load_gains
from controller.game.user_files import UNNAMED, PlantNames
from controller.servo.scheduled_controller import load_controller
from hfa.options import games, trims
from hfa.options.argument_types import OWN, input_file, model, number, one_of, places, positive
from hfa.options.parser import Option, Options, command
from hfa.output import ProgressLine, provenance, show
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
STATEMENTS = {
    "schedule": ("start", "basis", "model", "file"),
    "solution": ("basis", "file", *_SCHEDULES),
    "critic": _SCHEDULES,
}


def _interval(text: str) -> tuple[float, float]:
    ends = places(text)
    if not ends[0] > 0.0:
        raise BadInputError(f"is {text}; it must be positive")
    return ends[0], ends[-1]


def _trims(form: str) -> Options:
    """Trims over an interval of the scheduling variable, about which something is proved."""
    about = "what is proved holds at every value between"
    return {**trims.at(places, form, about), **trims.flights(), **trims.AIRCRAFT}


def _options() -> Options:
    matrices, optional = input_file(*MATRIX_FILES), {"nargs": "?"}
    not_negative = partial(number, declared=Number(0.0))
    design = "of `schedule`: --weights is a controller with memory, on the actuators of this design"
    error = "of `schedule`: for all parameters within N standard errors; default 0"
    effectiveness = (
        "with --bandwidth: share of each command that arrives, changing at any time; default 1"
    )
    delay = (
        "with --bandwidth: each command is late by up to S seconds, changing at any time; default 0"
    )
    of_schedule: Options = {
        "--weights": Option(
            "gains K over dihedral_deg; default: the exact game's", "FILE", matrices
        ),
        **trims.design(design),
        "--rate": Option("of `schedule`: also how fast the dihedral may move"),
        "--error": Option(error, "N", not_negative, 0.0),
        "--bandwidth": Option(
            "of `schedule`: through actuators of any bandwidth, rad/s", "LOW:HIGH", _interval
        ),
        "--effectiveness": Option(effectiveness, "LOW:HIGH", _interval),
        "--delay": Option(delay, "S", not_negative),
        "--resume": Option("go on with the unfinished certificate that -o names"),
    }
    return {
        "statement": Option(
            f"what to prove: {', '.join(STATEMENTS)}",
            "STATEMENT",
            one_of(*STATEMENTS),
            more=optional,
        ),
        "file": Option(
            f"of `critic`: W, P or K ({' '.join(MATRIX_FILES)})", "FILE", matrices, more=optional
        ),
        "--basis": Option("of the W of `critic`; default quadratic", "NAME", default="quadratic"),
        "--check": Option("verify a certificate instead of proving", "FILE", input_file(".json")),
        **of_schedule,
        **_trims("DEG|LOW:HIGH"),
        **games.MODEL,
        **games.WEIGHTS,
        **trims.output(),
    }


@command(_options)
def prove(arguments: argparse.Namespace) -> int:
    """Statements with a proof in ball arithmetic, for every angle of an interval and not for the
    points of a grid.

    schedule: at every dihedral of LOW:HIGH the trim exists within its limits and the scheduled gain
    makes the loop Hurwitz, with --bandwidth through all actuators of intervals, also delayed and of
    less effect. solution: the game has one stabilizing solution within a radius of P, its value;
    with a bracket of delta_min. critic FILE: the distance of W, P or K in a file from the exact
    solution, from below and from above. -o FILE.json writes a certificate; --check FILE verifies
    it, by other means than it was made with. Exit 0: proved. Exit 1: refuted, or left open. Needs
    python-flint (`pip install .[proof]`)."""
    from verification.proof.arithmetic import flint_or_refusal

    flint_or_refusal()
    statement, target = arguments.statement, arguments.output
    if arguments.check is not None:
        return _check(arguments)
    if statement is None:
        raise BadInputError(f"say what to prove, one of {', '.join(STATEMENTS)}, or --check FILE")
    trims.refuse(
        arguments, STATEMENTS[statement], f"does not go with `hfa prove {statement}`; leave it out"
    )
    if target is not None and target.suffix.lower() != ".json":
        raise BadInputError(f"{target}: a certificate is a .json file; name one")
    return _schedule(arguments) if statement == "schedule" else _game(arguments)


def _check(arguments: argparse.Namespace) -> int:
    from verification.proof.checker.checker import check_certificate
    from verification.proof.search.proof_report import checked_report

    if arguments.statement is not None:
        raise BadInputError("--check verifies a certificate as it is; leave the statement out")
    of_certificate = (
        *trims.OF_THE_TRIM,
        "parameters",
        "rate",
        "resume",
        "basis",
        "model",
        "bandwidth",
    )
    trims.refuse(
        arguments,
        of_certificate,
        "does not go with --check: the certificate says which aircraft it is about",
    )
    # The output is not signed with the aircraft of the trims.
    del arguments.parameters
    found = check_certificate(arguments.check, ProgressLine("check"), arguments.aircraft)
    _require_same(found, arguments)
    report = checked_report(found)
    show(report, arguments)
    return 0 if report.data["proved"] else 1


def _require_same(found: Verified, arguments: argparse.Namespace) -> None:
    """Bind the certificate to the user's own data: --dihedral, --weights, --delta, --Q, --R must be
    what it states."""
    from verification.proof.search.proof_report import require_same

    claim, own = found.statement, dict[str, Any]()
    if ends := arguments.at:
        require_same(claim, {"range": ends * (2 // len(ends))}, "--at")
    for name, value in games.weights_of(arguments).items():
        require_same(claim.get("game", {}), {name: value}, f"--{name}")
    if arguments.weights is None:
        return
    if found.kind == "game":
        of = found.model
        plant = PlantNames(of.linear, tuple(of.inputs), of.units(of.linear)) if of else UNNAMED
        from controller.critic.critic_file import stored_parts

        functions = basis("quadratic", len(claim["game"]["Q"]))
        own = dict(stored_parts(arguments.weights, plant, functions))
        if "W" in own:
            own["W"] = own["W"][:, None]
    else:
        assert found.model is not None
        actuators = claim.get("actuators") or {}
        uncertain = {name: actuators[name] for name in _INTERVALS if actuators}
        table = _table(arguments, found.model, claim["imposed"].get("speed", 0.0), uncertain)
        own = {
            key: getattr(table, key)
            for key in ("places", *"KMNX"[: 4 if found.kind == "schedule" else 1])
        }
        if table.actuators is not None:
            require_same(actuators, vars(table.actuators), f"--weights {arguments.weights}")
    require_same(claim["table"], own, f"--weights {arguments.weights}")


def _table(
    arguments: argparse.Namespace, of: Model, speed: float, uncertain: dict[str, Any]
) -> LoopTable:
    """The gains of --weights; with --design a controller with memory on its actuators. speed: of
    the trims, ft/s."""
    from verification.proof.search.scheduled_loop import LoopTable, servo_table

    if arguments.design is not None:
        controller = load_controller(arguments.weights, of)
        return servo_table(controller, arguments.design.of(of).actuators, speed, of, **uncertain)
    table = LoopTable.of(load_gains(arguments.weights, of))
    return table.through(**uncertain) if uncertain else table


def _schedule(arguments: argparse.Namespace) -> int:
    from verification.proof.search.certificate import CertificateFile
    from verification.proof.search.schedule_proof import prove_schedule
    from verification.proof.search.scheduled_loop import exact_gains

    if arguments.resume and arguments.output is None:
        raise BadInputError("--resume needs the certificate to go on with; add -o FILE.json")
    uncertain = {
        name: value for name in _INTERVALS if (value := getattr(arguments, name)) is not None
    }
    if arguments.bandwidth is None:
        trims.refuse(arguments, _INTERVALS, "is of actuators: give --bandwidth LOW:HIGH too, rad/s")
    elif arguments.rate:
        raise BadInputError("--rate does not go with --bandwidth; leave one out")
    family = _family(arguments, arguments.error)
    low, high = _ends(arguments, family)
    if arguments.weights is not None:
        trims.refuse(
            arguments,
            ("delta", "Q", "R"),
            "does not go with --weights, which gives the gains; leave it out",
        )
        table = _table(
            arguments, family.model, family.condition(low).imposed.get("speed", 0.0), uncertain
        )
    else:
        trims.refuse(
            arguments, ("design",), "goes with a controller; name its file by --weights FILE.npz"
        )
        changes = games.weights_of(arguments, family.model.units(family.model.linear))
        table = exact_gains(family, low, high, uncertain, **changes)
    place, progress = arguments.output, ProgressLine("prove")
    file = (
        None
        if place is None
        else CertificateFile(place, provenance(arguments), resume=arguments.resume)
    )
    proof = prove_schedule(
        family, table, low, high, moving=arguments.rate, file=file, progress=progress
    )
    show(proof.report(), arguments, written=True)
    return 0 if proof.proved else 1


def _game(arguments: argparse.Namespace) -> int:
    """`solution` and `critic`: of the model at one place, or of a plant of the user's own."""
    from verification.proof.search.proof_report import game_report
    from verification.proof.search.solution_proof import prove_critic, prove_solution

    critic, typed = arguments.statement == "critic", arguments.at
    if critic and arguments.file is None:
        raise BadInputError("name the file of the critic: `hfa prove critic FILE --dihedral DEG`")
    if typed is not None and len(typed) != 1:
        raise BadInputError(f"a game is at one place; give --{trims.called_at()} with one value")
    if typed is not None:  # from here on as in the commands of one trim
        arguments.at = math.radians(typed[0]) if model().schedule_unit == "deg" else typed[0]
    named, of = games.game_of(arguments), tuple[Any, ...]()
    if arguments.model is None:
        family = _family(arguments)
        start = family.model.signals[family.over].start if family.over else 0.0
        value = {**family.model.trim, **arguments.hold}.get(family.over, start)
        place = typed[0] if typed else math.degrees(value) if family.unit == "deg" else value
        family.check(place, place)
        of = (family, place)
    if critic:
        from controller.critic.critic_file import Reading, critic_in

        stored = critic_in(arguments.file, named.game, named.plant, Reading(arguments.basis))
        with said_of(arguments.file):
            proof = prove_critic(named.game, stored, *of)
    else:
        proof = prove_solution(named.game, *of)
    if arguments.output is not None and proof.proved:
        proof.write(arguments.output, provenance(arguments))
    show(
        game_report(proof.data, named.states, named.origin, str(arguments.file or "")),
        arguments,
        written=True,
    )
    return 0 if proof.proved else 1


def _family(arguments: argparse.Namespace, errors: float = 0.0) -> Family:
    """The aircraft and the flights that the options name; the scheduling variable is left.

    errors: every identified parameter may be off by this many of its standard errors.
    """
    from verification.proof.enclosures.trim_branch import Family

    known = {} if OWN.get() is not None else trims.parameters_of(arguments).standard_errors
    if errors and not known:
        raise BadInputError("the parameters have no standard errors; leave --error out")
    spread = {name: errors * error for name, error in known.items() if errors * error > 0.0}
    return Family(trims.aircraft_of(arguments), trims.flights_of(arguments), spread)


def _ends(arguments: argparse.Namespace, family: Family) -> tuple[float, float]:
    """LOW:HIGH of --at, in places; refused where no trim can be."""
    if len(arguments.at or ()) != 2:
        raise BadInputError(
            f"give the interval of {family.over or 'the scheduling variable'} as --{trims.called_at()} LOW:HIGH"
        )
    family.check(*arguments.at)
    low, high = arguments.at
    return low, high


def _grid() -> Options:
    limit = Option("of the interpolation, relative; default 1e-3", "X", positive, 1e-3)
    return {**_trims("LOW:HIGH"), "--limit-error": limit, **trims.output()}


@command(_grid)
def lpv(arguments: argparse.Namespace) -> int:
    """Linear models on the coarsest grid of dihedrals whose interpolation error is proved below a
    tolerance.

    The error of A, B, the trimmed inputs and the exact game's gain K is bounded at every angle
    between the nodes, in ball arithmetic. -o FILE.json writes a certificate that `hfa prove
    --check` verifies, .npz, .mat and .csv the matrices. Needs python-flint (`pip install
    .[proof]`)."""
    from verification.proof.arithmetic import flint_or_refusal
    from verification.proof.search.lpv_grid import coarsest_grid

    flint_or_refusal()
    trims.refuse(arguments, ("start",), "belongs to a single trim; leave it out")
    family, target = _family(arguments), arguments.output
    proof = coarsest_grid(
        family, *_ends(arguments, family), arguments.limit_error, progress=ProgressLine("lpv")
    )
    certified = target is not None and target.suffix.lower() == ".json"
    if certified:
        proof.write(target, provenance(arguments))
    show(proof.report(), arguments, written=certified)
    return 0
