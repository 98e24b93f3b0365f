"""One flight of the nonlinear aircraft under a policy, beside what the linear model predicts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from controller.flight.actuators import LONGEST_STEP
from controller.flight.closed_loop import CompiledLoop, Flight
from controller.flight.envelope import Envelope
from controller.flight.flight_result import NonlinearFlight
from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from controller.flight.scenario import Scenario, loop_of, with_errors
from controller.flight.uncertain import Uncertainty
from controller.policy.flown_law import FlownLaw
from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from trim.point.operating_point import OperatingPoint


def fly(
    aircraft: Aircraft,
    point: OperatingPoint,
    law: FlownLaw,
    scenario: Scenario,
    envelope: Envelope,
    *,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """X' = f(X, U, w) + d with U = U0 + u of the law, and its linear prediction x' = A x + B u + b w + d.

    The prediction is of the aircraft as designed: without the parameter errors. Both end at the first tick in
    which the nonlinear flight leaves the envelope.
    """
    result = fly_law(NonlinearPlant(with_errors(aircraft, scenario), point), law, scenario, envelope, progress=progress)
    ticks = (len(result.flight.times) - 1) // scenario.steps_per_tick
    model = LinearizedAircraft.at(aircraft, point)
    predicted = CompiledLoop(loop_of(model, law.policy, scenario, point))
    return replace(result, predicted=_flown(predicted, law, scenario, ticks))


def fly_law(
    plant: NonlinearPlant,
    law: FlownLaw,
    scenario: Scenario,
    envelope: Envelope,
    *,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """The nonlinear aircraft under a law, without a prediction.

    BadInputError when it does not begin inside the envelope, or part of the scenario is still to be drawn.
    """
    if scenario.uncertainty != Uncertainty():
        raise BadInputError("part of the scenario is still to be drawn; simulate scenario.drawn(seed, member, speed)")
    offsets = np.array(plant.point.states)
    loop = loop_of(plant, law.policy, scenario, plant.point)
    compiled = CompiledLoop(loop)
    start = loop.start(scenario.initial, law.memory)
    air = compiled.updrafts(np.zeros(1), start[None], loop.constants(law.constants)(0))
    envelope.refuse_start(scenario.initial + offsets, air)

    def left(times: np.ndarray, y: np.ndarray, p: np.ndarray) -> bool:
        return not bool(envelope.inside(loop.parts(y)[0] + offsets, compiled.updrafts(times, y, p)).all())

    flight = _flown(compiled, law, scenario, scenario.ticks, progress=progress, stop=left)
    updrafts = flight.updrafts if scenario.moving_air else None
    departure = envelope.departure(flight.times, flight.states + offsets, updrafts)
    return NonlinearFlight(scenario, plant.point, envelope, loop, flight, None, departure)


def _flown(compiled: CompiledLoop, law: FlownLaw, scenario: Scenario, ticks: int, **options: Any) -> Flight:
    """So many ticks of the scenario; stiff where the law has modes that Runge-Kutta 4 cannot follow with its step."""
    return compiled.fly(
        scenario.initial,
        law.constants,
        step=scenario.step,
        steps_per_tick=scenario.steps_per_tick,
        ticks=ticks,
        memory=law.memory,
        stiff=law.fastest * scenario.step > LONGEST_STEP,
        **options,
    )
