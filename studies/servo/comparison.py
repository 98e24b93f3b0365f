"""Servo controllers under the step commands and actuator faults of SimVFA.

The module defines the control laws and flights. It makes a table and a figure for each case.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import hfa
import hfa_model
from hfa import BadInputError, OperatingPoint, linearize, solve, trim
from hfa.extend import Report
from hfa.paper import level_flight, published_game
from hfa_aircraft.model import Model
from hfa_design import design_controller, load_design
from hfa_flight import (
    ActuatorFault,
    CommandSteps,
    GainPolicy,
    Policy,
    Scenario,
    ScheduledController,
    flight_envelope,
)
from hfa_flight.actuators import Actuator
from hfa_flight.flight import Flight, fly
from hfa_flight.policies.controller import MeasuredOutputs, Tracked, servo_policy, tracked
from hfa_flight.signals import CommandedStates
from hfa_model import INPUTS, LINEAR_STATES
from hfa_support.errors import refuse_unknown
from hfa_support.files import write_text
from hfa_support.provenance import Provenance
from hfa_support.reporting.data_files import json_text
from hfa_support.reporting.figure import new_figure, save
from hfa_support.reporting.text import Table
from studies.finished import finished, stamped
from studies.servo.flights import equal_actuators
from studies.servo.simvfa import REGULATED, adaptive_law, reference_servo

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Dihedral angle of the trim at which all flights begin, deg, and breakpoints of SimVFA's tables,
#: rad.
TRIM_DEG = 11.0
ANGLES = np.radians(np.arange(21.0))
#: Interval between command steps, s. The first is at `_FIRST`, and the flight ends after the last.
_EACH = 70.0
_FIRST = 1.0
_DIHEDRAL = np.radians([1.0, 2, 1, 2, 1, 2, -1, 1, 2, 1, 2, 1, 2, -1, 0, 0])
_ACCELERATION = np.array([-1.0, -2, -1, -2, -1, -2, 1, -1, -2, -1, -2, -2, 1, 1, 0, 0])
DURATION = _FIRST + _EACH * (len(_DIHEDRAL) - 1)
#: Time step of the record, s.
STEP = 0.02
HEADER = ("law", "rms dihedral deg", "rms A_z ft/s^2", "fastest surface deg/s", "outcome")


class Case(NamedTuple):
    """A case of the comparison: the actuators and their faults.

    actuator: dynamics of every actuator
    faults: faults of the actuators
    """

    actuator: Actuator
    faults: tuple[ActuatorFault, ...] = ()


CASES: dict[str, Case] = {
    "order-1": Case(Actuator(1)),
    "order-1-half": Case(Actuator(1, effectiveness=0.5)),
    "order-1-fault": Case(Actuator(1), (ActuatorFault(0.0, 0.2, 0.5, inputs=INPUTS[1:]),)),
    "order-2": Case(Actuator(2)),
    "order-2-half": Case(Actuator(2, effectiveness=0.5)),
    "order-2-fault": Case(Actuator(2), (ActuatorFault(0.0, 0.2, 0.5, 0.8, inputs=INPUTS[1:]),)),
    "fast-1": Case(Actuator(1, 10.0)),
    "fast-2": Case(Actuator(2, 10.0)),
}


def simvfa_commands() -> CommandSteps:
    """Return SimVFA's 16 command steps, with its command filter.

    The commands are the dihedral angle in rad and the vertical acceleration in ft/s².
    """
    times = _FIRST + _EACH * np.arange(len(_DIHEDRAL))
    return CommandSteps(REGULATED, times, np.column_stack([_DIHEDRAL, _ACCELERATION]))


def scenario_of(case: Case, commands: CommandSteps, duration: float = DURATION) -> Scenario:
    """Return the scenario of a case.

    duration: s

    Raises BadInputError if the duration exceeds that of the commands.
    """
    if duration > DURATION:
        raise BadInputError(
            f"duration is {duration:g} s, but the commands end after {DURATION:g} s; shorten it"
        )
    actuators = equal_actuators(case.actuator, case.faults)
    return Scenario(
        duration=duration,
        step=STEP,
        tick=STEP,
        reference=CommandedStates(commands, LINEAR_STATES),
        actuators=actuators,
    )


class Start(NamedTuple):
    """Values from which each control law is made: aircraft, trim and commands."""

    aircraft: Model
    point: OperatingPoint
    commands: CommandSteps


Make = Callable[[Start], Policy]


def laws_of(
    order: int, controllers: Mapping[str, ScheduledController], only: Sequence[str] = ()
) -> dict[str, Make]:
    """Return functions that make the control laws from a `Start`, by name of the law.

    order: order of the actuators for which SimVFA's laws are designed
    controllers: further controllers by name
    only: names of the laws to return, () for all

    Raises BadInputError if a name in `only` is unknown.
    """
    found: dict[str, Make] = {
        f"simvfa-{order}": lambda on: _servo(
            on, reference_servo(on.aircraft, f"simvfa-{order}", ANGLES)
        ),
        f"simvfa-{order} adaptive": lambda on: adaptive_law(
            order, on.aircraft, on.point, on.commands, ANGLES
        ),
    }
    found["servo"] = lambda on: _servo(on, designed_servo(on.aircraft))
    found |= {name: lambda on, each=each: _servo(on, each) for name, each in controllers.items()}  # type: ignore[misc]
    found["paper"] = _paper
    for name in only:
        refuse_unknown(f"order {order} has no law", name, found)
    return {name: made for name, made in found.items() if name in (only or found)}


def _servo(on: Start, controller: ScheduledController) -> Policy:
    return servo_policy(controller, on.commands, on.aircraft, on.point)


@lru_cache(maxsize=2)
def designed_servo(aircraft: Model) -> ScheduledController:
    """Return the project's servo controller, designed at the breakpoints of its design file."""
    design = load_design("servo", hfa.aircraft()).of(aircraft)
    assert design.shaping is not None  # of the servo design
    return design_controller(aircraft, design, np.array(design.shaping.breakpoints))


