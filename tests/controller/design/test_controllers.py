"""Controllers of a design: the loop has the poles of the exact solution, whatever the path, and the names fit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from known_models import model_at
from servo_cases import A_Z, measured_servo, simvfa_design

from controller import design_model
from controller.design.controllers import LinearController, controller_at, design_controller
from controller.design.design import Design
from controller.design.servo_loop import servo_plant
from controller.riccati.generalized_plant import closed_loop
from hfa_model import Aircraft
from hfa_support import NoSolutionError
from verification import GeneralizedPlant, solve_game, solve_plant

ANGLES = np.radians([9.0, 11.0])


def whole(aircraft: Aircraft, design: Design) -> tuple[np.ndarray, LinearController]:
    """The closed loop of the design's own plant and its controller at 11 deg, commands at rest."""
    model = model_at(11.0)
    found = controller_at(aircraft, model, design)
    told: list[tuple[int, int]] = []
    table = design_controller(aircraft, design, ANGLES, progress=lambda *at: told.append(at))
    assert told == [(1, 2), (2, 2)]
    plant = servo_plant(aircraft, model, table, design.actuators)
    measured = len(table.measurements)
    B, D = found.B[:, :measured], found.D[:, :measured]
    for part in "ABCDW":
        np.testing.assert_array_equal(getattr(table, part)[1], getattr(found, part))
    return np.block([[plant.A + plant.B @ D @ plant.C, plant.B @ found.C], [B @ plant.C, found.A]]), found


def same_poles(loop: np.ndarray, poles: np.ndarray) -> None:
    order = lambda values: np.sort_complex(np.round(values, 7))  # noqa: E731
    np.testing.assert_allclose(order(np.linalg.eigvals(loop)), order(poles), atol=1e-6)


@pytest.mark.parametrize("name", ["simvfa-1", "simvfa-2"])
def test_state_feedback_has_the_poles_of_the_exact_gain(published_aircraft: Aircraft, name: str) -> None:
    design = simvfa_design(name)
    game = design_model(published_aircraft, model_at(11.0), design).game()
    loop, _ = whole(published_aircraft, design)
    same_poles(loop, np.linalg.eigvals(game.A - game.B @ solve_game(game).K))


@pytest.mark.parametrize("delta", [pytest.param(np.inf, marks=pytest.mark.slow), 200.0])
def test_output_feedback_has_the_poles_of_the_central_controller(published_aircraft: Aircraft, delta: float) -> None:
    design = measured_servo(delta=delta)
    built = design_model(published_aircraft, model_at(11.0), design)
    plant = GeneralizedPlant.measured(built.game(), built.C, built.V)
    exact: Any = solve_plant(plant, delta)
    loop, found = whole(published_aircraft, design)
    poles = np.linalg.eigvals(closed_loop(plant, (exact.Ak, exact.Bk, exact.Ck, exact.Dk))[0])
    same_poles(loop, poles)
    assert found.limit < delta


def test_names_tell_what_is_measured_and_commanded(published_aircraft: Aircraft) -> None:
    output = design_controller(published_aircraft, measured_servo(), ANGLES)
    assert (output.feedback, output.measurements) == ("output", ("pitch_rate", "dihedral", A_Z))
    assert output.commands == ("dihedral_command", f"{A_Z}_command")
    assert output.states[-2:] == ("dihedral_integral", f"{A_Z}_integral")
    assert [row["dihedral"] for row in output.about["angles"]] == pytest.approx(ANGLES)
    state = design_controller(published_aircraft, simvfa_design("simvfa-2"), ANGLES)
    assert (state.feedback, state.command_filter, output.command_filter) == ("state", (), ())
    assert {"speed", "aileron_outer_position", "elevator_center_rate", A_Z} <= set(state.measurements)
    assert state.commands == ("dihedral_command", f"{A_Z}_command")


def test_what_cannot_be_designed_says_why_and_where(published_aircraft: Aircraft) -> None:
    with pytest.raises(NoSolutionError, match="design simvfa-1 at dihedral 9 deg: the control Riccati equation"):
        design_controller(published_aircraft, measured_servo(delta=50.0), ANGLES)
    with pytest.raises(NoSolutionError, match="at dihedral 9 deg: the sensors do not see the mode with eigenvalue"):
        design_controller(published_aircraft, measured_servo(sensors={"pitch_rate": 1.0}), ANGLES)
