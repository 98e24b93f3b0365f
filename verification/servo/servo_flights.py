"""The flights of `hfa servo`: a case under every law, kept as it is finished."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from controller.design.design import signal_unit
from controller.design.scheduled_controller import ScheduledController
from controller.flight.envelope import flight_envelope, share_of_way
from controller.flight.nonlinear_flight import NonlinearFlight, fastest_inputs, fly_law, tracked
from controller.flight.plants import NonlinearPlant
from controller.policy.servo_policy import MeasuredOutputs
from hfa_model.aircraft import Aircraft
from hfa_model.provenance import Provenance
from hfa_model.units_of_data import in_units_in_force
from hfa_support.files import write_text
from hfa_support.jobs.finished import finished, stamped
from hfa_support.jsonable import records_text
from hfa_support.progress import NamedProgress
from hfa_support.reporting.figure import save
from hfa_support.reporting.report import Report
from hfa_support.reporting.unit_system import english, system_in_force
from trim.point.condition import CONTROL_LIMITS, level_flight
from trim.point.solve import find_operating_point
from verification.servo.cases import CASES, DURATION, TRIM_DEG, Start, laws_of, scenario_of, simvfa_commands
from verification.servo.servo_result import ServoFlight, servo_figure

SCHEMA = "hfa.servo/1"


def fly_case(
    aircraft: Aircraft,
    name: str,
    controllers: Mapping[str, ScheduledController],
    duration: float = DURATION,
    progress: NamedProgress | None = None,
    only: Sequence[str] = (),
) -> tuple[ServoFlight, ...]:
    """Every law, or those named in `only`, through the commands and the fault of a case of `CASES`."""
    case, commands = CASES[name], simvfa_commands()
    scenario = scenario_of(case, commands, duration)
    point = find_operating_point(aircraft, level_flight(float(np.radians(TRIM_DEG))))
    envelope = flight_envelope(aircraft.parameters, point)
    outputs = MeasuredOutputs(aircraft, point, commands.names)
    laws, flights = laws_of(case.order, controllers, only), []
    for count, (law, make) in enumerate(laws.items()):
        if progress is not None:
            progress(f"{name}, {law}", count, len(laws))
        made = make(Start(aircraft, point, commands))
        result = fly_law(NonlinearPlant(aircraft, point), made, scenario, envelope)
        gone = result.departure
        flights.append(
            ServoFlight(
                law,
                result.flight.times,
                tracked(result.flight, outputs, commands),
                float(fastest_inputs(result.flight)[1:].max()),
                None if gone is None else gone.time,
                None if gone is None else gone.state,
                _used(result),
            )
        )
    if progress is not None:
        progress(name, len(laws), len(laws))
    return tuple(flights)


def _used(result: NonlinearFlight) -> dict[str, np.ndarray]:
    """Surfaces (not the throttle) within `CONTROL_LIMITS`, states within the envelope."""
    surfaces = slice(1, None)
    envelope = np.array([result.envelope.lowest, result.envelope.highest]).T
    return {
        "surface": share_of_way(
            result.inputs[:, surfaces], np.array(result.point.inputs)[surfaces], np.array(CONTROL_LIMITS)[surfaces]
        ),
        "state": share_of_way(result.states, np.array(result.point.states), envelope),
    }


def run_case(
    aircraft: Aircraft,
    name: str,
    controllers: Mapping[str, ScheduledController],
    folder: Path,
    origin: Provenance,
    *,
    duration: float = DURATION,
    resume: bool = False,
    progress: NamedProgress | None = None,
    only: Sequence[str] = (),
) -> dict[str, Any]:
    """The result of a case, in FOLDER/CASE.json in the units in force, with its figure beside it.

    resume: one that this version finished for the same aircraft, laws, duration and units is not flown again.
    """
    target, picture = folder / f"{name}.json", folder / f"{name}.png"
    decides = _decides(aircraft, name, controllers, duration) | {
        "laws": list(laws_of(CASES[name].order, controllers, only))
    }
    known = finished(target, decides) if resume and picture.is_file() else None
    if known is not None:
        return _in_english(known)
    flights = fly_case(aircraft, name, controllers, duration, progress, only)
    result = {"schema": SCHEMA, "case": name, "dynamics": aircraft.variant.name, "duration": duration}
    result |= {"flights": [flight.to_dict() for flight in flights], "provenance": origin.to_dict()}
    folder.mkdir(exist_ok=True)
    save(servo_figure(name, flights), picture, origin.text())
    write_text(target, records_text(stamped(in_units_in_force(Report("", data=result)).data, decides)))
    return result


def _in_english(result: dict[str, Any]) -> dict[str, Any]:
    """A result as it was before its file was written."""
    for name in ("units", "toolchain", "identity", "digest"):
        del result[name]
    for flight in result["flights"]:
        for errors in ("rms_error", "largest_error"):
            units = flight[f"{errors}_units"]
            flight[errors] = {
                name: english(error, units[name], signal_unit(name)) for name, error in flight[errors].items()
            }
            flight[f"{errors}_units"] = {name: signal_unit(name) for name in units}
    return result


def _decides(
    aircraft: Aircraft, name: str, controllers: Mapping[str, ScheduledController], duration: float
) -> dict[str, Any]:
    case = CASES[name]
    return {
        "case": name,
        "order": case.order,
        "faults": [vars(fault) for fault in case.faults],
        "dynamics": aircraft.variant.name,
        "parameters": aircraft.parameters._asdict(),
        "duration": duration,
        "units": system_in_force(),
        "controllers": {
            key: {part: getattr(made, part) for part in ("dihedrals", "A", "B", "C", "D", "W")}
            for key, made in controllers.items()
        },
    }
