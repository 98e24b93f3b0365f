"""Statements with a proof in ball arithmetic, for every angle of an interval and not for the points of a grid.

schedule: at every dihedral of LOW:HIGH the trim exists within its limits and the scheduled gain makes the loop Hurwitz.
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

import numpy as np

from controller.design.design import load_design
from controller.design.scheduled_controller import load_controller
from controller.policy.gain_table import GainTable, load_gains
from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import input_file, number, parsed
from hfa_cli.options.games import MATRIX_FILES, NamedGame, add_weights, game_of, weights_of
from hfa_cli.options.parser import add_value
from hfa_cli.origin import provenance
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine
from hfa_model.vectors import INPUTS, LINEAR_STATES, LINEAR_UNITS
from hfa_support.errors import BadInputError, said_of

if TYPE_CHECKING:
    from verification.checker.checker import Verified
    from verification.enclosures.trim_branch import Family

#: Statement -> options that do not belong to it.
STATEMENTS = {
    "schedule": ("start", "basis", "model", "delta", "Q", "R"),
    "solution": ("design", "basis", "weights", "resume", "rate", "error"),
    "critic": ("design", "weights", "resume", "rate", "error"),
}
#: Angle between two gains of our own table, deg.
_STEP = 2.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa prove`."""
    parser.add_argument("statement", nargs="?", choices=tuple(STATEMENTS), help="what to prove")
    about = f"of `critic`: W, P or K ({' '.join(MATRIX_FILES)})"
    parser.add_argument("file", nargs="?", metavar="FILE", type=input_file(*MATRIX_FILES), help=about)
    add_value(parser, "--basis", str, "NAME", "of the W of `critic`; default quadratic")
    add_value(parser, "--check", input_file(".json"), "FILE", "verify a certificate instead of proving")
    about = "gains K over dihedral_deg; default: the exact game's"
    add_value(parser, "--weights", input_file(*MATRIX_FILES), "FILE", about)
    about = "of `schedule`: --weights is a controller with memory, on the actuators of this design"
    add_value(parser, "--design", parsed(load_design), "NAME", about)
    parser.add_argument("--rate", action="store_true", help="of `schedule`: also how fast the dihedral may move")
    about = "of `schedule`: for all parameters within N standard errors; default 0"
    add_value(parser, "--error", _not_negative, "N", about, default=0.0)
    parser.add_argument("--resume", action="store_true", help="go on with the unfinished certificate that -o names")
    options.add_flights(parser, "DEG|LOW:HIGH")
    about = "a plant of your own: A, B, optionally E, Q, R"
    add_value(parser, "--model", input_file(*MATRIX_FILES), "FILE", about)
    add_weights(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Prove or check, and report."""
    from verification.arithmetic import flint_or_refusal

    flint_or_refusal()
    if arguments.check is not None:
        return _check(arguments)
    if arguments.statement is None:
        raise BadInputError(f"say what to prove, one of {', '.join(STATEMENTS)}, or --check FILE")
    unused = tuple(name for name in STATEMENTS[arguments.statement] if getattr(arguments, name) not in (0.0, False))
    options.refuse(arguments, unused, f"does not go with `hfa prove {arguments.statement}`; leave it out")
    if arguments.file is not None and arguments.statement != "critic":
        raise BadInputError("a FILE goes with `hfa prove critic` alone; leave it out")
    return {"schedule": _schedule, "solution": _solution, "critic": _critic}[arguments.statement](arguments)


def _not_negative(text: str) -> float:
    value = number(text)
    if value < 0.0:
        raise ArgumentTypeError(f"is {value:g}; it must not be negative")
    return value


def _check(arguments: argparse.Namespace) -> int:
    from verification.checker.checker import check_certificate
    from verification.proof.proof_report import checked_report

    if arguments.statement is not None:
        raise BadInputError("--check verifies a certificate as it is; leave the statement out")
    of_certificate = (*options.OF_THE_TRIM, "parameters", "rate", "resume", "basis", "model")
    options.refuse(
        arguments, of_certificate, "does not go with --check: the certificate says which aircraft it is about"
    )
    # The output is not signed with the aircraft of the options.
    del arguments.parameters
    found = check_certificate(arguments.check, ProgressLine("check"))
    _require_same(found, arguments)
    report = checked_report(found)
    show(report, arguments, target=arguments.output)
    return 0 if report.data["proved"] else 1


def _require_same(found: Verified, arguments: argparse.Namespace) -> None:
    """Bind the certificate to the user's own data: --dihedral, --weights, --delta, --Q, --R must be what it states."""
    from controller.game.array_file import UNNAMED, PlantNames
    from controller.game.basis import basis
    from controller.game.critic_file import load_critic
    from verification.proof.proof_report import require_same

    if arguments.dihedral is not None:
        ends = arguments.dihedral * (2 // len(arguments.dihedral))
        require_same(found.statement, {"dihedral_deg": ends}, "--dihedral")
    for name, value in weights_of(arguments).items():
        require_same(found.statement.get("game", {}), {name: value}, f"--{name}")
    if arguments.weights is None:
        return
    claim, own = found.statement, dict[str, Any]()
    if found.kind == "game":
        plant = PlantNames(LINEAR_STATES, INPUTS, LINEAR_UNITS) if "imposed" in claim else UNNAMED
        stored = load_critic(arguments.weights, plant, basis("quadratic", len(claim["game"]["Q"])))
        own = {key: value for key, value in stored._asdict().items() if value is not None}
        own |= {"W": own["W"][:, None]} if "W" in own else {}
    else:
        table = _given_table(arguments, claim["imposed"]["speed"])
        own = {key: getattr(table, key) for key in ("dihedral_deg", *"KMNX"[: 4 if found.kind == "schedule" else 1])}
    require_same(claim["table"], own, f"--weights {arguments.weights}")


def _certificate(arguments: argparse.Namespace) -> Path | None:
    """The file of -o; of a proof it is a certificate, whatever it says is printed."""
    target: Path | None = arguments.output
    if target is not None and target.suffix.lower() != ".json":
        raise BadInputError(f"{target}: a certificate is a .json file; name one")
    return target


def _schedule(arguments: argparse.Namespace) -> int:
    from verification.proof.certificate_file import ScheduleCertificate
    from verification.proof.proof_report import schedule_proof_report
    from verification.proof.rate_proof import prove_rate
    from verification.proof.schedule_proof import prove_schedule

    target = _certificate(arguments)
    if arguments.resume and target is None:
        raise BadInputError("--resume needs the certificate to go on with; add -o FILE.json")
    family = options.family_of(arguments, arguments.error)
    low, high = options.interval_of(arguments, family)
    file = ScheduleCertificate(family, _table(arguments, family, low, high), low, high, target, provenance())
    result = prove_schedule(
        family,
        file.table,
        low,
        high,
        known=file.known() if arguments.resume else None,
        save=file.save,
        progress=ProgressLine("prove"),
    )
    motion = prove_rate(family, file.table, low, high, progress=ProgressLine("rate")) if arguments.rate else None
    file.finish(result, motion)
    show(schedule_proof_report(result, motion), arguments, target=None)
    return 0 if result.proved and (motion is None or motion.rate > 0.0) else 1


def _solution(arguments: argparse.Namespace) -> int:
    from verification.proof.certificate_file import write_certificate
    from verification.proof.proof_report import solution_proof_report
    from verification.proof.solution_proof import prove_solution, solution_claim

    target = _certificate(arguments)
    named, family, degrees = _game(arguments)
    proof = prove_solution(named.game, family, degrees)
    if target is not None and proof.proved:
        write_certificate(target, provenance(), "game", *solution_claim(proof))
    show(solution_proof_report(proof, named.states, named.origin), arguments, target=None)
    return 0 if proof.proved else 1


def _critic(arguments: argparse.Namespace) -> int:
    from controller.game.basis import basis
    from controller.game.critic_file import load_critic
    from verification.proof.certificate_file import write_certificate
    from verification.proof.proof_report import critic_proof_report
    from verification.proof.solution_proof import critic_claim, prove_critic

    if arguments.file is None:
        raise BadInputError("name the file of the critic: `hfa prove critic FILE --dihedral DEG`")
    target = _certificate(arguments)
    named, family, degrees = _game(arguments)
    functions = basis(arguments.basis or "quadratic", len(named.game.A))
    stored = load_critic(arguments.file, named.plant, functions)
    with said_of(arguments.file):
        proof = prove_critic(named.game, stored, functions, family, degrees)
    if target is not None:
        write_certificate(target, provenance(), "game", *critic_claim(proof))
    show(critic_proof_report(proof, str(arguments.file), named.origin), arguments, target=None)
    return 0


def _game(arguments: argparse.Namespace) -> tuple[NamedGame, Family | None, float | None]:
    """The game that the options name, with its flights and dihedral (deg) unless it is a plant of a file."""
    degrees = options.at_one_angle(arguments)
    named = game_of(arguments)
    if arguments.model is not None or degrees is None:
        return named, None, None
    family = options.family_of(arguments)
    family.check(degrees, degrees)
    return named, family, degrees


def _given_table(arguments: argparse.Namespace, speed: float) -> GainTable:
    """The gains of --weights; with --design a controller with memory on its actuators. speed: of the trims, ft/s."""
    from verification.proof.scheduled_loop import servo_table

    if arguments.design is not None:
        return servo_table(load_controller(arguments.weights), arguments.design.actuators, speed)
    return load_gains(arguments.weights)


def _table(arguments: argparse.Namespace, family: Family, low: float, high: float) -> GainTable:
    from verification.flights.scheduling import certified_schedule

    if arguments.design is not None and arguments.weights is None:
        raise BadInputError("--design goes with a controller; name its file by --weights FILE.npz")
    if arguments.weights is not None:
        return _given_table(arguments, family.condition(low).imposed["speed"])
    angles = np.linspace(low, high, max(2, math.ceil((high - low) / _STEP) + 1))
    made = certified_schedule(
        family.aircraft, np.radians(angles), condition=lambda dihedral: family.condition(math.degrees(dihedral))
    )
    return GainTable(angles, made.gains.values)
