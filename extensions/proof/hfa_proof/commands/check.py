"""The command `hfa prove --check`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from controller.game.basis import basis
from controller.game.names import UNNAMED, PlantNames
from hfa.doors import words_after
from hfa.options.argument_types import input_file
from hfa.options.command import command
from hfa.options.games import WeightOptions, design_option
from hfa.options.request import option
from hfa.options.trims import AircraftOptions, OutputOptions, scheduled
from hfa.output import ProgressLine, show
from hfa_aircraft.model import Model
from hfa_flight.gain_schedule import load_gain_schedule
from hfa_proof.options import interval_of, loop_of_file
from hfa_support.entry_points import PARTS, loaded, offered
from hfa_support.errors import BadInputError
from hfa_support.files import MATRIX_FILES

if TYPE_CHECKING:
    from hfa_proof.checker.checker import Verified
    from hfa_proof.search.loops import Intervals


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckRequest(WeightOptions, AircraftOptions, OutputOptions):
    """A certificate to be verified."""

    check: Path | None = option("the certificate", "FILE", input_file(".json"))
    at: Any = scheduled(interval_of, "DEG|LOW:HIGH", "refused where the certificate has another")
    weights: Path | None = option(
        "gains or critic that it must be about", "FILE", input_file(*MATRIX_FILES)
    )
    design: Any = design_option("of a controller in --weights: its actuators")
    dynamics: str = "published"
    parameters: None = None

    def origin(self) -> Mapping[str, Any]:
        """Nothing: the certificate says which aircraft it is about."""
        return {}


@command(CheckRequest)
def prove(request: CheckRequest) -> int:
    """Verify a certificate: each statement is proved anew in ball arithmetic from the certificate
    alone, and of your own aircraft also from its file.

    The exit code is 0 when it is proved, 1 when it is not, or not about what other options name. It
    needs `pip install .[proof]`."""
    from hfa_proof.arithmetic import flint_or_refusal
    from hfa_proof.checker.checker import check_certificate, kind_of
    from hfa_proof.search.checked_report import checked_report

    flint_or_refusal()
    if request.check is None:
        known = ", ".join(words_after("prove"))
        raise BadInputError(f"say what to prove, hfa prove and one of {known}, or --check FILE")
    of_others = offered(PARTS).get(f"check.{kind_of(request.check)}")
    if of_others is not None:
        code: int = loaded(of_others)(request, request.check)
        return code
    own = request.model if request.own else None
    verified = check_certificate(request.check, ProgressLine("check"), own)
    _require_same(verified, request)
    report = checked_report(verified)
    show(report, request)
    return 0 if report.data["proved"] else 1


def _require_same(verified: Verified, request: CheckRequest) -> None:
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
    from hfa_proof.search.checked_report import require_same

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
    loop = loop_of_file(request.weights, request.design, model, _stated_intervals(statement))
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
