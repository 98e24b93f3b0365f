"""The commands that fly: `hfa fly`, `schedule`, `monte-carlo`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from controller.flight.envelope import flight_envelope
from hfa.options.argument_types import number, output_file, quantity, whole
from hfa.options.command import command
from hfa.options.flights import (
    FlightOptions,
    ScenarioOptions,
    error_option,
    noise_option,
    weights_option,
)
from hfa.options.request import OfModel, option
from hfa.options.trims import (
    OneTrimOptions,
    OutputOptions,
    WorkersOptions,
    picture_option,
    refuse_si,
    worker_words,
)
from hfa.output import ProgressLine, print_report, show
from hfa_support.errors import BadInputError, shortened
from hfa_support.files import temporary_folder
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point

if TYPE_CHECKING:
    from controller.flight.nonlinear_flight import NonlinearFlight
    from hfa_aircraft import Model
    from hfa_support.reporting.report import Report

#: Points of a schedule, half a second or so each.
_MOST_POINTS = 1000
_MOST_MEMBERS = 10_000_000
_TO = "VALUE[:S[:POINTS]]"


@dataclass(frozen=True, kw_only=True, eq=False)
class FlyRequest(FlightOptions, OneTrimOptions, OutputOptions):
    """One flight."""

    picture: Path | None = picture_option("the flight")


@command(FlyRequest)
def fly(request: FlyRequest) -> int:
    """Simulate a policy on all states of the nonlinear aircraft and compare with the prediction of
    its linear model.

    Exit code 0 when every state stays inside its envelope, every input within its control limits,
    and no oscillation is left that does not decay; else 1, and the report names the state that left
    first and the inputs that exceeded their limits. `--law none --command elevator=1:2,2:-2,3:0`
    flies a doublet without a law. See `hfa schedule` for a slow change of dihedral."""
    from controller.flight.nonlinear_flight import fly

    flight = request.flight()
    result = fly(*flight, progress=ProgressLine("simulate"))
    return _tell(result, result.report(), [flight.point], request)


def _tell(
    result: NonlinearFlight,
    report: Report,
    points: list[OperatingPoint],
    request: OutputOptions,
) -> int:
    """Draw, print and write a flight; the exit code, 1 when it did not stay within its limits."""
    from controller.flight.flight_figure import flight_figure

    show(
        report,
        request,
        figure=lambda: flight_figure(result, report.title),
        only_in_files=result.history(),
        points=points,
    )
    return 0 if result.within_limits else 1


def _to(model: Model, text: str) -> tuple[float, float, int]:
    """The value at the end, the time of the change, the points of the schedule."""
    parts = text.split(":")
    if len(parts) > 3:
        raise BadInputError(f"is {shortened(text)!r}; give {_TO}")
    over, points = (*parts[1:], *("60", "11")[len(parts) - 1 :])
    end = quantity(model, model.schedule, parts[0])
    return end, number(over), whole(2, _MOST_POINTS)(points)


@dataclass(frozen=True, kw_only=True, eq=False)
class ScheduleRequest(ScenarioOptions, OneTrimOptions, OutputOptions):
    """A flight through a change of the scheduling variable."""

    to: tuple[float, float, int] = option(
        "the dihedral at the end, degrees; time of the change, default 60; points of the schedule, default 11",
        _TO,
        OfModel(_to),
        required=True,
    )
    weights: Path | None = weights_option(
        "use these gains instead of a law: K, or dihedral_deg and K at each of its angles"
    )
    duration: float | None = option("default 20 more than the change takes", "S", number)
    picture: Path | None = picture_option("the flight")


@command(ScheduleRequest)
def schedule(request: ScheduleRequest) -> int:
    """Simulate the nonlinear aircraft through a slow change of dihedral under a schedule of gains.

    At every point of a grid of dihedrals there is a trim and a gain, linear in between: certified,
    or from a file unchanged. With --aircraft the change is one of the scheduling variable of the
    model. Exit code as of `hfa fly`."""
    from controller.game.gain_schedule import load_gains
    from verification.flights import scheduling

    request.check_policy()
    (end, over, points), path, model = request.to, request.weights, request.model
    aircraft = request.flown_aircraft()
    gains = None if path is None else load_gains(path, model)
    begin = find_operating_point(aircraft, request.trim_condition(), request.start_point)
    change = scheduling.change_over(aircraft, begin.values.get(model.schedule, end), end, over)
    ended = scheduling.LEAD + over
    duration = ended + scheduling.REST if request.duration is None else request.duration
    if duration < ended:
        raise BadInputError(
            f"--duration is {duration:g} s and the change ends at {ended:g} s; extend it"
        )
    scenario = replace(request, duration=duration).scenario(begin)
    low, high = sorted((change.start, change.end))
    grid = np.linspace(low, high, points)
    certified = scheduling.certified_schedule(
        aircraft,
        grid if gains is None else gains.grid(grid),
        law=request.law,
        seed=request.seed,
        game=request.game_on,
        settings=request.set,
        gains=gains,
        condition=request.common_condition().at,
        progress=ProgressLine("certify"),
    )
    ends = [certified.at(each).point for each in (change.start, end)]
    envelope, progress = (
        flight_envelope(aircraft, ends[0], request.envelope),
        ProgressLine("simulate"),
    )
    result = scheduling.fly_schedule(
        aircraft, certified, change, scenario, envelope, progress=progress
    )
    name = request.law if path is None else f"gain of {path}"
    return _tell(result, scheduling.schedule_report(result, name), ends, request)


@dataclass(frozen=True, kw_only=True, eq=False)
class MembersRequest(FlightOptions, OneTrimOptions, WorkersOptions, OutputOptions):
    """Many members of one flight."""

    samples: int = option(
        "members, default 100", "N", whole(1, _MOST_MEMBERS), default=100, rare=True
    )
    error: Mapping[str, float] = error_option("relative standard deviation of a parameter")
    noise: Mapping[str, float] = noise_option("standard deviation of a sensor, degrees for angles")
    gust: None = None
    output: Path | None = option(
        "keep every member in this store (.zarr)",
        "FILE",
        output_file(".zarr"),
        names="-o --output",
    )


@command(MembersRequest)
def monte_carlo(request: MembersRequest) -> int:
    """Simulate many members of one flight, each with its own parameter errors, sensor noise and
    turbulence.

    Member k is decided by --seed and k alone: any number of workers gives the same bits. The
    members go to a Zarr store (-o FILE.zarr), which can be continued after an interruption
    (--resume). Exit code 0 when at least one member stays inside its envelope and within the
    control limits."""
    from controller.flight.monte_carlo import MonteCarlo
    from controller.flight.monte_carlo_report import member_report
    from hfa_support.jobs.store import stream

    target = request.output
    refuse_si(request, "a store is in ft")
    if request.resume and target is None:
        raise BadInputError("--resume needs the store to continue; add -o FILE.zarr")
    plan = MonteCarlo(request.samples, request.seed, *request.flight())
    with temporary_folder() as folder:
        store = stream(
            plan,
            target or folder / "members.zarr",
            **worker_words(request.workers),
            resume=request.resume,
            provenance=request.provenance.to_dict(),
            progress=ProgressLine("simulate"),
        )
        kept = "members not kept" if target is None else f"members in {target}"
        report = member_report(plan, store.read, kept)
    report = report.with_data(store=None if target is None else str(target))
    print_report(report, request, points=[plan.point])
    return 0 if report.data["within_limits"] else 1