def _paper(on: Start) -> Policy:
    """Return the exact policy of the paper's game at the trim."""
    model = linearize(on.aircraft, on.point)
    return GainPolicy("paper", solve(published_game(model.A, model.B)).K)


@dataclass(frozen=True, eq=False)
class ServoFlight:
    """Flight of one control law in a case.

    tracked: response of each commanded output
    fastest: largest rate of a surface, rad/s
    result: the simulated flight
    """

    law: str
    tracked: list[Tracked]
    fastest: float
    result: Flight

    @property
    def times(self) -> np.ndarray:
        """Times of the flight, (N,), s."""
        return self.result.flight.times

    @property
    def lost_at(self) -> float | None:
        """Time when a state left the envelope, s, or None if all states stayed within the
        envelope.
        """
        return None if self.result.departure is None else self.result.departure.time

    def to_dict(self) -> dict[str, Any]:
        """Return the results for JSON, in English units and radians."""
        gone = self.result.departure
        units = {each.name: each.unit for each in self.tracked}
        return {
            "law": self.law,
            "rms_error": {each.name: each.rms for each in self.tracked},
            "rms_error_units": units,
            "largest_error": {each.name: each.largest for each in self.tracked},
            "largest_error_units": units,
            "fastest_surface": self.fastest,
            "lost_at": self.lost_at,
            "left": None if gone is None else gone.state,
        }


def fly_case(
    aircraft: Model,
    case: Case,
    controllers: Mapping[str, ScheduledController],
    duration: float = DURATION,
    only: Sequence[str] = (),
    commands: CommandSteps | None = None,
) -> Iterator[ServoFlight]:
    """Yield the flight of each control law under the commands and faults of a case.

    controllers: further controllers by name
    duration: s
    only: names of the laws to simulate, () for all
    commands: commands of the flights, or None for SimVFA's
    """
    commands = commands or simvfa_commands()
    scenario = scenario_of(case, commands, duration)
    point = trim(aircraft, level_flight(float(np.radians(TRIM_DEG))))
    envelope = flight_envelope(aircraft, point)
    outputs = MeasuredOutputs(aircraft, point, commands.names)
    for law, make in laws_of(case.actuator.order, controllers, only).items():
        made = make(Start(aircraft, point, commands))
        result = fly(aircraft, point, made, scenario=scenario, envelope=envelope, predict=False)
        moved = np.abs(np.diff(result.flight.inputs[:, 1:], axis=0)).max(
            initial=0.0
        )  # without the throttle
        times = result.flight.times[:2]
        yield ServoFlight(
            law, tracked(result.flight, outputs, commands), float(moved / np.ptp(times)), result
        )


