"""The command `hfa linearize`."""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace

import numpy as np

import hfa_model
from hfa.options import trims
from hfa.options.argument_types import model, some_of
from hfa.options.parser import Option, Options, command
from hfa.output import draw, failure_as_data, show
from hfa_aircraft.model import Model
from hfa_model.variants import VARIANTS
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.report import Report
from trim.hfa.printed import bands_known, beside_the_print, entry_bands, printed_at, trust_in
from trim.linear import linear_model
from trim.linear.handling_qualities import with_qualities
from trim.linear.linear_model import LinearModel, linear_model_report, reduction_note
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point


def _options() -> Options:
    of, lists = model(), dict[str, Option]()
    for name, known, about in (
        (
            "states",
            of.states,
            f"states of the model, in order; default: {len(of.linear)} of {len(of.states)}",
        ),
        ("inputs", of.inputs, "inputs of the model, in order; default: all"),
        (
            "outputs",
            (*of.states, *of.outputs),
            "outputs of the model, in order; default: the states, C = I",
        ),
        (
            "residualize",
            of.states,
            "states that follow the others at once; what is left out stays at its trim",
        ),
    ):
        lists[f"--{name}"] = Option(about, "a,b,...", some_of(*known))
    bode = {"--bode": Option("also transmission zeros and transfer functions")}
    picture = trims.picture("Bode plots from the inputs to the outputs")
    return {**trims.trim(required=True), **lists, **bode, **picture, **trims.output()}


@command(_options)
def linearize(arguments: argparse.Namespace) -> int:
    """Exact linear model at a trim: matrices, modes, handling qualities, transfer functions, error
    bands, the print."""
    aircraft, condition = trims.aircraft_of(arguments), trims.condition_of(arguments)
    with failure_as_data(arguments, aircraft):
        point = trims.point_of(arguments, aircraft)
    usual, follow = aircraft.linear, arguments.residualize or ()
    states = arguments.states or tuple(name for name in usual if name not in follow)
    if both := set(states) & set(follow):
        raise BadInputError(f"{min(both)} is in --states and in --residualize; name it once")
    full = _with_winds(aircraft, point, arguments.outputs or states, (*states, *follow))
    model = full.select(states, arguments.inputs, residualize=follow)
    report = (
        linear_model_report(model)
        if not hfa_model.is_hfa(aircraft)
        else _of_the_hfa(arguments, condition, model)
    )
    report = with_qualities(report, aircraft, point)
    if arguments.bode:
        from trim.linear.frequency import with_transfers

        report = with_transfers(report, model)
    # The print is in feet.
    if (
        _is_printed(model)
        and arguments.units != "si"
        and (printed := printed_at(point)) is not None
    ):
        report = beside_the_print(report, model, printed)
    notes = [
        each for each in (*report.notes, reduction_note(model, full.select(usual), follow)) if each
    ]
    draw(arguments, model.bode)
    show(replace(report, notes=notes).with_data(warnings=notes), arguments)
    return 0


def _with_winds(
    aircraft: Model,
    point: OperatingPoint,
    outputs: tuple[str, ...],
    kept: tuple[str, ...],
) -> LinearModel:
    """The model of all states with all winds, but none where winds act through states that are not
    kept."""
    winds = tuple(aircraft.disturbances)
    found = linear_model.linearize(aircraft, point, full=True, outputs=outputs, disturbances=winds)
    rows = [i for i, name in enumerate(found.states) if name in kept]
    through = [
        i
        for i in range(len(found.states))
        if i not in rows and np.any(found.A[rows, i]) and np.any(found.E[i])
    ]
    if not hfa_model.is_hfa(aircraft) and through:
        return linear_model.linearize(aircraft, point, full=True, outputs=outputs, disturbances=())
    return found


def _of_the_hfa(
    arguments: argparse.Namespace, condition: TrimCondition, model: LinearModel
) -> Report:
    """The report with the bands of the entries and the other dynamics, where they exist."""
    parameters, bands, other = trims.parameters_of(arguments), None, None
    if _is_printed(model):
        bands = entry_bands(parameters, condition, model) if bands_known(parameters) else None
        name = next((each for each in VARIANTS if each != arguments.dynamics), "")
        changed = hfa_model.aircraft(name, parameters.values)
        with suppress(BadInputError, NoSolutionError):  # it has no trim there
            other = linear_model.linearize(
                changed, find_operating_point(changed, condition, model.point)
            )
    return linear_model_report(model, bands, trust_in(bands, model, other), other=other)


def _is_printed(model: LinearModel) -> bool:
    """Whether bands and print are of its states and inputs: the six states and all inputs of the
    HFA."""
    return model.point.model.name in VARIANTS and (model.states, model.inputs) == (
        LINEAR_STATES,
        INPUTS,
    )
