"""What a controller is told of its commands: the integrals of measured minus commanded output, and the feedforward."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from controller.design.design import Design
from controller.design.design_model import DesignModel, design_model
from controller.design.scheduled_controller import COMMAND_SIGNALS
from hfa_model.aircraft import Aircraft
from hfa_model.reporting.checks import Check
from verification.synthesis.regulator import regulator


@dataclass(frozen=True, eq=False)
class LinearController:
    """x' = A x + B [y; w], u = C x + D [y; w] at one angle, W its anti-windup input, and what certifies it."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    W: np.ndarray
    delta_min: float = math.nan
    checks: tuple[Check, ...] = ()


def measurements(design: Design, feedback: str) -> tuple[str, ...]:
    """What must be measured: the sensors, or all states, the integrated outputs in place of their integrals."""
    seen = design.sensors if feedback == "output" else design.plant_states
    plain = [name for name in seen if not name.endswith("_integral")]
    return tuple(dict.fromkeys([*plain, *design.integrals]))


def commands_of(design: Design) -> tuple[str, ...]:
    """What the controller must be told of the commands: r, and for a feedforward r' and r_end too."""
    signals = COMMAND_SIGNALS if design.feedforward else COMMAND_SIGNALS[:1]
    return tuple(f"{name}{signal}" for signal in signals for name in design.integrals)


def with_commands(aircraft: Aircraft, built: DesignModel, found: LinearController) -> LinearController:
    """e' = y - r for the integrals, which are the last states of `found`; with a feedforward what it adds.

    (1 + lag d/dt)² u_ff = share Γ w, and the integrals of the estimator are told known r. found.B, found.D: of the
    measurements; the result's of [measurements; commands].
    """
    design, q, m = built.design, len(built.design.integrals), len(built.inputs)
    n, p, shaping = len(found.A), found.B.shape[1], design.feedforward
    names = measurements(design, "output" if n > q else "state")
    told = np.zeros((n, len(commands_of(design))))
    B, D = np.hstack([found.B, told]), np.hstack([found.D, np.zeros((m, told.shape[1]))])
    for k, output in enumerate(design.integrals):
        B[n - q + k, names.index(output)], B[n - q + k, p + k] = 1.0, -1.0
    if shaping is None:
        return replace(found, B=B, D=D)
    if n > q:
        estimates = slice(n - 2 * q, n - q)
        B[estimates, p : p + q] -= shaping.known * np.eye(q)
    if shaping.share == 0.0:
        return replace(found, B=B, D=D)
    acting = replace(
        design,
        actuators=dict.fromkeys(design.inputs, shaping.actuator),
        sensors=dict.fromkeys(design.integrals, 1.0),
        integrals=(),
        state_weights={},
        disturbances={"states": 1.0},
        sensor_lags={},
        feedforward=None,
    )
    exact = regulator(design_model(aircraft, built.model, acting), shaping)
    u = np.hstack([np.zeros((m, p)), shaping.share * exact.inputs])
    if shaping.lag == 0.0:
        return replace(found, B=B, D=D + u)
    once, nothing = np.eye(m) / shaping.lag, np.zeros((m, m))
    lags = np.block([[-once, nothing], [once, -once]])
    return replace(
        found,
        A=np.block([[lags, np.zeros((2 * m, n))], [np.zeros((n, 2 * m)), found.A]]),
        B=np.vstack([once @ u, np.zeros((m, p + told.shape[1])), B]),
        C=np.hstack([nothing, np.eye(m), found.C]),
        D=D,
        W=np.vstack([nothing, nothing, found.W]),
    )
