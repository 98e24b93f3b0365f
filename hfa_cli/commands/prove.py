"""Statements with a proof in ball arithmetic, for every angle of an interval and not for the points of a grid.

schedule: at every dihedral of LOW:HIGH the trim exists within its limits and the scheduled gain makes the loop Hurwitz.
solution: the game has one stabilizing solution within a radius of P, which is its value; with a bracket of delta_min.
critic FILE: the distance of W, P or K in a file from the exact solution, from below and from above.
--check FILE verifies a certificate that `hfa prove schedule -o FILE` wrote, by other means than it was made with.
Exit 0: proved. Exit 1: refuted, or left open. Needs python-flint (`pip install .[proof]`).
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hfa_cli import options
from hfa_cli.flight_family import family_of, interval_of
from hfa_cli.games import add_game, game_of
from hfa_cli.output import Progress, check_target, show
from hfa_cli.values import number
from hfa_model.support.errors import BadInputError

if TYPE_CHECKING:
    from verification.proof.gain_table import GainTable
    from verification.proof.trim_branch import Family

STATEMENTS = ("schedule", "solution", "critic")
#: Angle between two gains of our own table, deg.
_STEP = 2.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa prove`."""
    parser.add_argument("statement", nargs="?", choices=STATEMENTS, help="what to prove")
    parser.add_argument("file", nargs="?", metavar="FILE", help="of `critic`: W, P or K (.npz .mat .json)")
    parser.add_argument("--basis", metavar="NAME", help="of the W of `critic`; default quadratic")
    parser.add_argument("--check", metavar="FILE", help="verify a certificate instead of proving")
    parser.add_argument(
        "--table", metavar="FILE", help="gains K over dihedral_deg (.npz, .json); default: the exact game's"
    )
    parser.add_argument("--rate", action="store_true", help="of `schedule`: also how fast the dihedral may move")
    parser.add_argument(
        "--errors", metavar="N", help="of `schedule`: for all parameters within N standard errors; default 0"
    )
    parser.add_argument("--resume", action="store_true", help="go on with the unfinished certificate that -o names")
    add_game(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Prove or check, and report."""
    from verification.proof.balls import flint_or_refusal

    flint_or_refusal()
    if arguments.check is not None:
        return _check(arguments)
    if arguments.statement is None:
        raise BadInputError(f"say what to prove, one of {', '.join(STATEMENTS)}, or --check FILE")
    _refuse_what_is_not_asked(arguments)
    return {"schedule": _schedule, "solution": _solution, "critic": _critic}[arguments.statement](arguments)


def _check(arguments: argparse.Namespace) -> int:
    from verification.proof.checker import check_certificate
    from verification.proof.proof_report import checked_report

    if arguments.statement is not None:
        raise BadInputError("--check verifies a certificate as it is; leave the statement out")
    found = check_certificate(Path(arguments.check), Progress("check"))
    show(checked_report(found), as_json=arguments.json, target=check_target(arguments.output))
    return 0 if found.proved else 1


def _schedule(arguments: argparse.Namespace) -> int:
    from verification.proof.certificate_file import Certificate
    from verification.proof.proof_report import schedule_report
    from verification.proof.rate_proof import prove_rate
    from verification.proof.schedule_proof import prove_schedule

    target = check_target(arguments.output, (".json",))
    if arguments.resume and target is None:
        raise BadInputError("--resume needs the certificate to go on with; add -o FILE.json")
    errors = 0.0 if arguments.errors is None else number(arguments.errors, "--errors")
    if errors < 0.0:
        raise BadInputError(f"--errors is {errors:g}; it must not be negative")
    if errors and target is not None:
        raise BadInputError("a proof with --errors has no certificate yet; leave -o out")
    family = family_of(arguments, errors)
    low, high = interval_of(arguments, family)
    file = Certificate(family, _table(arguments, family, low, high), low, high, target)
    result = prove_schedule(
        family,
        file.table,
        low,
        high,
        known=file.known() if arguments.resume else None,
        save=file.save,
        progress=Progress("prove"),
    )
    file.save(result.loop, result.modes, finished=True)
    motion = prove_rate(family, file.table, low, high, progress=Progress("rate")) if arguments.rate else None
    show(schedule_report(result, motion), as_json=arguments.json, target=None)
    return 0 if result.proved and (motion is None or motion.rate > 0.0) else 1


def _solution(arguments: argparse.Namespace) -> int:
    from verification.proof.game_proof_report import solution_proof_report
    from verification.proof.solution_proof import prove_solution

    target = check_target(arguments.output)
    named = game_of(arguments)
    proof = prove_solution(named.game, *_place(arguments))
    show(solution_proof_report(proof, named.states, named.origin), as_json=arguments.json, target=target)
    return 0 if proof.proved else 1


def _critic(arguments: argparse.Namespace) -> int:
    from controller.game.basis import basis
    from controller.game.model_file import load_critic
    from verification.proof.game_proof_report import critic_proof_report
    from verification.proof.solution_proof import prove_critic

    target = check_target(arguments.output)
    if arguments.file is None:
        raise BadInputError("name the file of the critic: `hfa prove critic FILE --dihedral DEG`")
    named, stored = game_of(arguments), load_critic(arguments.file)
    functions = basis(arguments.basis or "quadratic", len(named.game.A))
    try:
        proof = prove_critic(named.game, stored, functions, *_place(arguments))
    except BadInputError as error:
        raise BadInputError(f"{arguments.file}: {error}") from error
    show(critic_proof_report(proof, arguments.file, named.origin), as_json=arguments.json, target=target)
    return 0


def _place(arguments: argparse.Namespace) -> tuple[Family | None, float | None]:
    """The flights and the dihedral, deg, of the game; neither for a plant of a file."""
    if arguments.model is not None:
        return None, None
    return family_of(arguments), number(arguments.dihedral, "dihedral")


def _refuse_what_is_not_asked(arguments: argparse.Namespace) -> None:
    """An option that would change nothing is a mistake."""
    others = {
        "schedule": ("file", "basis", "model", "delta", "Q", "R"),
        "solution": ("file", "basis", "table", "resume", "rate", "errors"),
        "critic": ("table", "resume", "rate", "errors"),
    }
    given = [name for name in others[arguments.statement] if options.given(arguments, name)]
    if given:
        raise BadInputError(f"{given[0]} does not go with `hfa prove {arguments.statement}`; leave it out")


def _table(arguments: argparse.Namespace, family: Family, low: float, high: float) -> GainTable:
    from verification.flights.scheduling import certified_schedule
    from verification.proof.gain_table import GainTable, load_table

    if arguments.table is not None:
        return load_table(Path(arguments.table))
    angles = np.linspace(low, high, max(2, math.ceil((high - low) / _STEP) + 1))
    made = certified_schedule(
        family.aircraft, np.radians(angles), condition=lambda dihedral: family.condition(math.degrees(dihedral))
    )
    return GainTable(angles, made.schedule.gains)
