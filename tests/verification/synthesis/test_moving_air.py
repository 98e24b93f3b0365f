"""Turbulence and gusts of a linear loop: against its frequency response, and against a second integration."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from servo_cases import measured_servo, model_at

from controller.design.design import Actuator
from controller.design.design_model import DesignModel
from controller.flight.envelope import Envelope, flight_envelope
from hfa_model import Aircraft
from verification.synthesis.design_evaluation import quick_controller
from verification.synthesis.moving_air import gust_stood, turbulence_rms
from verification.synthesis.servo_loop import ServoLoop, servo_loop, servo_plant

SIGMA, SCALE, LENGTH = 3.0, 1750.0, 400.0


@cache
def closed() -> tuple[DesignModel, ServoLoop]:
    aircraft, model = Aircraft(), model_at(11.0)
    table = quick_controller(aircraft, model, measured_servo(feedforward=None))
    plant = servo_plant(aircraft, model, table, dict.fromkeys(table.inputs, Actuator()))
    return plant, servo_loop(plant, table)


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


def shares(plant: DesignModel, loop: ServoLoop, envelope: Envelope, peak: float) -> dict[str, float]:
    """Largest share of the way to its limit, of every limited quantity, in one gust."""
    V, x0 = plant.model.point.states.speed, plant.model.point.states

    def gust(t: np.ndarray | float) -> np.ndarray:
        phase = 2 * np.pi * np.minimum(V * np.asarray(t) / LENGTH, 1.0)
        return peak / 2 * (1 - np.cos(phase))

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        return np.asarray(loop.closed @ x + loop.disturbed[:, 0] * gust(t))

    times = np.linspace(0.0, 35.0, 1401)
    x = solve_ivp(rate, (0.0, 35.0), np.zeros(len(loop.closed)), t_eval=times, rtol=1e-8, atol=1e-10, method="LSODA").y
    found = {}
    for name in ("speed", "alpha", "pitch", "pitch_rate", "dihedral", "dihedral_rate"):
        moved = x[plant.states.index(name)] + (gust(times) / V if name == "alpha" else 0.0)
        limits = getattr(envelope.lowest, name) - getattr(x0, name), getattr(envelope.highest, name) - getattr(x0, name)
        found[name] = max(moved.max() / limits[1], moved.min() / limits[0])
    for name, limit in (("aileron_outer", 20.0), ("elevator_center", 30.0)):
        moved, trim = x[plant.states.index(f"{name}_position")], getattr(plant.model.point.inputs, name)
        found[name] = max(moved.max() / (math.radians(limit) - trim), -moved.min() / (math.radians(limit) + trim))
    return found


def test_the_gust_that_is_stood_brings_one_limit_and_no_more() -> None:
    plant, loop = closed()
    envelope = flight_envelope(Aircraft().parameters, plant.model.point)
    peak = gust_stood(plant, loop, envelope, LENGTH)
    both = [shares(plant, loop, envelope, sign * peak) for sign in (1.0, -1.0)]
    worst = max(max(each.values()) for each in both)
    assert worst == pytest.approx(1.0, abs=5e-3)
    narrow = replace(envelope, highest=envelope.highest._replace(pitch=plant.model.point.states.pitch + 1e-3))
    assert gust_stood(plant, loop, narrow, LENGTH) < 0.2 * peak
