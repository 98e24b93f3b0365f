"""The loop of a controller and a plant: its margins are those of the gain, and a direct path is closed rightly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from controllers import small_controller
from known_models import model_at

from controller.design.servo_loop import ServoLoop, servo_loop, servo_plant
from hfa_model import Aircraft
from hfa_support import NoSolutionError


def test_a_loop_whose_numbers_overflow_is_none() -> None:
    """As with an actuator 1e308 times as effective as it should be."""
    one = np.ones((1, 1))
    loop = ServoLoop(-one, 1e308 * one, one, -one, one, -4.0 * one, -10.0 * one)
    with pytest.raises(NoSolutionError, match="the closed loop overflows"):
        _ = loop.abscissa


def test_a_path_from_input_to_sensor_at_once_is_closed(published_aircraft: Aircraft) -> None:
    """u = -g n_z with n_z = C x + D u means u = -g C x / (1 + g D)."""
    table = small_controller(published_aircraft, measurements=("load_factor", "dihedral"), A=-np.ones((3, 1, 1)))
    zero = {name: 0.0 * getattr(table, name) for name in "BCW"}
    gain = np.tile(np.array([[-0.01, 0.0, 0.0, 0.0]]), (3, 1, 1))
    table = replace(table, D=gain, **zero)
    plant = servo_plant(published_aircraft, model_at(11.0), table, {})
    assert plant.D[0, 0] != 0.0
    closed = plant.A - 0.01 / (1.0 + 0.01 * plant.D[0, 0]) * plant.B @ plant.C[:1]
    assert servo_loop(plant, table).abscissa == pytest.approx(max(np.linalg.eigvals(closed).real.max(), -1.0))


def test_such_a_path_of_many_inputs_is_closed_as_the_equations_say(published_aircraft: Aircraft) -> None:
    """u = Ck x_c + Dk (C x + D u), solved for u at a state, gives the rates of the loop."""
    rng, shapes = np.random.default_rng(0), {"A": (3, 3), "B": (3, 4), "C": (2, 3), "D": (2, 4), "W": (3, 2)}
    table = small_controller(
        published_aircraft,
        inputs=("aileron_outer", "elevator_center"),
        measurements=("load_factor", "dihedral"),
        states=("dihedral_integral", "one", "two"),
        **{name: np.tile(0.05 * rng.standard_normal(shape), (3, 1, 1)) for name, shape in shapes.items()},
    )
    plant = servo_plant(published_aircraft, model_at(11.0), table, {})
    A, B, C, D = (getattr(table, name)[0] for name in "ABCD")
    x, own = rng.standard_normal(len(plant.A)), rng.standard_normal(3)
    u = np.linalg.solve(np.eye(2) - D[:, :2] @ plant.D, C @ own + D[:, :2] @ plant.C @ x)
    rates = [plant.A @ x + plant.B @ u, A @ own + B[:, :2] @ (plant.C @ x + plant.D @ u)]
    np.testing.assert_allclose(servo_loop(plant, table).closed @ np.r_[x, own], np.concatenate(rates), rtol=1e-10)
