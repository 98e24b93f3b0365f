"""The command `hfa linearize`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from hfa.options.advice import trimmed
from hfa.options.argument_types import listed_names
from hfa.options.command import (
    Outcome,
    ProgressLine,
    Request,
    command,
    output_option,
    picture_option,
    provenance,
)
from hfa.options.parser import option, refuse
from hfa.options.plants import aircraft_help
from hfa.options.trims import GivenTrim, TrimInput, TrimOptions, trim_input
from hfa_aircraft.model import Model
from hfa_support.reporting.figure import new_figure
from trim.hfa.reports import linear_model_report
from trim.linear.linearize import direct_disturbances
from trim.reports.models import linear_models

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_PURPOSE = " (of --conditions without --row: all models)"


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearizeRequest(Request, TrimOptions):
    """Options of `hfa linearize`."""

    needs_dihedral: ClassVar = True
    output: Path | None = output_option(".pdf", stores=(".zarr",), purpose=_PURPOSE)
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


@command(LinearizeRequest, trim_input)
def linearize(request: LinearizeRequest, given: TrimInput) -> Outcome:
    """Linearize exactly at a trim, and report matrices, modes and handling qualities. --bode adds
    frequency responses. Error bands and differences from printed matrices are added where known.
    With --conditions and without --row, the linear models of all conditions are written."""
    if given.rows and request.row is None:
        return _of_conditions(request, given)
    return _of_trim(request, given.single())


def _signals(request: LinearizeRequest, model: Model) -> dict[str, tuple[str, ...] | None]:
    """Return "states", "inputs", "outputs" -> names of the option, or None for the usual ones."""
    chosen = {kind: getattr(request, kind) for kind in ("states", "inputs", "outputs")}
    return {  # None stays None, and an alias becomes the name in the model
        kind: names and tuple(map(model.about.name_of, names)) for kind, names in chosen.items()
    }


def _of_conditions(request: LinearizeRequest, given: TrimInput) -> Outcome:
    """Return the outcome of many conditions: their linear models, in one file."""
    refuse(request, ("picture", "bode"), "is of a single condition; add --row NAME, or remove it")
    book = linear_models(
        given.model,
        given.asked(trimmed),
        **_signals(request, given.model),
        progress=ProgressLine("linearize"),
    )
    source = given.source(given.condition, {})
    origin = provenance(request, source).to_dict()
    report = book._summary
    return Outcome(
        report=replace(report, notes=()),
        source=source,
        notes=report.notes,
        write=partial(book.save, provenance=origin),
    )


def _of_trim(request: LinearizeRequest, given: GivenTrim) -> Outcome:
    """Return the outcome of a single trim: its linear model."""
    point = trimmed(given)
    signals = _signals(request, given.model)
    kept = signals["states"] or given.model.linear
    # Disturbances that act on the kept states through omitted ones have no column.
    linear = point.linearize(**signals, disturbances=direct_disturbances(point, kept))
    report = linear_model_report(linear, responses=request.bode)

    def figure() -> Figure:
        from trim.linear.frequency import draw_bode

        return draw_bode(linear, new_figure(8.0, 6.0))

    return Outcome(report=report, source=given.source, figure=figure)