def run_case(
    aircraft: Model,
    name: str,
    controllers: Mapping[str, ScheduledController],
    folder: Path,
    origin: Provenance,
    *,
    duration: float = DURATION,
    only: Sequence[str] = (),
    resume: bool = False,
) -> dict[str, Any]:
    """Simulate a case of `CASES`, write FOLDER/NAME.json and FOLDER/NAME.png, and return the
    result.

    name: name of the case
    controllers: further controllers by name
    duration: s
    only: names of the laws to simulate, () for all
    resume: whether to reuse a stored result of this version for the same aircraft, laws and
      duration
    """
    target = folder / f"{name}.json"
    picture = folder / f"{name}.png"
    case = CASES[name]
    decides = {
        "case": name,
        "actuator": vars(case.actuator),
        "faults": [vars(fault) for fault in case.faults],
        "dynamics": hfa_model.variant_of(aircraft).name,
        "parameters": hfa_model.parameters_of(aircraft)._asdict(),
        "duration": duration,
        "laws": list(laws_of(case.actuator.order, controllers, only)),
        "controllers": {
            key: {part: getattr(made, part) for part in ("breakpoints", "A", "B", "C", "D", "W")}
            for key, made in controllers.items()
        },
    }
    known = finished(target, decides) if resume and picture.is_file() else None
    if known is not None:
        return known
    flights = tuple(fly_case(aircraft, case, controllers, duration, only))
    result = {"case": name, "dynamics": hfa_model.variant_of(aircraft).name, "duration": duration}
    result |= {"flights": [flight.to_dict() for flight in flights], "provenance": origin.to_dict()}
    folder.mkdir(parents=True, exist_ok=True)
    save(servo_figure(name, flights), picture, origin.text())
    result = stamped(result, decides)
    write_text(target, json_text(result))
    return result


def servo_report(results: Sequence[Mapping[str, Any]]) -> Report:
    """Return a report with a table of errors, surface rates and outcomes for each case."""
    blocks = []
    for result in results:
        title = f"case {result['case']}, {result['dynamics']} dynamics, {result['duration']:g} s"
        blocks.append((title, Table(HEADER, rows_of(result))))
    title = "Servos through the commands and the actuator faults of SimVFA"
    return Report(title, blocks, data={"cases": list(results)})


def rows_of(result: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table rows of a case, one for each law.

    A row contains the name of the law, the rms errors of the dihedral angle (deg) and of the
    vertical acceleration (ft/s²), the largest surface rate (deg/s) and the outcome.
    """
    rows: list[tuple[str, ...]] = []
    for flight in result["flights"]:
        angle, acceleration = (flight["rms_error"][name] for name in REGULATED)
        lost = flight["lost_at"]
        outcome = "held" if lost is None else f"{flight['left']} left at {lost:.4g} s"
        rate = f"{math.degrees(flight['fastest_surface']):.3g}"
        rows.append(
            (flight["law"], f"{math.degrees(angle):.3f}", f"{acceleration:.3f}", rate, outcome)
        )
    return rows


def servo_figure(title: str, flights: Sequence[ServoFlight]) -> Figure:
    """Return a figure of the flights of all laws in a case.

    For each commanded output, one panel shows the output with its command and another the error. A
    cross marks the end of a flight that left the envelope.
    """
    longest = max(flights, key=lambda flight: len(flight.times))
    held = [flight for flight in flights if flight.lost_at is None] or [longest]
    figure = new_figure(10.4, 6.4)
    panels = figure.subplots(2, 2, sharex=True, squeeze=False)
    for column, each in enumerate(longest.tracked):
        unit, size = ("deg", math.degrees(1.0)) if each.unit == "rad" else (each.unit, 1.0)
        above, below = panels[:, column]
        above.plot(
            longest.times, size * each.command, ":", color="black", zorder=5, label="command"
        )
        for flight, style in zip(
            flights, itertools.cycle(("-", "--", "-.", (0, (1, 1)))), strict=False
        ):
            followed = flight.tracked[column]
            values = size * followed.output, size * (followed.output - followed.command)
            for axes, value in zip((above, below), values, strict=True):
                end = [len(value) - 1] if flight.lost_at is not None else []
                axes.plot(
                    flight.times,
                    value,
                    linestyle=style,
                    linewidth=1.2,
                    label=flight.law,
                    marker="x",
                    markevery=end,
                )
        largest = size * max(flight.tracked[column].largest for flight in held)
        below.set_ylim(-1.05 * largest, 1.05 * largest)  # without lost flights
        above.set_ylim(
            *(size * np.array([each.command.min(), each.command.max()]) + [-largest, largest])
        )
        above.set_title(each.name, fontsize=9)
        above.set_ylabel(f"off trim, {unit}", fontsize=8)
        below.set_ylabel(f"off its command, {unit}", fontsize=8)
        below.set_xlabel("time, s", fontsize=8)
    for axes in panels.flat:
        axes.grid(alpha=0.3)
        axes.tick_params(labelsize=7)
    figure.legend(
        handles=panels[0, 0].lines, loc="outside upper center", ncols=4, fontsize=8, title=title
    )
    return figure
