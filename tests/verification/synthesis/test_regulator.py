"""Francis' equations: the aircraft with exactly these inputs does follow the command filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_models import model_at
from scipy.linalg import expm
from servo_cases import A_Z, measured_servo

from controller import Actuator, DesignModel, design_model
from controller.design.design import Feedforward
from hfa_model import Aircraft, BadInputError
from verification.synthesis.regulator import command_rates, regulator


def plant(aircraft: Aircraft, outputs: tuple[str, ...], order: int = 1) -> DesignModel:
    design = measured_servo(
        integrals=(),
        state_weights={},
        sensors=dict.fromkeys(outputs, 1.0),
        actuators=dict.fromkeys(("aileron_outer", "elevator_center"), Actuator(order=order)),
    )
    return design_model(aircraft, model_at(11.0), design)


@pytest.mark.parametrize("order", [1, 2])
def test_the_outputs_are_the_commands_all_along(published_aircraft: Aircraft, order: int) -> None:
    built, shaping = plant(published_aircraft, ("dihedral", A_Z), order), Feedforward()
    found = regulator(built, shaping)
    n, w = len(built.A), np.array([0.01, -0.2, 0.003, 0.1, 0.05, -1.0])
    whole = np.block([[built.A, built.B @ found.inputs], [np.zeros((6, n)), found.rates]])
    state = expm(4.0 * whole) @ np.concatenate([found.states @ w, w])
    np.testing.assert_allclose(built.C @ state[:n], state[n : n + 2], rtol=1e-9)
    assert np.abs(state[n : n + 2] - w[:2]).max() > 0.01


def test_the_command_filter_goes_to_its_end_as_its_equation_says() -> None:
    S = command_rates(Feedforward(bandwidth=0.5, damping=2.0), 1)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(S)), [-1.8660254, -0.1339746, 0.0], atol=1e-7)
    np.testing.assert_allclose(expm(200.0 * S) @ [0.0, 0.0, 3.0], [3.0, 0.0, 3.0], atol=1e-9)


@pytest.mark.parametrize("outputs", [("pitch_rate",), ("dihedral", "vertical_acceleration")])
def test_an_output_that_no_input_holds_is_refused(published_aircraft: Aircraft, outputs: tuple[str, ...]) -> None:
    built = plant(published_aircraft, outputs)
    with pytest.raises(BadInputError, match=f"no input makes {' and '.join(outputs)} follow their commands"):
        regulator(replace(built), Feedforward())
