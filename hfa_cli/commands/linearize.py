"""Exact linear model at a trim: matrices, modes, handling qualities, transfer functions, error bands, the print."""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import OWN, some_of
from hfa_cli.options.parser import add_value
from hfa_cli.output import draw, failure_as_data, show
from hfa_model.aircraft import HFA, Aircraft
from hfa_model.parameters import ParameterSet
from hfa_model.variants import VARIANTS
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.model import Model
from hfa_support.reporting.report import Report
from trim.linear.compare import beside_the_print, printed_at
from trim.linear.entry_bands import bands_known, entry_bands, trust_in
from trim.linear.frequency import bode_figure, re_im, transfer_tables
from trim.linear.handling_qualities import handling_qualities, quantities_data, quantities_table
from trim.linear.linear_model import LinearModel, linear_model_report, linearize, reduction_note
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa linearize`."""
    options.add_condition(parser)
    of = OWN.get() or HFA
    for name, known, default in (
        ("states", of.states, "the six without altitude" if of is HFA else "those declared as linear"),
        ("inputs", of.inputs, "all"),
        ("outputs", (*of.states, *of.outputs), "the states, C = I"),
    ):
        add_value(parser, f"--{name}", some_of(*known), "a,b,...", f"{name} of the model, in order; default: {default}")
    winds = "winds w of E and F, in order; default: updraft, in files and --json alone"
    add_value(parser, "--disturbances", some_of(*of.disturbances), "a,b,...", winds)
    follow = "states that follow the others at once; what is left out stays at its trim"
    add_value(parser, "--residualize", some_of(*of.states), "a,b,...", follow)
    parser.add_argument("--bode", action="store_true", help="also transmission zeros and transfer functions")
    options.add_picture(parser, "Bode plots from the inputs to the outputs")
    options.add_own(parser)
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Trim, linearize and report."""
    own, parameters = options.own_of(arguments), options.parameters_of(arguments)
    aircraft = own or Aircraft(parameters.values, arguments.dynamics)
    condition = options.condition_of(arguments)
    with failure_as_data(arguments, aircraft):
        point = options.operating_point_of(arguments, aircraft)
    usual = aircraft.model.linear
    follow = arguments.residualize or ()
    winds = arguments.disturbances
    if isinstance(aircraft, Model) and aircraft.disturbances:
        # States beside the linear ones through which winds act on these: the model has them where winds are asked for.
        found = linearize(aircraft, point, full=True, disturbances=winds or tuple(aircraft.disturbances))
        rows = [i for i, name in enumerate(found.states) if name in usual]
        beside = [i for i in range(len(found.states)) if i not in rows]
        between = [found.states[i] for i in beside if np.any(found.A[rows, i]) and np.any(found.E[i])]
        if between:
            usual, winds = (usual, ()) if winds is None else ((*usual, *between), winds)
    states = arguments.states or tuple(name for name in usual if name not in follow)
    if both := set(states) & set(follow):
        raise BadInputError(f"{min(both)} is in --states and in --residualize; name it once")
    outputs = arguments.outputs or states
    full = linearize(aircraft, point, full=True, outputs=outputs, disturbances=winds)
    whole = full.select(usual)
    model = full.select(states, arguments.inputs, residualize=follow)
    if isinstance(aircraft, Model):
        report = linear_model_report(model, windy=arguments.disturbances is not None)
    else:
        report = _of_the_hfa(arguments, aircraft, parameters, condition, model)
    if qualities := handling_qualities(aircraft, point):
        report = replace(report, parts=(*report.parts, quantities_table(qualities)))
        report = report.with_data(handling_qualities=quantities_data(qualities))
    if arguments.bode:
        responses, zeros = model.transfers(), model.zeros()
        report = replace(report, parts=(*report.parts, *transfer_tables(model, responses, zeros)))
        report = report.with_data(zeros=re_im(zeros), transfers=[each.to_dict() for each in responses])
    # The print is in feet.
    printed = printed_at(point) if own is None and _is_printed(model) and arguments.units != "si" else None
    if printed is not None:
        report = beside_the_print(report, model, printed)
    notes = [each for each in (*report.notes, reduction_note(model, whole, follow)) if each]
    report = replace(report, notes=notes).with_data(warnings=notes)
    draw(arguments.picture, lambda: bode_figure(model))
    show(report, arguments, target=arguments.output)
    return 0


def _of_the_hfa(
    arguments: argparse.Namespace,
    aircraft: Aircraft,
    parameters: ParameterSet,
    condition: TrimCondition,
    model: LinearModel,
) -> Report:
    """The report with the bands of the entries and the other dynamics, where they exist."""
    whole = _is_printed(model)
    bands = entry_bands(parameters, condition, model) if whole and bands_known(parameters) else None
    other = _other_dynamics(aircraft, condition, model.point) if whole else None
    trust, windy = trust_in(bands, model, other), arguments.disturbances is not None
    return linear_model_report(model, bands, trust, other=other, windy=windy)


def _is_printed(model: LinearModel) -> bool:
    """Whether bands and print are of its states and inputs: the six states and all inputs."""
    return (model.states, model.inputs) == (LINEAR_STATES, INPUTS)


def _other_dynamics(aircraft: Aircraft, condition: TrimCondition, start: OperatingPoint) -> LinearModel | None:
    """The model of the other dynamics at the same condition; None where they have no trim there."""
    name = next((each for each in VARIANTS if each != aircraft.variant.name), "")
    other = Aircraft(aircraft.parameters, name)
    try:
        return linearize(other, find_operating_point(other, condition, start))
    except (BadInputError, NoSolutionError):
        return None
