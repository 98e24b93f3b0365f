"""Statements with a proof in ball arithmetic, for every angle of an interval and not for the points of a grid.

schedule: at every dihedral of LOW:HIGH the trim exists within its limits and the scheduled gain makes the loop Hurwitz,
with --bandwidth through all actuators of intervals, also delayed and of less effect.
solution: the game has one stabilizing solution within a radius of P, which is its value; with a bracket of delta_min.
critic FILE: the distance of W, P or K in a file from the exact solution, from below and from above.
-o FILE.json writes a certificate; --check FILE verifies it, by other means than it was made with.
Exit 0: proved. Exit 1: refuted, or left open. Needs python-flint (`pip install .[proof]`).
"""

from __future__ import annotations

import argparse
import math
from argparse import ArgumentTypeError
from pathlib import Path
from typing import TYPE_CHECKING, Any

from controller.design.scheduled_controller import load_controller
from controller.policy.gain_table import load_gains
from hfa_cli.options import games, trims
from hfa_cli.options.argument_types import input_file, number, one_of, places
from hfa_cli.options.games import NamedGame
from hfa_cli.options.parser import Option, Options
from hfa_cli.output import ProgressLine, provenance, show
from hfa_support.errors import BadInputError, said_of
from hfa_support.files import MATRIX_FILES
from hfa_support.model import Model

if TYPE_CHECKING:
    from verification.checker.checker import Verified
    from verification.enclosures.trim_branch import Family
    from verification.proof.scheduled_loop import LoopTable

#: Statement -> options that do not belong to it.
_SCHEDULES = ("design", "weights", "resume", "rate", "error", "bandwidth", "effectiveness", "delay")
STATEMENTS = {
    "schedule": ("start", "basis", "model", "file"),
    "solution": ("basis", "file", *_SCHEDULES),
    "critic": _SCHEDULES,
}


def options() -> Options:
    """Of `hfa prove`."""
    matrices, optional = input_file(*MATRIX_FILES), {"nargs": "?"}
    design = "of `schedule`: --weights is a controller with memory, on the actuators of this design"
    error = "of `schedule`: for all parameters within N standard errors; default 0"
    effectiveness = "with --bandwidth: share of each command that arrives, changing at any time; default 1"
    delay = "with --bandwidth: each command is late by up to S seconds, changing at any time; default 0"
    of_schedule: Options = {
        "--weights": Option("gains K over dihedral_deg; default: the exact game's", "FILE", matrices),
        **trims.design(design),
        "--rate": Option("of `schedule`: also how fast the dihedral may move"),
        "--error": Option(error, "N", _not_negative, more={"default": 0.0}),
        "--bandwidth": Option("of `schedule`: through actuators of any bandwidth, rad/s", "LOW:HIGH", _interval),
        "--effectiveness": Option(effectiveness, "LOW:HIGH", _interval),
        "--delay": Option(delay, "S", _not_negative),
        "--resume": Option("go on with the unfinished certificate that -o names"),
    }
    return {
        "statement": Option(f"what to prove: {', '.join(STATEMENTS)}", "STATEMENT", one_of(*STATEMENTS), more=optional),
        "file": Option(f"of `critic`: W, P or K ({' '.join(MATRIX_FILES)})", "FILE", matrices, more=optional),
        "--basis": Option("of the W of `critic`; default quadratic", "NAME"),
        "--check": Option("verify a certificate instead of proving", "FILE", input_file(".json")),
        **of_schedule,
        **trims.proved_trims("DEG|LOW:HIGH"),
        **games.MODEL,
        **games.WEIGHTS,
        **trims.output(),
    }


def run(arguments: argparse.Namespace) -> int:
    """Prove or check, and report."""
    from verification.arithmetic import flint_or_refusal

    flint_or_refusal()
    if arguments.check is not None:
        return _check(arguments)
    if arguments.statement is None:
        raise BadInputError(f"say what to prove, one of {', '.join(STATEMENTS)}, or --check FILE")
    unused = tuple(name for name in STATEMENTS[arguments.statement] if getattr(arguments, name) != 0.0)
    trims.refuse(arguments, unused, f"does not go with `hfa prove {arguments.statement}`; leave it out")
    return {"schedule": _schedule, "solution": _solution, "critic": _critic}[arguments.statement](arguments)


