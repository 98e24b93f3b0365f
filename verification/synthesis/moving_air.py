"""What moving air does to a linear loop: root mean squares in turbulence, and the largest gust that it stands."""

from __future__ import annotations

import math

import numpy as np

from controller.design.design_model import DesignModel
from controller.flight.envelope import Envelope
from hfa_model.vectors import INPUTS, LINEAR_STATES
from trim.point.condition import CONTROL_LIMITS
from verification.synthesis.servo_loop import ServoLoop

#: s: longest step of the record of a gust, and how long a flight is looked at after the gust.
STEP, SECONDS = 0.05, 30.0


def turbulence_rms(plant: DesignModel, loop: ServoLoop, intensity: float, scale: float) -> dict[str, float]:
    """Root mean square of every state of the plant in stationary Dryden turbulence, in its unit.

    w = sigma sqrt(τ) (1 + √3 τ s) / (1 + τ s)² n,  τ = scale / V,  n white: A_t P + P A_t' + b b' = 0 of the loop with
    the filter of the air. intensity: sigma, ft/s. scale: ft. The loop must be stable. Source: MIL-F-8785C, 3.7.1.2.
    """
    from scipy.linalg import solve_continuous_lyapunov

    tau = scale / plant.model.point.states.speed
    air = np.array([[0.0, 1.0], [-1.0 / tau**2, -2.0 / tau]])
    w = intensity * math.sqrt(tau) * np.array([[1.0, math.sqrt(3.0) * tau]])
    total = _with_air(loop, air, w)
    white = np.zeros((len(total), 1))
    white[-1] = 1.0 / tau**2
    covariance = solve_continuous_lyapunov(total, -white @ white.T)
    rms = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return dict(zip(plant.states, rms.tolist(), strict=False))


def gust_stood(plant: DesignModel, loop: ServoLoop, envelope: Envelope, length: float) -> float:
    """Largest |peak|, ft/s, of w = peak/2 (1 - cos(2π V t / length)), up or down, that the linear loop stands.

    Every state stays in the envelope, alpha through the air too, and every position within `CONTROL_LIMITS`, for
    `SECONDS`. length: ft.
    """
    from scipy.linalg import expm

    point = plant.model.point
    frequency = 2.0 * math.pi * point.states.speed / length
    turning = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, frequency], [0.0, -frequency, 0.0]])  # 1, cos, -sin
    total = _with_air(loop, turning, np.array([[0.5, -0.5, 0.0]]))
    during = math.ceil(length / point.states.speed / STEP)
    step = length / point.states.speed / during
    inside, outside = expm(step * total), expm(step * _with_air(loop, turning, np.zeros((1, 3))))
    record = np.zeros((during + round(SECONDS / STEP) + 1, len(total)))
    record[0, -3:] = 1.0, 1.0, 0.0
    for k in range(len(record) - 1):
        record[k + 1] = (inside if k < during else outside) @ record[k]
    w = 0.5 * (record[:, -3] - record[:, -2]) * (np.arange(len(record)) <= during)
    stood = math.inf
    for column, (value, lowest, highest) in enumerate(_limits(plant, envelope)):
        moved = record[:, column] + (w / point.states.speed if plant.states[column] == "alpha" else 0.0)
        for largest in (moved.max(), -moved.min()):  # the smaller of both directions of the gust
            stood = min(stood, min(highest - value, value - lowest) / max(float(largest), 1e-12))
    return stood


def _limits(plant: DesignModel, envelope: Envelope) -> list[tuple[float, float, float]]:
    """Value at trim, lowest and highest of each state of the plant, the aircraft's six and positions."""
    point, found = plant.model.point, []
    for name in plant.states:
        of, _, what = name.rpartition("_")
        if name in LINEAR_STATES:
            found.append(tuple(getattr(each, name) for each in (point.states, envelope.lowest, envelope.highest)))
        elif of in INPUTS and what == "position":
            found.append((getattr(point.inputs, of), *getattr(CONTROL_LIMITS, of)))
        else:
            found.append((0.0, -math.inf, math.inf))
    return found


def _with_air(loop: ServoLoop, air: np.ndarray, w: np.ndarray) -> np.ndarray:
    """The matrix of [x; x_c; states of the air], their output w being the updraft."""
    n = len(loop.closed)
    return np.block([[loop.closed, loop.disturbed @ w], [np.zeros((len(air), n)), air]])
