"""What a controller is told of its commands: the integrals of measured minus commanded output, and the feedforward."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from controller.design.design import Actuator, Design
from controller.design.design_model import DesignModel, design_model
from controller.design.scheduled_controller import COMMAND_SIGNALS
from hfa_model.aircraft import Aircraft
from hfa_support.reporting.checks import Check
from verification.synthesis.command_shaping import FedBack, best_feedforward, stage_rates


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
    """What the controller must be told of the commands: r, and for a feedforward r_end too."""
    value, _, end = COMMAND_SIGNALS
    return tuple(
        f"{name}{signal}" for signal in (value, *[end] * bool(design.feedforward)) for name in design.integrals
    )


def with_commands(aircraft: Aircraft, built: DesignModel, found: LinearController) -> LinearController:
    """e' = y - r for the integrals, which are the last states of `found`; with a feedforward its stages before them.

    found.B, found.D: of the measurements; the result's of [measurements; commands].
    """
    design, q, m = built.design, len(built.design.integrals), len(built.inputs)
    n, p, shaping = len(found.A), found.B.shape[1], design.feedforward
    names = measurements(design, "output" if n > q else "state")
    B, D = np.hstack([found.B, np.zeros((n, q))]), np.hstack([found.D, np.zeros((m, q))])
    for k, output in enumerate(design.integrals):
        B[n - q + k, names.index(output)], B[n - q + k, p + k] = 1.0, -1.0
    plain = replace(found, B=B, D=D)
    if shaping is None:
        return plain
    loops = [
        _fed_back(
            _with_actuator(aircraft, built, names, actuator), plain, design.integrals, shaping.importance.get(name, 1.0)
        )
        for name, actuator in shaping.actuators.items()
    ]
    best = best_feedforward(loops, design.integrals, built, shaping)
    rates, into = (np.kron(np.eye(q), part) for part in stage_rates(shaping))
    count = len(rates)
    return replace(
        found,
        A=np.block([[rates, np.zeros((count, n))], [np.zeros((n, count)), found.A]]),
        B=np.block([[np.zeros((count, p + q)), into.reshape(q, count).T], [B, np.zeros((n, q))]]),
        C=np.hstack([best.gains, found.C]),
        D=np.hstack([D, np.zeros((m, q))]),
        W=np.vstack([np.zeros((count, m)), found.W]),
        checks=(*found.checks, *best.checks),
    )


def _with_actuator(aircraft: Aircraft, built: DesignModel, names: tuple[str, ...], actuator: Actuator) -> DesignModel:
    """The plant that measures `names`, with this actuator at every input."""
    design = replace(
        built.design,
        actuators=dict.fromkeys(built.inputs, actuator),
        sensors=dict.fromkeys(names, 1.0),
        integrals=(),
        state_weights={},
        disturbances={"states": 1.0},
        sensor_lags={},
        feedforward=None,
    )
    return design_model(aircraft, built.model, design)


def _fed_back(plant: DesignModel, plain: LinearController, outputs: tuple[str, ...], importance: float) -> FedBack:
    """The loop of a plant whose inputs act through actuators, with a controller without a feedforward."""
    p, nothing = len(plant.C), np.zeros((len(plain.A), len(plant.inputs)))
    return FedBack(
        A=np.block(
            [[plant.A + plant.B @ plain.D[:, :p] @ plant.C, plant.B @ plain.C], [plain.B[:, :p] @ plant.C, plain.A]]
        ),
        told=np.vstack([plant.B @ plain.D[:, p:], plain.B[:, p:]]),
        moved=np.vstack([plant.B, nothing]),
        errors=np.hstack(
            [plant.C[[plant.sensors.index(name) for name in outputs]], np.zeros((len(outputs), len(plain.A)))]
        ),
        positions=tuple(plant.states.index(f"{name}_position") for name in plant.inputs),
        importance=importance,
    )
