"""The loop of a controller and a plant: a direct path is closed rightly, and a planted unstable one is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from controllers import small_controller
from known_models import model_at

from controller import ScheduledController
from controller.design.servo_loop import ServoLoop, check_margins, servo_loop, servo_plant
from hfa_model import Aircraft
from hfa_support import BadInputError, NoSolutionError


def test_a_loop_whose_numbers_overflow_is_none() -> None:
    """As with an actuator 1e308 times as effective as it should be."""
    one = np.ones((1, 1))
    loop = ServoLoop(-one, 1e308 * one, one, -one, one, -4.0 * one, -10.0 * one)
    with pytest.raises(NoSolutionError, match="the closed loop overflows"):
        _ = loop.abscissa


def test_a_path_from_inputs_to_a_sensor_at_once_is_closed_as_the_equations_say(published_aircraft: Aircraft) -> None:
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


def gentle(aircraft: Aircraft, gain: float) -> ScheduledController:
    """aileron_outer = gain pitch_rate at 5 deg, its state decays by itself."""
    table = small_controller(aircraft)
    first = {name: getattr(table, name)[:1] for name in ("places", "trim_states", "trim_inputs")}
    zero = {name: 0.0 * getattr(table, name)[:1] for name in "BCW"}
    return replace(table, A=-np.ones((1, 1, 1)), D=np.array([[[gain, 0.0, 0.0, 0.0]]]), **first, **zero)


def test_a_controller_that_does_little_passes_with_the_abscissa_of_the_aircraft(published_aircraft: Aircraft) -> None:
    found = check_margins(published_aircraft, gentle(published_aircraft, 1e-4), np.radians([5.0]), (0.5, 2.0))
    assert (found.ok, len(found.rows)) == (True, 4)
    open_loop = np.linalg.eigvals(model_at(5.0).A).real.max()
    assert found.checks[0].value == pytest.approx(open_loop, rel=0.05)
    assert "PASS, 4 of 4 loops stable" in repr(found)


def test_a_planted_unstable_controller_is_found_with_its_actuator(published_aircraft: Aircraft) -> None:
    table = gentle(published_aircraft, 0.3)
    found = check_margins(published_aircraft, table, np.radians([5.0]), (0.05, 2.0))
    unstable = [row for row in found.rows if row.abscissa >= 0.0]
    assert not found.ok
    assert 0 < len(unstable) < len(found.rows)
    worst = max(unstable, key=lambda row: row.abscissa)
    (actuator,) = worst.actuators
    plant = servo_plant(published_aircraft, model_at(5.0), table, {"aileron_outer": actuator})
    assert servo_loop(plant, table).abscissa == pytest.approx(worst.abscissa)
    where = f"worst at 5 deg, order {actuator.order}, {actuator.bandwidth:g} rad/s"
    assert f"unstable in {len(unstable)} of 4 loops, {where}" in repr(found)
    assert found.to_dict()["checks"][0]["ok"] is False
    assert not worst.loops


def test_the_controller_of_another_aircraft_is_refused(published_aircraft: Aircraft) -> None:
    with pytest.raises(BadInputError, match="was designed for published dynamics"):
        check_margins(Aircraft(dynamics="newton"), gentle(published_aircraft, 0.0), np.radians([5.0]), (2.0,))
