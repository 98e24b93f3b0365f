"""Turbulence and gusts of a linear loop: against its frequency response, and against a second integration."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from known_models import model_at
from scipy.integrate import quad
from servo_cases import measured_servo

from controller import (
    Actuator,
    ActuatorFault,
    Actuators,
    CommandSteps,
    DesignModel,
    OneMinusCosine,
    Scenario,
    ScheduledController,
    flight_envelope,
    servo_law,
)
from controller.design.design import Feedforward
from controller.design.servo_loop import ServoLoop, servo_loop, servo_plant
from controller.flight.nonlinear_flight import NonlinearFlight, fly_law
from controller.flight.plants import NonlinearPlant
from hfa_model import STATES, Aircraft, Input
from verification.synthesis import moving_air
from verification.synthesis.design_evaluation import quick_controller
from verification.synthesis.moving_air import LARGEST, gust_held, gust_share, turbulence_rms
from verification.synthesis.tuning import InGust

SIGMA, SCALE, LENGTH = 3.0, 1750.0, 400.0


@cache
def _table() -> ScheduledController:
    return quick_controller(Aircraft(), model_at(11.0), measured_servo(feedforward=None))


@cache
def closed() -> tuple[DesignModel, ServoLoop]:
    plant = servo_plant(Aircraft(), model_at(11.0), _table(), dict.fromkeys(_table().inputs, Actuator()))
    return plant, servo_loop(plant, _table())


def rms_by_frequency(loop: ServoLoop, row: int, speed: float) -> float:
    """sqrt(1/π ∫ |G|² |H|² dω) of the Dryden filter H, over the logarithm of the frequency."""
    tau = SCALE / speed

    def density(logarithm: float) -> float:
        s = 1j * math.exp(logarithm)
        filtered = SIGMA * math.sqrt(tau) * (1 + math.sqrt(3) * tau * s) / (1 + tau * s) ** 2
        response = np.linalg.solve(s * np.eye(len(loop.closed)) - loop.closed, loop.disturbed)[row, 0]
        return float(abs(filtered * response) ** 2 * abs(s) / math.pi)

    return math.sqrt(quad(density, math.log(1e-4), math.log(1e3), limit=400, epsrel=1e-8)[0])


def test_turbulence_is_the_integral_of_the_frequency_response() -> None:
    plant, loop = closed()
    found, speed = turbulence_rms(plant, loop, SIGMA, SCALE), plant.model.point.states.speed
    for name in ("speed", "dihedral"):
        assert found[name] == pytest.approx(rms_by_frequency(loop, plant.states.index(name), speed), rel=1e-5)
    deaf = replace(loop, F=0.0 * loop.F)  # its accelerometer does not feel the air
    assert turbulence_rms(plant, deaf, SIGMA, SCALE)["dihedral"] > 1.1 * found["dihedral"]


def in_gust(peak: float) -> float:
    return gust_share(Aircraft(), model_at(11.0), _table(), InGust(0.0, Actuator(effectiveness=0.8), LENGTH, peak))


def flown(peak: float) -> NonlinearFlight:
    """The same gust, actuators and controller in a flight by itself, with a finer step."""
    aircraft, point = Aircraft(), model_at(11.0).point
    lowest, highest = (
        Input(200.0 * side, *[math.radians(20) * sign] * 2, *[math.radians(30) * sign] * 2)
        for side, sign in ((0, -1), (1, 1))
    )
    lag, rate = Input(*[0.5] * 5), Input(*[math.inf] * 5)
    scenario = Scenario(
        duration=30.0,
        step=0.005,
        tick=0.5,
        actuators=Actuators(lag, lowest, highest, rate, faults=(ActuatorFault(0.0, 0.8),)),
        gust=OneMinusCosine(LENGTH, peak, point.states.speed),
    )
    law = servo_law(_table(), CommandSteps(("dihedral",), np.zeros(0), np.zeros((0, 1))), aircraft, point)
    return fly_law(NonlinearPlant(aircraft, point), law, scenario, flight_envelope(aircraft.parameters, point))


@pytest.mark.parametrize("peak", [16.0, -16.0])
def test_the_share_of_the_envelope_is_that_of_a_flight_by_itself(peak: float) -> None:
    whole, at, found = flown(peak), model_at(11.0).point.states, 0.0
    flight, envelope = whole.flight, whole.envelope
    for name, column in zip(STATES, flight.states.T, strict=True):
        moved = column + (np.arctan2(flight.updrafts.ravel(), at.speed) if name == "alpha" else 0.0)
        low, high = (getattr(each, name) - getattr(at, name) for each in (envelope.lowest, envelope.highest))
        found = max(found, moved.max() / high, moved.min() / low)
    assert 0.15 < found < 0.9
    assert in_gust(peak) == pytest.approx(found, rel=0.02)


def test_an_aircraft_that_leaves_its_envelope_has_more_than_all_of_it() -> None:
    departure = flown(-25.0).departure
    assert departure is not None
    assert in_gust(-25.0) == pytest.approx(2.0 - departure.time / 30.0, abs=2e-3)


def test_in_a_gust_a_feedforward_does_nothing() -> None:
    """It answers commands, of which there are none."""
    shaped = quick_controller(Aircraft(), model_at(11.0), measured_servo(feedforward=Feedforward(lag=2.0)))
    gust = InGust(0.0, Actuator(effectiveness=0.8), LENGTH, 3.0)
    assert gust_share(Aircraft(), model_at(11.0), shaped, gust) == pytest.approx(in_gust(3.0))


def test_the_gust_that_is_just_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """A little more than what is held ends the flight; what is never ended counts as the largest that is tried."""
    monkeypatch.setattr(moving_air, "APART", apart := 2.0)
    asked = InGust(0.0, Actuator(effectiveness=0.8), LENGTH, 1.0)
    peak = gust_held(Aircraft(), model_at(11.0), _table(), asked)
    assert 0.0 < peak < LARGEST
    assert in_gust(peak) <= 1.0 < in_gust(peak + apart)
    down = gust_held(Aircraft(), model_at(11.0), _table(), asked._replace(peak=-1.0))
    assert in_gust(-down) <= 1.0 < in_gust(-down - apart)
    monkeypatch.setattr(moving_air, "LARGEST", peak - apart)
    assert gust_held(Aircraft(), model_at(11.0), _table(), asked) == peak - apart
