"""The commands that fly: `hfa fly`, `schedule`, `monte-carlo`."""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.flight.envelope import flight_envelope
from hfa.options import flights, games, trims
from hfa.options.argument_types import model, number, output_file, quantity, whole
from hfa.options.parser import Option, Options, command
from hfa.output import ProgressLine, draw, provenance, show
from hfa_support.errors import BadInputError, shortened
from hfa_support.files import temporary_folder
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point

if TYPE_CHECKING:
    from controller.flight.nonlinear_flight import NonlinearFlight
    from hfa_support.reporting.report import Report

#: Points of a schedule, half a second or so each, and values of a quantity of a map.
_MOST_POINTS = 1000
_MOST_MEMBERS = 10_000_000
_TO = "VALUE[:S[:POINTS]]"


def _flight() -> Options:
    policy = {**flights.law(flights.NONE), **flights.weights(), **flights.commands()}
    end = {**trims.picture("the flight"), **trims.output()}
    return {**trims.trim(required=True), **policy, **flights.scenario(), **end}


@command(_flight)
def fly(arguments: argparse.Namespace) -> int:
    """Simulate a policy on all states of the nonlinear aircraft and compare with the prediction of
    its linear model.

    Exit code 0 when every state stays inside its envelope, every input within its control limits,
    and no oscillation is left that does not decay; else 1, and the report names the state that left
    first and the inputs that exceeded their limits. `--law none --command elevator=1:2,2:-2,3:0`
    flies a doublet without a law. See `hfa schedule` for a slow change of dihedral."""
    from controller.flight.nonlinear_flight import fly

    model, point, policy, scenario, envelope = flights.flight_of(arguments)
    result = fly(model, point, policy, scenario, envelope, progress=ProgressLine("simulate"))
    return _tell(result, result.report(), [point], arguments)


def _tell(
    result: NonlinearFlight,
    report: Report,
    points: list[OperatingPoint],
    arguments: argparse.Namespace,
) -> int:
    """Draw, print and write a flight; the exit code, 1 when it did not stay within its limits."""
    from controller.flight.flight_figure import flight_figure

    draw(arguments, lambda: flight_figure(result, report.title))
    show(report, arguments, only_in_files=result.history(), points=points)
    return 0 if result.within_limits else 1


def _change() -> Options:
    about = "the dihedral at the end, degrees; time of the change, default 60; points of the schedule, default 11"
    return {
        **trims.trim(required=True),
        "--to": Option(about, _TO, _to, more={"required": True}),
        **flights.law(),
        **flights.weights(
            "use these gains instead of a law: K, or dihedral_deg and K at each of its angles"
        ),
        **flights.scenario(None),
        **trims.picture("the flight"),
        **trims.output(),
    }


def _to(text: str) -> tuple[float, float, int]:
    """The value at the end, the time of the change, the points of the schedule."""
    parts = text.split(":")
    if len(parts) > 3:
        raise BadInputError(f"is {shortened(text)!r}; give {_TO}")
    over, points = (*parts[1:], *("60", "11")[len(parts) - 1 :])
    return quantity(model().schedule, parts[0]), number(over), whole(2, _MOST_POINTS)(points)


@command(_change)
def schedule(arguments: argparse.Namespace) -> int:
    """Simulate the nonlinear aircraft through a slow change of dihedral under a schedule of gains.

    At every point of a grid of dihedrals there is a trim and a gain, linear in between: certified,
    or from a file unchanged. With --aircraft the change is one of the scheduling variable of the
    model. Exit code as of `hfa fly`."""
    from controller.game.gain_schedule import load_gains
    from verification.flights import scheduling

    flights.check_policy(arguments)
    aircraft, (end, over, points), path = (
        trims.aircraft_of(arguments),
        arguments.to,
        arguments.weights,
    )
    gains = None if path is None else load_gains(path, model())
    begin = find_operating_point(aircraft, trims.condition_of(arguments), trims.start_of(arguments))
    change = scheduling.change_over(aircraft, begin.values.get(model().schedule, end), end, over)
    ended = scheduling.LEAD + over
    if arguments.duration is None:
        arguments.duration = ended + scheduling.REST
    if arguments.duration < ended:
        raise BadInputError(
            f"--duration is {arguments.duration:g} s and the change ends at {ended:g} s; extend it"
        )
    scenario = flights.scenario_of(arguments, begin)
    low, high = sorted((change.start, change.end))
    grid = np.linspace(low, high, points)
    certified = scheduling.certified_schedule(
        aircraft,
        grid if gains is None else gains.grid(grid),
        law=arguments.law,
        seed=arguments.seed,
        game=partial(games.game_on, arguments),
        settings=arguments.set,
        gains=gains,
        condition=trims.flights_of(arguments).at,
        progress=ProgressLine("certify"),
    )
    ends = [certified.at(each).point for each in (change.start, end)]
    envelope, progress = (
        flight_envelope(aircraft, ends[0], arguments.envelope),
        ProgressLine("simulate"),
    )
    result = scheduling.fly_schedule(
        aircraft, certified, change, scenario, envelope, progress=progress
    )
    name = arguments.law if path is None else f"gain of {path}"
    return _tell(result, scheduling.schedule_report(result, name), ends, arguments)


def _members() -> Options:
    return {
        **trims.trim(required=True),
        **flights.law(flights.NONE),
        **flights.weights(),
        "--samples": Option("members, default 100", "N", whole(1, _MOST_MEMBERS), 100),
        **flights.scenario(members=True),
        **flights.commands(),
        **trims.workers("run of the same options"),
        **trims.JSON,
        "-o --output": Option(
            "keep every member in this store (.zarr)", "FILE", output_file(".zarr")
        ),
    }


@command(_members)
def monte_carlo(arguments: argparse.Namespace) -> int:
    """Simulate many members of one flight, each with its own parameter errors, sensor noise and
    turbulence.

    Member k is decided by --seed and k alone: any number of workers gives the same bits. The
    members go to a Zarr store (-o FILE.zarr), which can be continued after an interruption
    (--resume). Exit code 0 when at least one member stays inside its envelope and within the
    control limits."""
    from controller.flight.monte_carlo import MonteCarlo
    from controller.flight.monte_carlo_report import member_report
    from hfa_support.jobs.store import stream

    target = arguments.output
    trims.refuse_si(arguments, "a store is in ft")
    if arguments.resume and target is None:
        raise BadInputError("--resume needs the store to continue; add -o FILE.zarr")
    model, point, policy, scenario, envelope = flights.flight_of(arguments)
    plan = MonteCarlo(arguments.samples, arguments.seed, model, point, policy, scenario, envelope)
    with temporary_folder() as folder:
        about: dict[str, Any] = {
            "provenance": provenance(arguments).to_dict(),
            "progress": ProgressLine("simulate"),
        }
        place = target or folder / "members.zarr"
        store = stream(plan, place, **arguments.workers, resume=arguments.resume, **about)
        report = member_report(
            plan, store.read, "members not kept" if target is None else f"members in {target}"
        )
    report = report.with_data(store=None if target is None else str(target))
    show(report, arguments, written=True, points=[plan.point])
    return 0 if report.data["within_limits"] else 1
