"""The command `hfa linearize`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

import hfa_model
from hfa.commands.trim import OneTrimRequest
from hfa.options.aircraft import Aircraft, aircraft_help
from hfa.options.argument_types import some_of
from hfa.options.output import Output, picture_option
from hfa.options.part import OfModel, option, part
from hfa.options.request import command
from hfa_aircraft.model import Model
from hfa_model.variants import VARIANTS
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report
from trim.hfa.other_dynamics import with_other_dynamics
from trim.hfa.printed import entry_bands, has_bands, printed_at, with_bands, with_printed_matrices
from trim.linear.handling_qualities import with_qualities
from trim.linear.linear_model import LinearModel, linear_model_report
from trim.linear.reduction import reduction_note
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _names_of(*kinds: str) -> OfModel:
    """Return an option type that converts a comma-separated list of the model's signal names.

    kinds: kinds of signals whose names are accepted: "states", "inputs" and "outputs"
    """

    def convert(model: Model, text: str) -> tuple[str, ...]:
        names: list[str] = []
        for kind in kinds:
            names += getattr(model, kind)
        return some_of(*names)(text)

    return OfModel(convert)


def _about_states(model: Model) -> str:
    return f"states of the model, in order; default: {', '.join(model.linear)}"


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearizeRequest(OneTrimRequest):
    """Options of `hfa linearize`."""

    aircraft: Aircraft = part(
        Aircraft, source=option(aircraft_help, "FILE.py:NAME", names="--aircraft --model")
    )
    output: Output = part(
        Output, picture=picture_option("Bode plots from each input to each output")
    )
    states: tuple[str, ...] | None = option(_about_states, "a,b,...", _names_of("states"))
    inputs: tuple[str, ...] | None = option(
        "inputs of the model, in order; default: all", "a,b,...", _names_of("inputs"), rare=True
    )
    outputs: tuple[str, ...] | None = option(
        "outputs of the model, in order; default: the states, C = I",
        "a,b,...",
        _names_of("states", "outputs"),
    )
    residualize: tuple[str, ...] = option(
        "states replaced by their steady state; other omitted states stay at the trim",
        "a,b,...",
        _names_of("states"),
        default=(),
    )
    bode: bool = option("add transmission zeros and transfer functions")


@command(LinearizeRequest)
def linearize(request: LinearizeRequest) -> int:
    """Linearize exactly at a trim, and report matrices, modes and handling qualities. --bode adds
    transfer functions. Error bands and differences from printed matrices are added where known."""
    point = request.trimmed()
    aircraft = request.trim.aircraft
    usual = aircraft.linear
    follow = request.residualize
    states = request.states or tuple(name for name in usual if name not in follow)
    if both := set(states) & set(follow):
        raise BadInputError(
            f"{min(both)} is in both --states and --residualize; remove {min(both)} from one option"
        )
    full = _with_winds(aircraft, point, request.outputs or states, (*states, *follow))
    model = full.select(states, request.inputs, residualize=follow)
    if not hfa_model.is_hfa(aircraft):
        report = linear_model_report(model)
    else:
        report = _of_the_hfa(request, model)
    report = with_qualities(report, point, model.states)
    if request.bode:
        from trim.linear.frequency import with_transfers

        report = with_transfers(report, model.system)
    # The printed matrices are in feet.
    printed = printed_at(point) if _is_printed(model) and request.aircraft.units != "si" else None
    if printed is not None:
        report = with_printed_matrices(report, model, printed)
    notes = [*report.notes, reduction_note(model.matrices, full.select(usual).matrices, follow)]
    notes = [note for note in notes if note]
    report = replace(report, notes=notes).with_data(warnings=notes)

    def figure() -> Figure:
        from trim.linear.frequency import bode_figure

        return bode_figure(model.system)

    request.show(report, figure=figure)
    return 0


def _with_winds(
    aircraft: Model,
    point: OperatingPoint,
    outputs: tuple[str, ...],
    kept: tuple[str, ...],
) -> LinearModel:
    """Return the linear model of all states at a trim, with the aircraft's winds as disturbances.

    The winds are left out if a wind acts on the kept states through an omitted state. The reduced
    model has no column for this effect. The winds of the paper's flexible aircraft are always
    included.

    aircraft: the model
    point: the trim
    outputs: names of the outputs of the linear model
    kept: names of the states in the reduced model
    """
    winds = tuple(aircraft.disturbances)
    linear = point.linearize(full=True, outputs=outputs, disturbances=winds)
    if hfa_model.is_hfa(aircraft):
        return linear
    rows = [i for i, name in enumerate(linear.states) if name in kept]
    for i in range(len(linear.states)):
        if i not in rows and np.any(linear.A[rows, i]) and np.any(linear.E[i]):
            return point.linearize(full=True, outputs=outputs, disturbances=())
    return linear


def _of_the_hfa(request: LinearizeRequest, model: LinearModel) -> Report:
    """Return the report of a linear model of the paper's flexible aircraft.

    If the paper prints the matrices of these states and inputs, two parts are added:
    - a comparison with the linear model of other dynamics, if they have a trim at this condition
    - error bands of the entries, if they are known for the parameters
    """
    bands = None
    other = None
    if _is_printed(model):
        parameters = request.aircraft.parameter_set
        if has_bands(parameters):
            bands = entry_bands(parameters, request.trim.condition, model)
        other = with_other_dynamics(model.point)
    return with_bands(linear_model_report(model), model, bands, other)


def _is_printed(model: LinearModel) -> bool:
    """Return whether the paper prints A and B for the states and inputs of a linear model.

    The result is False for any aircraft except the paper's flexible aircraft.
    """
    return model.model.name in VARIANTS and (model.states, model.inputs) == (
        LINEAR_STATES,
        INPUTS,
    )