def _not_negative(text: str) -> float:
    value = number(text)
    if value < 0.0:
        raise ArgumentTypeError(f"is {value:g}; it must not be negative")
    return value


def _interval(text: str) -> tuple[float, float]:
    ends = places(text)
    if not ends[0] > 0.0:
        raise ArgumentTypeError(f"is {text}; it must be positive")
    return ends[0], ends[-1]


def _check(arguments: argparse.Namespace) -> int:
    from verification.checker.checker import check_certificate
    from verification.proof.proof_report import checked_report

    if arguments.statement is not None:
        raise BadInputError("--check verifies a certificate as it is; leave the statement out")
    of_certificate = (*trims.OF_THE_TRIM, "parameters", "rate", "resume", "basis", "model", "bandwidth")
    trims.refuse(arguments, of_certificate, "does not go with --check: the certificate says which aircraft it is about")
    # The output is not signed with the aircraft of the trims.
    del arguments.parameters
    found = check_certificate(arguments.check, ProgressLine("check"), arguments.aircraft)
    _require_same(found, arguments)
    report = checked_report(found)
    show(report, arguments, target=arguments.output)
    return 0 if report.data["proved"] else 1


def _require_same(found: Verified, arguments: argparse.Namespace) -> None:
    """Bind the certificate to the user's own data: --dihedral, --weights, --delta, --Q, --R must be what it states."""
    from controller.game.basis import basis
    from controller.game.user_files import UNNAMED, PlantNames, load_critic
    from verification.proof.proof_report import require_same

    if ends := arguments.at:
        require_same(found.statement, {"range": ends * (2 // len(ends))}, "--at")
    for name, value in games.weights_of(arguments).items():
        require_same(found.statement.get("game", {}), {name: value}, f"--{name}")
    if arguments.weights is None:
        return
    claim, own = found.statement, dict[str, Any]()
    if found.kind == "game":
        model = found.model
        plant = PlantNames(model.linear, tuple(model.inputs), model.units(model.linear)) if model else UNNAMED
        stored = load_critic(arguments.weights, plant, basis("quadratic", len(claim["game"]["Q"])))
        own = {key: value for key, value in stored._asdict().items() if value is not None}
        own |= {"W": own["W"][:, None]} if "W" in own else {}
    else:
        assert found.model is not None
        table = _given_table(
            arguments, found.model, claim["imposed"].get("speed", 0.0), _uncertain(claim.get("actuators"))
        )
        own = {key: getattr(table, key) for key in ("places", *"KMNX"[: 4 if found.kind == "schedule" else 1])}
        if table.actuators is not None:
            require_same(claim["actuators"], vars(table.actuators), f"--weights {arguments.weights}")
    require_same(claim["table"], own, f"--weights {arguments.weights}")


def _certificate(arguments: argparse.Namespace) -> Path | None:
    """The file of -o; of a proof it is a certificate, whatever it says is printed."""
    target: Path | None = arguments.output
    if target is not None and target.suffix.lower() != ".json":
        raise BadInputError(f"{target}: a certificate is a .json file; name one")
    return target


def _schedule(arguments: argparse.Namespace) -> int:
    from verification.proof.certificate import CertificateFile
    from verification.proof.schedule_proof import prove_schedule

    target = _certificate(arguments)
    if arguments.resume and target is None:
        raise BadInputError("--resume needs the certificate to go on with; add -o FILE.json")
    family = trims.family_of(arguments, arguments.error)
    low, high = trims.interval_of(arguments, family)
    table = _table(arguments, family, low, high)
    file = None if target is None else CertificateFile(target, provenance(), resume=arguments.resume)
    progress = ProgressLine("prove")
    proof = prove_schedule(family, table, low, high, moving=arguments.rate, file=file, progress=progress)
    show(proof.report(), arguments, target=None)
    return 0 if proof.proved else 1


def _solution(arguments: argparse.Namespace) -> int:
    from verification.proof.proof_report import game_report
    from verification.proof.solution_proof import prove_solution

    target = _certificate(arguments)
    named, family, degrees = _game(arguments)
    proof = prove_solution(named.game, family, degrees)
    if target is not None and proof.proved:
        proof.write(target, provenance())
    show(game_report(proof, named.states, named.origin), arguments, target=None)
    return 0 if proof.proved else 1


def _critic(arguments: argparse.Namespace) -> int:
    from controller.game.basis import basis
    from controller.game.user_files import load_critic
    from verification.proof.proof_report import game_report
    from verification.proof.solution_proof import prove_critic

    if arguments.file is None:
        raise BadInputError("name the file of the critic: `hfa prove critic FILE --dihedral DEG`")
    target = _certificate(arguments)
    named, family, degrees = _game(arguments)
    functions = basis(arguments.basis or "quadratic", len(named.game.A))
    stored = load_critic(arguments.file, named.plant, functions)
    with said_of(arguments.file):
        proof = prove_critic(named.game, stored, functions, family, degrees)
    if target is not None:
        proof.write(target, provenance())
    show(game_report(proof, named.states, named.origin, str(arguments.file)), arguments, target=None)
    return 0


def _game(arguments: argparse.Namespace) -> tuple[NamedGame, Family | None, float | None]:
    """The game that the options name, with its flights and their place unless it is a plant of a file."""
    place, named = trims.at_one_place(arguments), games.game_of(arguments)
    if arguments.model is not None:
        return named, None, None
    family = trims.family_of(arguments)
    if place is None:
        start = family.model.signals[family.over].start if family.over else 0.0
        value = {**family.model.trim, **(arguments.hold or {})}.get(family.over, start)
        place = math.degrees(value) if family.unit == "deg" else value
    family.check(place, place)
    return named, family, place


def _given_table(arguments: argparse.Namespace, model: Model, speed: float, uncertain: dict[str, Any]) -> LoopTable:
    """The gains of --weights; with --design a controller with memory on its actuators. speed: of the trims, ft/s."""
    from verification.proof.scheduled_loop import LoopTable, servo_table

    if arguments.design is not None:
        controller = load_controller(arguments.weights, model)
        return servo_table(controller, arguments.design.of(model).actuators, speed, model, **uncertain)
    table = LoopTable.of(load_gains(arguments.weights, model))
    return table.through(**uncertain) if uncertain else table


def _uncertain(actuators: Any) -> dict[str, Any]:
    """The intervals of actuators, of the options or of a certificate."""
    if isinstance(actuators, argparse.Namespace):
        given = {name: getattr(actuators, name) for name in ("bandwidth", "effectiveness", "delay")}
        if given["bandwidth"] is None:
            trims.refuse(actuators, ("effectiveness", "delay"), "is of actuators: give --bandwidth LOW:HIGH too, rad/s")
        elif actuators.rate:
            raise BadInputError("--rate does not go with --bandwidth; leave one out")
        return {name: value for name, value in given.items() if value is not None}
    return {name: actuators[name] for name in ("bandwidth", "effectiveness", "delay")} if actuators else {}


def _table(arguments: argparse.Namespace, family: Family, low: float, high: float) -> LoopTable:
    from verification.proof.scheduled_loop import exact_gains

    if arguments.design is not None and arguments.weights is None:
        raise BadInputError("--design goes with a controller; name its file by --weights FILE.npz")
    uncertain, changes = _uncertain(arguments), games.weights_of(arguments, family.model.units(family.model.linear))
    if arguments.weights is not None:
        if changes:
            raise BadInputError("--weights gives the gains; leave --delta, --Q and --R out")
        speed = family.condition(low).imposed.get("speed", 0.0)
        return _given_table(arguments, family.model, speed, uncertain)
    return exact_gains(family, low, high, uncertain, **changes)
