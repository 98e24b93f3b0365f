"""Simulate many members of one flight, each with its own parameter errors, sensor noise and turbulence.

Member k is decided by --seed and k alone: any number of workers gives the same bits. The members go to a Zarr store
(-o FILE.zarr), which can be continued after an interruption (--resume). Exit code 0 when at least one member stays
inside its envelope and within the control limits.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import check_target, number, quantity, whole
from hfa_cli.options.law_options import (
    add_controller,
    add_stored,
    add_weights,
    check_stored,
    controlled,
    flown_law_of,
    law_of,
    seed_of,
)
from hfa_cli.options.parser import add_named, add_value
from hfa_cli.options.scenario_options import (
    actuators_of,
    add_actuators,
    add_envelope,
    add_initial,
    add_signal,
    add_times,
    add_turbulence,
    envelope_of,
    initial_of,
    signal_of,
)
from hfa_cli.origin import provenance
from hfa_cli.output import tell
from hfa_cli.progress import ProgressLine
from hfa_support.errors import BadInputError
from hfa_support.files import temporary_folder
from trim.linear.linear_model import LinearModel, linearize

if TYPE_CHECKING:
    from controller.flight.monte_carlo import MonteCarlo
    from controller.flight.scenario import Uncertainty
    from controller.policy.policies import FlownLaw

_DEFAULT_MEMBERS = 100
_MOST_MEMBERS = 10_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa monte-carlo`."""
    options.add_condition(parser)
    options.add_aircraft(parser)
    add_weights(parser)
    add_stored(parser)
    add_value(
        parser, "--members", whole(1, _MOST_MEMBERS), "N", f"default {_DEFAULT_MEMBERS}", default=_DEFAULT_MEMBERS
    )
    drawn = parser.add_argument_group("what differs from member to member; off by default")
    deviation, of_sensor = "relative standard deviation of a parameter", "standard deviation of a sensor"
    add_named(drawn, "--error", lambda _, text: number(text), "NAME=DEVIATION", deviation)
    add_named(drawn, "--noise", quantity, "NAME=DEVIATION", f"{of_sensor}, degrees for angles")
    add_turbulence(drawn)
    flight = parser.add_argument_group("the flight")
    add_times(flight)
    add_initial(flight)
    add_controller(parser)
    add_actuators(flight)
    add_signal(flight, "--reference", "what a state shall follow")
    add_signal(flight, "--disturbance", "added to the rate of a state")
    add_envelope(flight)
    options.add_workers(parser, "run of the same options")
    options.add_json(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="keep every member in this store (.zarr)")


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when no member stayed within its limits."""
    from controller.flight.monte_carlo import MonteCarloResult, stream_monte_carlo

    options.refuse_files(arguments, ("output",), "a store is in ft")
    target = check_target(arguments.output, (".zarr",))
    if arguments.resume and target is None:
        raise BadInputError("--resume needs the store to continue; add -o FILE.zarr")
    crew = options.crew_of(arguments)
    plan = _plan(arguments)
    with temporary_folder() as folder:
        store = stream_monte_carlo(
            plan,
            folder / "members.zarr" if target is None else target,
            **crew,
            provenance=provenance().to_dict(),
            progress=ProgressLine("simulate"),
        )
        outcome = MonteCarloResult.of(plan, store, "members not kept" if target is None else f"members in {target}")
    report = outcome.report()
    tell(replace(report, data={**report.data, "store": arguments.output}), [plan.point], arguments, None)
    return 0 if outcome.within_limits else 1


def _plan(arguments: argparse.Namespace) -> MonteCarlo:
    from controller.flight.monte_carlo import MonteCarlo
    from controller.flight.scenario import Scenario

    aircraft = options.aircraft_of(arguments)
    point = options.operating_point_of(arguments, aircraft)
    scenario = Scenario(
        duration=20.0 if arguments.duration is None else arguments.duration,
        step=arguments.step,
        initial=initial_of(arguments.initial),
        reference=signal_of("reference", arguments.reference),
        disturbance=signal_of("disturbance", arguments.disturbance),
        uncertainty=_uncertainty(arguments),
        actuators=actuators_of(arguments),
    )
    law, scenario = controlled(arguments, aircraft, point, scenario)
    return MonteCarlo(
        members=arguments.members,
        seed=seed_of(arguments),
        parameters=aircraft.parameters,
        dynamics=arguments.dynamics,
        point=point,
        law=law or _law(arguments, linearize(aircraft, point)),
        scenario=scenario,
        envelope=envelope_of(arguments, aircraft, point),
    )


def _uncertainty(arguments: argparse.Namespace) -> Uncertainty:
    from controller.flight.scenario import Uncertainty

    errors, noise = arguments.error or {}, arguments.noise or {}
    return Uncertainty(errors, noise, arguments.turbulence)


def _law(arguments: argparse.Namespace, model: LinearModel) -> FlownLaw:
    """The gain that the options name, designed for the nominal model."""
    if law_of(arguments) == "exact" and arguments.set and not check_stored(arguments):
        raise BadInputError("--set belongs to a learning law; with --law exact there is nothing to learn")
    return flown_law_of(arguments, model)
