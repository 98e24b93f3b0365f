"""Loops with memory and actuators: the matrix of the table, and proofs about it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_models import exact_gain, model_at
from proof_cases import ORIGIN, family, forge

from controller import ScheduledController
from controller.design.design import Actuator
from hfa_model import INPUTS, LINEAR_STATES
from hfa_support import BadInputError
from verification import check_certificate, prove_rate, prove_schedule
from verification.arithmetic.balls import doubles
from verification.checker.checker import Rejected
from verification.enclosures.place_box import PlaceBox
from verification.enclosures.trim_branch import TrimBranch
from verification.proof.certificate_file import ScheduleCertificate
from verification.proof.schedule_proof import joined
from verification.proof.scheduled_loop import closed_loop, servo_table

ACCELERATION = "vertical_acceleration_short_period"
SENSORS = (*LINEAR_STATES, ACCELERATION)


def filtered(gain: float = 1.0, lag: float = 0.002, direct: float = 0.0) -> ScheduledController:
    """u = -K x_f, x_f' = (y - x_f)/lag, and a filtered acceleration that moves nothing; K of the exact game."""
    angles = np.radians([14.0, 15.0])
    K = np.array([exact_gain(14.0), exact_gain(15.0)])
    n, p, m = len(SENSORS), len(SENSORS), len(INPUTS)
    D = np.zeros((2, m, p))
    D[:, 0, -1] = direct
    C = np.concatenate([-gain * K, np.zeros((2, m, 1))], axis=2)
    eye = np.tile(np.eye(n) / lag, (2, 1, 1))
    return ScheduledController(
        name="filtered",
        feedback="state",
        places=angles,
        A=-eye,
        B=eye,
        C=C,
        D=D,
        W=np.zeros((2, n, m)),
        states=tuple(f"{name}_filtered" for name in SENSORS),
        measurements=SENSORS,
        commands=(),
        inputs=INPUTS,
        trim_states=np.zeros((2, 7)),
        trim_inputs=np.zeros((2, 5)),
        dynamics="published",
        parameters="",
    )


def fast(order: int = 1) -> dict[str, Actuator]:
    return {name: Actuator(order=order, bandwidth=300.0) for name in INPUTS}


@pytest.mark.parametrize("order", [1, 2])
def test_the_loop_is_that_of_its_parts(order: int) -> None:
    """Written out once more, block by block, at an angle of the table."""
    controller, model = filtered(), model_at(14.0)
    table, m, n = servo_table(controller, fast(order), 68.0, family().model), len(INPUTS), len(SENSORS)
    zero = np.zeros
    w, d = 300.0, 0.7
    acceleration = zero((1, 6))
    acceleration[0, 1] = 68.0 * model.A[1, 1]
    y_x, y_a = np.vstack([np.eye(6), acceleration]), np.vstack([zero((6, m)), 68.0 * model.B[1:2]])
    A, B, C = controller.A[0], controller.B[0], controller.C[0]
    if order == 1:
        rows = [
            [model.A, model.B, zero((6, n))],
            [zero((m, 6)), -w * np.eye(m), w * C],
            [B @ y_x, B @ y_a, A],
        ]
    else:
        rows = [
            [model.A, model.B, zero((6, m)), zero((6, n))],
            [zero((m, 6)), zero((m, m)), w * np.eye(m), zero((m, n))],
            [zero((m, 6)), -w * np.eye(m), -2 * d * w * np.eye(m), w * C],
            [B @ y_x, B @ y_a, zero((n, m)), A],
        ]
    low = 14.0
    loop = closed_loop(table, TrimBranch(family()).forms(PlaceBox(low, low + 2.0**-30)))
    expected = np.block(rows)
    np.testing.assert_allclose(doubles(loop.parts[0]), expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("apart", [0.0, 200.0])
def test_a_loop_with_memory_may_move_as_fast_as_is_proved_and_verified(tmp_path: Path, apart: float) -> None:
    """Filters and actuators of different speed, and of the same: modes that are equal, in their vectors too."""
    controller, path = filtered(), tmp_path / "certificate.json"
    speeds = np.diag(np.linspace(400.0, 400.0 + apart, len(SENSORS)))
    controller = replace(controller, A=-np.array([speeds, speeds]), B=np.array([speeds, speeds]))
    actuators = {name: Actuator(order=1, bandwidth=200.0 + 0.1 * apart * i) for i, name in enumerate(INPUTS)}
    table = servo_table(controller, actuators, 68.0, family().model)
    proof, motion = prove_schedule(family(), table, 14.0, 14.125), prove_rate(family(), table, 14.0, 14.125)
    assert proof.proved
    assert 0.2 < proof.rate < 0.4
    assert motion.rate > 0.1
    ScheduleCertificate(family(), table, 14.0, 14.125, path, ORIGIN).finish(proof, motion)
    found = check_certificate(path)
    assert [joined(found.covers[name]) for name in ("loop", "motion")] == [[(14.0, 14.125, 0)]] * 2
    assert found.rate == proof.rate
    content = json.loads(path.read_text())
    content["statement"]["place_rate"] *= 3.0
    forge(path, content)
    with pytest.raises(Rejected, match="motion from 14"):
        check_certificate(path)


def test_a_lag_that_is_too_long_is_refuted() -> None:
    proof = prove_schedule(family(), servo_table(filtered(lag=20.0), fast(), 68.0, family().model), 14.0, 14.25)
    assert proof.refuted
    assert not proof.proved


def test_what_a_proof_does_not_take_is_said() -> None:
    with pytest.raises(BadInputError, match="throttle has no actuator"):
        servo_table(filtered(), {}, 68.0, family().model)
    with pytest.raises(BadInputError, match="reaches the inputs at once"):
        servo_table(filtered(direct=1.0), fast(), 68.0, family().model)
