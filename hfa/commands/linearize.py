"""The command `hfa linearize`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import hfa_model
from hfa.commands.trim import trimmed_or_shown
from hfa.options.command import Request, command, picture_option
from hfa.options.option import option
from hfa.options.plants import aircraft_help, parameter_set
from hfa.options.show import show
from hfa.options.trims import GivenTrim, TrimOptions, given_trim
from hfa_aircraft.model import Model
from hfa_model.variants import VARIANTS
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.reporting.report import Report
from trim.hfa.other_dynamics import with_other_dynamics
from trim.hfa.printed import entry_bands, has_bands, printed_at, with_bands, with_printed_matrices
from trim.linear.linear_model import LinearModel
from trim.linear.reduction import reduction_note
from trim.point.operating_point import OperatingPoint
from trim.reports.linear_report import linear_model_report, with_qualities

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _names(text: str) -> tuple[str, ...]:
    """Return different names separated by commas."""
    names = tuple(text.split(","))
    for name in names:
        if names.count(name) > 1:
            raise BadInputError(f"contains {name} twice; remove one {name}")
    return names


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearizeRequest(Request, TrimOptions):
    """Options of `hfa linearize`."""

    aircraft: str | None = option(aircraft_help, "FILE.py:NAME", names="--model --aircraft")
    picture: Path | None = picture_option("Bode plots from each input to each output")
    states: tuple[str, ...] | None = option(
        "states of the model, in order; default: those of its linear model", "a,b,...", _names
    )
    inputs: tuple[str, ...] | None = option(
        "inputs of the model, in order; default: all", "a,b,...", _names, rare=True
    )
    outputs: tuple[str, ...] | None = option(
        "outputs of the model, in order; default: the states, C = I", "a,b,...", _names, rare=True
    )
    residualize: tuple[str, ...] = option(
        "states replaced by their steady state; other omitted states stay at the trim",
        "a,b,...",
        _names,
        default=(),
        rare=True,
    )
    bode: bool = option("add transmission zeros and transfer functions")


@command(LinearizeRequest)
def linearize(request: LinearizeRequest) -> int:
    """Linearize exactly at a trim, and report matrices, modes and handling qualities. --bode adds
    transfer functions. Error bands and differences from printed matrices are added where known."""
    given = given_trim(request, required=True)
    states = _states(request, given.model)
    point = trimmed_or_shown(request, given)
    all_states = _with_winds(
        given.model, point, request.outputs or states, (*states, *request.residualize)
    )
    model = all_states.select(states, request.inputs, residualize=request.residualize)
    report = _report(request, given, model)
    declared = all_states.select(given.model.linear)
    reduction = reduction_note(model.matrices, declared.matrices, request.residualize)
    notes = [note for note in (*report.notes, reduction) if note]
    report = replace(report, notes=notes).with_data(warnings=notes)

    def figure() -> Figure:
        from trim.linear.frequency import bode_figure

        return bode_figure(model.system)

    show(request, report, given.source, figure=figure)
    return 0


def _report(request: LinearizeRequest, given: GivenTrim, model: LinearModel) -> Report:
    """Return the report of a linear model with qualities, transfer functions if requested, and the
    differences from printed matrices.
    """
    report = linear_model_report(model)
    if hfa_model.is_hfa(given.model):
        report = _of_the_hfa(request, given, model, report)
    report = with_qualities(report, model)
    if request.bode:
        from trim.linear.frequency import with_transfers

        report = with_transfers(report, model.system)
    if _is_printed(model) and request.units != "si":  # the printed matrices are in feet
        printed = printed_at(model.point)
        report = report if printed is None else with_printed_matrices(report, model, printed)
    return report


def _states(request: LinearizeRequest, model: Model) -> tuple[str, ...]:
    """Return the states of the linear model, by default those of the aircraft's.

    Raises BadInputError if an option names a state, input or output that the aircraft lacks, and if
    a state is kept and residualized.
    """
    states = tuple(model.states)
    named = {
        "--states": (request.states, states),
        "--inputs": (request.inputs, tuple(model.inputs)),
        "--outputs": (request.outputs, (*states, *model.outputs)),
        "--residualize": (request.residualize, states),
    }
    for flag, (names, known) in named.items():
        for name in names or ():
            refuse_unknown(f"{flag} contains the unknown name", name, known)
    both = set(request.states or ()) & set(request.residualize)
    if both:
        raise BadInputError(
            f"{min(both)} is in both --states and --residualize; remove {min(both)} from one option"
        )
    return request.states or tuple(x for x in model.linear if x not in request.residualize)


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


def _of_the_hfa(
    request: LinearizeRequest, given: GivenTrim, model: LinearModel, report: Report
) -> Report:
    """Return the report of a linear model of the paper's flexible aircraft.

    If the paper prints the matrices of these states and inputs, two parts are added:
    - a comparison with the linear model of other dynamics, if they have a trim at this condition
    - error bands of the entries, if they are known for the parameters
    """
    bands = None
    other = None
    if _is_printed(model):
        parameters = parameter_set(request)
        if has_bands(parameters):
            bands = entry_bands(parameters, given.condition, model)
        other = with_other_dynamics(model.point)
    return with_bands(report, model, bands, other)


def _is_printed(model: LinearModel) -> bool:
    """Return whether the paper prints A and B for the states and inputs of a linear model.

    The result is False for any aircraft except the paper's flexible aircraft.
    """
    return model.model.name in VARIANTS and (model.states, model.inputs) == (
        LINEAR_STATES,
        INPUTS,
    )
