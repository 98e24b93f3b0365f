"""What a controller is told of its commands: the integrals of measured minus commanded output, and the feedforward."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from controller.design.design import Design
from controller.design.design_model import DesignModel, design_model
from controller.design.scheduled_controller import COMMAND_SIGNALS
from hfa_model.aircraft import Aircraft
from hfa_model.support.checks import Check
from hfa_model.vectors import STATES
from verification.servo.regulator import Regulator, regulator


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


def with_commands(aircraft: Aircraft, built: DesignModel, feedback: str, found: LinearController) -> LinearController:
    """With the integrals of measured minus commanded output, and the feedforward where the design has one.

    On the feedforward's own response y = Y w the controller sees no error: it is fed y - Y w, and u_ff is added.
    """
    design, names = built.design, measurements(built.design, feedback)
    q, n, m = len(design.integrals), len(found.A), len(built.inputs)
    B, D = found.B.copy(), found.D.copy()
    first = n - q
    for k, output in enumerate(design.integrals):
        B[first + k, names.index(output)] = 1.0
    shaping = design.feedforward
    if shaping is None:
        told = np.zeros((n, q))
        told[first:] = -np.eye(q)
        return replace(found, B=np.hstack([B, told]), D=np.hstack([D, np.zeros((m, q))]))
    outputs = dict.fromkeys(design.integrals, 1.0)
    acting = replace(
        design,
        actuators=dict.fromkeys(design.inputs, shaping.actuator),
        sensors=outputs,
        integrals=(),
        state_weights={},
        disturbances={"states": 1.0},
        sensor_lags={},
        feedforward=None,
    )
    exact = regulator(design_model(aircraft, built.model, acting), shaping)
    seen = _seen(aircraft, built, acting, names, exact)
    wanted = np.eye(q, len(COMMAND_SIGNALS) * q)
    for k, output in enumerate(design.integrals):
        seen[names.index(output)] = wanted[k]
    u = shaping.share * exact.inputs
    B, D = np.hstack([B, -B @ seen]), np.hstack([D, -D @ seen])
    if shaping.lag == 0.0:
        return replace(found, B=B, D=D + np.hstack([np.zeros((m, len(names))), u]))
    lag = np.eye(m) / shaping.lag
    return replace(
        found,
        A=np.block([[-lag, np.zeros((m, n))], [np.zeros((n, m)), found.A]]),
        B=np.vstack([np.hstack([np.zeros((m, len(names))), lag @ u]), B]),
        C=np.hstack([np.eye(m), found.C]),
        D=D,
        W=np.vstack([np.zeros((m, m)), found.W]),
    )


def _seen(
    aircraft: Aircraft, built: DesignModel, acting: Design, names: tuple[str, ...], exact: Regulator
) -> np.ndarray:
    """Y with y = Y w: what is measured while the aircraft follows the command filter exactly, (p, 3q)."""
    seen = np.zeros((len(names), exact.states.shape[1]))
    outputs = [name for name in names if not name.endswith("_rate") or name in STATES]
    plant = design_model(aircraft, built.model, replace(acting, sensors=dict.fromkeys(outputs, 1.0)))
    response = plant.C @ exact.states + plant.D @ exact.inputs
    for row, name in enumerate(names):
        if name in outputs:
            seen[row] = response[outputs.index(name)]
        else:
            seen[row] = response[outputs.index(f"{name.removesuffix('_rate')}_position")] @ exact.rates
    return seen
