"""The commands `hfa prove solution` and `hfa prove critic`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import input_file
from hfa.options.game import GameGiven, NamedGame
from hfa.options.output import ProgressLine
from hfa.options.part import option, part
from hfa.options.request import Request, command
from hfa.options.trim import Trim, called_at, scheduled
from hfa_prove.commands.options import family_of, interval_of, refuse_no_certificate
from hfa_support.errors import BadInputError, prefix_errors
from hfa_support.files import MATRIX_FILES

if TYPE_CHECKING:
    from hfa_prove.search.family import Family
    from hfa_prove.search.proof import Proof


class Stated(NamedTuple):
    """The game about which a statement is proved.

    request: options of the command
    named: the game
    family: aircraft and its trims, or None for a plant from a file
    value: scheduling value in the unit of the option, by default that of the model's trim, or None
        for a plant from a file
    """

    request: SolutionRequest
    named: NamedGame
    family: Family | None = None
    value: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class SolutionRequest(Request):
    """Options of `hfa prove solution`."""

    aircraft: Aircraft = part(Aircraft, without=("units",))
    trim: Trim = part(Trim, at=scheduled(interval_of, "DEG", "taken as an exact decimal number"))
    game: GameGiven = part(GameGiven)

    def subject(self) -> Stated:
        """Return the game that the options define.

        Raises BadInputError if several scheduling values are given, or if the trim has properties
        that proofs do not support.
        """
        typed = self.trim.at
        trim = self.trim
        if typed is not None and len(typed) != 1:
            raise BadInputError(
                f"a game is defined at one value of {self.model.schedule}; give "
                f"--{called_at(self.model)} with one value"
            )
        if typed is not None:  # the other commands of one trim store the value in the model's unit
            in_degrees = self.model.schedule_unit == "deg"
            trim = replace(trim, at=math.radians(typed[0]) if in_degrees else typed[0])
        named = self.game.game(self.aircraft, trim)
        request = replace(self, trim=trim)
        if self.game.plant is not None:
            return Stated(request, named)
        family = family_of(self.aircraft, trim)
        family.require_schedule()
        model = family.model
        start = model.signals[model.schedule].start
        value = {**model.trim, **trim.hold}.get(model.schedule, start)
        if typed:
            value = typed[0]
        elif model.schedule_unit == "deg":
            value = math.degrees(value)
        family.check(value, value)
        return Stated(request, named, family, value)


@dataclass(frozen=True, kw_only=True, eq=False)
class CriticRequest(SolutionRequest):
    """Options of `hfa prove critic`."""

    file: Path = option(
        f"file with a critic: W, P or K ({' '.join(MATRIX_FILES)})",
        "FILE",
        input_file(*MATRIX_FILES),
        names="file",
        required=True,
    )
    basis: str = option(
        "basis functions of W; default quadratic", "NAME", default="quadratic", rare=True
    )


@command(SolutionRequest)
def solution(request: SolutionRequest) -> int:
    """Prove that the game has one stabilizing solution within a radius of P, and bracket delta_min.

    The proof uses ball arithmetic. delta_min is the smallest delta for which the game has a
    solution. -o FILE.json writes a certificate for `hfa prove --check FILE`. Exit code 0: the
    statement is proved. Exit code 1: the statement is refuted or remains open. The command requires
    the package python-flint."""
    from hfa_prove.search.game import prove_solution

    _prepared(request)
    stated = request.subject()
    progress = ProgressLine("prove")
    proof = prove_solution(stated.named.game, stated.family, stated.value, progress)
    return _shown(stated, proof, "")


@command(CriticRequest)
def critic(request: CriticRequest) -> int:
    """Prove whether a critic's gain stabilizes the plant.

    The distance of W, P or K from the exact solution is bounded from below and above. The proof
    uses ball arithmetic. -o FILE.json writes a certificate for `hfa prove --check FILE`.
    Exit code 0: the gain is proved to stabilize the plant. Exit code 1: stability is refuted or
    remains open. The command requires the package python-flint."""
    from controller.critic.critic_file import critic_in
    from controller.critic.reading import Reading
    from hfa_prove.search.game import prove_critic

    _prepared(request)
    stated = request.subject()
    game = stated.named.game
    stored = critic_in(request.file, game, Reading(request.basis))
    with prefix_errors(request.file):
        proof = prove_critic(game, stored, stated.family, stated.value)
    return _shown(stated, proof, str(request.file))


def _prepared(request: SolutionRequest) -> None:
    """Raise BadInputError if python-flint is missing or the output file is not a .json file."""
    from hfa_prove.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    refuse_no_certificate(request.output.file)


def _shown(stated: Stated, proof: Proof, critic_file: str) -> int:
    """Print the report of a proof and return the exit code, 0 if the full claim is proved.

    The certificate is written if an output file is given and the proof has a witness.

    critic_file: file of the critic, for the report, or ""
    """
    from hfa_prove.report import game_report

    request = stated.request
    if request.output.file is not None and proof.witness:
        proof.write(request.output.file, request.provenance)
    names = stated.named.game.names
    request.print(game_report(proof.data, names.states, names.origin, critic_file))
    return 0 if proof.proved else 1
