"""The command `hfa linearize`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from hfa.options.advice import trimmed
from hfa.options.argument_types import listed_names
from hfa.options.command import Outcome, Request, command, picture_option
from hfa.options.option import option
from hfa.options.plants import aircraft_help
from hfa.options.trims import GivenTrim, TrimOptions, scheduled_trim
from hfa_support.reporting.figure import new_figure
from trim.hfa.reports import linear_model_report
from trim.linear.linearize import direct_disturbances

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearizeRequest(Request, TrimOptions):
    """Options of `hfa linearize`."""

    moved: ClassVar = {
        "--model": "type --aircraft",
        "--residualize": "use linear.select(residualize=NAMES) in Python",
    }
    aircraft: str | None = option(aircraft_help, "FILE.py:NAME")
    picture: Path | None = picture_option("Bode plots from each input to each output")
    states: tuple[str, ...] | None = option(
        "states of the model, in order; default: those of its linear model",
        "NAME,...",
        listed_names,
    )
    inputs: tuple[str, ...] | None = option(
        "inputs of the model, in order; default: all", "NAME,...", listed_names, rare=True
    )
    outputs: tuple[str, ...] | None = option(
        "outputs of the model, in order; default: the states, C = I",
        "NAME,...",
        listed_names,
        rare=True,
    )
    bode: bool = option("add the frequency responses at the modes")


@command(LinearizeRequest, scheduled_trim)
def linearize(request: LinearizeRequest, given: GivenTrim) -> Outcome:
    """Linearize exactly at a trim, and report matrices, modes and handling qualities. --bode adds
    frequency responses. Error bands and differences from printed matrices are added where known."""
    point = trimmed(given)
    name_of = given.model.about.name_of
    states = request.states and tuple(map(name_of, request.states))
    linear = point.linearize(
        states=states,
        inputs=request.inputs and tuple(map(name_of, request.inputs)),
        outputs=request.outputs and tuple(map(name_of, request.outputs)),
        disturbances=direct_disturbances(point, states or given.model.linear),
    )
    report = linear_model_report(linear, responses=request.bode)

    def figure() -> Figure:
        from trim.linear.frequency import draw_bode

        return draw_bode(linear, new_figure(8.0, 6.0))

    return Outcome(report=report, source=given.source, figure=figure)
