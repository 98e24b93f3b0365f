"""Controllers of a design: closed-loop poles, tables, files and margins."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from controllers import integrating_controller, small_controller
from known_models import model_at
from scipy.io import loadmat
from servo_cases import measured_servo, simvfa_design
from tolerances import SAME_FORMULA

import hfa
from hfa import BadInputError, Model, NoSolutionError, solve
from hfa.paper import default_parameters
from hfa_design import (
    Design,
    GeneralizedPlant,
    LinearController,
    ServoLoop,
    check_margins,
    closed_plant,
    controller_at,
    design_controller,
    design_model,
    servo_loop,
    servo_plant,
    solve_plant,
)
from hfa_flight import ScheduledController, load_controller, save_controller

ANGLES = np.radians([9.0, 11.0])


def closed_loop_at_11(aircraft: Model, design: Design) -> tuple[np.ndarray, LinearController]:
    """Return the matrix of a design's closed loop at 11 deg, at constant commands, and its
    controller.

    The controller is also computed as part of a table. The function asserts that the table contains
    the same matrices.
    """
    model = model_at(11.0)
    found = controller_at(aircraft, model, design)
    told: list[tuple[int, int]] = []
    table = design_controller(aircraft, design, ANGLES, progress=lambda *at: told.append(at))
    assert told == [(1, 2), (2, 2)]
    plant = servo_plant(aircraft, model, table, design.actuators)
    measured = len(table.measurements)
    B = found.B[:, :measured]
    D = found.D[:, :measured]
    for part in "ABCDW":
        np.testing.assert_array_equal(getattr(table, part)[1], getattr(found, part))
    return np.block(
        [[plant.A + plant.B @ D @ plant.C, plant.B @ found.C], [B @ plant.C, found.A]]
    ), found


def same_poles(loop: np.ndarray, poles: np.ndarray) -> None:
    order = lambda values: np.sort_complex(np.round(values, 7))  # noqa: E731
    np.testing.assert_allclose(order(np.linalg.eigvals(loop)), order(poles), atol=1e-6)


@pytest.mark.parametrize("name", ["simvfa-1", "simvfa-2"])
def test_state_feedback_gives_the_exact_gains_poles(published_aircraft: Model, name: str) -> None:
    """The closed loop of a state-feedback design has the poles of A - B K with the game's exact
    K.
    """
    design = simvfa_design(name)
    game = design_model(published_aircraft, model_at(11.0), design).game()
    loop, _ = closed_loop_at_11(published_aircraft, design)
    same_poles(loop, np.linalg.eigvals(game.A - game.B @ solve(game).K))


@pytest.mark.slow
@pytest.mark.parametrize("delta", [np.inf, 200.0])
def test_output_feedback_gives_the_central_controllers_poles(
    published_aircraft: Model, delta: float
) -> None:
    """The closed loop of an output-feedback design has the poles of the central controller's
    loop.
    """
    design = measured_servo(delta=delta)
    built = design_model(published_aircraft, model_at(11.0), design)
    plant = GeneralizedPlant.measured(built.game(), built.C, built.V)
    exact: Any = solve_plant(plant, delta)
    loop, found = closed_loop_at_11(published_aircraft, design)
    poles = np.linalg.eigvals(closed_plant(plant, (exact.Ak, exact.Bk, exact.Ck, exact.Dk))[0])
    same_poles(loop, poles)
    assert found.limit < delta


def test_impossible_designs_name_angle_and_reason(published_aircraft: Model) -> None:
    """A design without a solution is refused with the angle and the reason."""
    with pytest.raises(
        NoSolutionError, match="design simvfa-1 at dihedral 9 deg: the control Riccati equation"
    ):
        design_controller(published_aircraft, measured_servo(delta=50.0), ANGLES)
    with pytest.raises(
        NoSolutionError,
        match="at dihedral 9 deg: within rounding the sensors do not observe the mode with eigenvalue",
    ):
        design_controller(published_aircraft, measured_servo(sensors={"pitch_rate": 1.0}), ANGLES)


def test_controller_matrices_are_interpolated_linearly(
    published_aircraft: Model,
) -> None:
    """A controller's matrices are linear between breakpoints and constant beyond the outermost
    ones.
    """
    controller = small_controller(published_aircraft)
    cases = (
        (5.0, (1, 0, 0)),
        (7.5, (0.5, 0.5, 0)),
        (18.0, (0, 0.2, 0.8)),
        (-30.0, (1, 0, 0)),
        (60.0, (0, 0, 1)),
    )
    for degrees, shares in cases:
        for number, matrix in enumerate(controller.at(math.radians(degrees))):
            np.testing.assert_allclose(
                matrix, np.dot(shares, np.arange(3.0)) + 10.0 * number, rtol=SAME_FORMULA
            )


def test_another_aircraft_is_refused(published_aircraft: Model) -> None:
    """Other dynamics and other parameters are refused."""
    controller = small_controller(published_aircraft)
    controller.refuse_other(published_aircraft, 0.1, 0.2)
    with pytest.raises(
        BadInputError, match="designed for published dynamics, but the aircraft is newton"
    ):
        controller.refuse_other(hfa.aircraft("newton"), 0.1, 0.2)
    heavier = default_parameters().values._replace(panel_mass=11.0)
    with pytest.raises(BadInputError, match="an aircraft with other parameters"):
        controller.refuse_other(hfa.aircraft(parameters=heavier), 0.1, 0.2)


def test_a_controller_of_rates_has_actuators_of_second_order(published_aircraft: Model) -> None:
    """An actuator of first order has no rate: a controller that measures one has margins of others."""
    controller = integrating_controller(
        published_aircraft, measurements=("aileron_outer_rate", "dihedral")
    )
    table = check_margins(published_aircraft, controller, np.radians([10.0]), (2.0,))
    assert [acting.order for row in table.rows for acting in row.actuators] == [2]


def test_a_saved_controller_is_loaded_unchanged(published_aircraft: Model, tmp_path: Path) -> None:
    """A controller that is saved and loaded is equal to the original."""
    saved = small_controller(published_aircraft)
    save_controller(tmp_path / "small.npz", saved)
    found = load_controller(tmp_path / "small.npz", hfa.aircraft())
    assert found == saved
    assert found.about == saved.about
    assert found != small_controller(published_aircraft, name="other")


def test_matlab_files_have_the_angle_last(published_aircraft: Model, tmp_path: Path) -> None:
    """In a .mat file, the last axis of each matrix is the angle."""
    controller = small_controller(published_aircraft)
    save_controller(tmp_path / "small.mat", controller)
    found = loadmat(tmp_path / "small.mat")
    assert found["B"].shape == (1, 4, 3)
    np.testing.assert_array_equal(np.moveaxis(found["B"], -1, 0), controller.B)
    assert [name.item() for name in found["measurements"].ravel()] == ["pitch_rate", "dihedral"]


def test_damaged_controller_files_are_refused(published_aircraft: Model, tmp_path: Path) -> None:
    """Files of other kinds, and controller files with missing or damaged entries, are refused."""

    def refused(name: str, message: str, **changed: object) -> None:
        with np.load(tmp_path / "good.npz") as good:
            content = {**good} | changed
        kept = {key: value for key, value in content.items() if value is not None}
        np.savez(tmp_path / name, **kept)
        with pytest.raises(BadInputError, match=f"{name}: {message}"):
            load_controller(tmp_path / name, hfa.aircraft())

    save_controller(tmp_path / "good.npz", small_controller(published_aircraft))
    refused("plant.npz", "the file is not a controller file", schema="hfa.plant/1")
    refused("short.npz", "W is missing", W=None)
    refused("shape.npz", r"controller small: A has shape \(1, 1, 1\)", A=np.zeros((1, 1, 1)))
    refused("text.npz", "the content is damaged", A=np.array(["x"]))
    refused("about.npz", "the content is damaged", about="{")
    refused("about.npz", "the content is damaged", about="5")
    refused(
        "about.npz",
        r"its content: angles\[0\].checks is missing",
        about='{"angles": [{"dihedral": 0.1}]}',
    )
    for name in ("good.json", "good.mat"):
        with pytest.raises(BadInputError, match=f"{name}: a controller is read from a .npz file"):
            load_controller(tmp_path / name, hfa.aircraft())
    with pytest.raises(BadInputError, match=r"use \.npz or \.mat"):
        save_controller(tmp_path / "good.json", small_controller(published_aircraft))


def test_a_loop_whose_numbers_overflow_is_refused() -> None:
    """The spectral abscissa of a loop whose numbers overflow is refused.

    The effectiveness of the actuators is 1e308.
    """
    one = np.ones((1, 1))
    loop = ServoLoop(-one, 1e308 * one, one, -one, one, -4.0 * one, -10.0 * one)
    with pytest.raises(NoSolutionError, match="the closed loop overflows"):
        _ = loop.stability


@pytest.mark.parametrize(("gain", "is_stable"), [(0.0, False), (1e-15, False), (1e-3, True)])
def test_an_integral_without_feedback_is_not_stable(gain: float, is_stable: bool) -> None:
    """A loop x' = -x + u, u = -gain ∫x dt has a pole at -gain: stable only beyond rounding."""
    one = np.ones((1, 1))
    loop = ServoLoop(-one, one, one, 0.0 * one, one, -gain * one, 0.0 * one)
    assert loop.stability.is_stable is is_stable


def test_a_direct_path_gives_correct_rates(
    published_aircraft: Model,
) -> None:
    """With a direct path D from inputs to a sensor, the closed loop has the correct rates.

    The rates are compared with those of the equations solved for u, u = Ck x_c + Dk (C x + D u).
    """
    rng = np.random.default_rng(0)
    shapes = {"A": (3, 3), "B": (3, 4), "C": (2, 3), "D": (2, 4), "W": (3, 2)}
    table = small_controller(
        published_aircraft,
        inputs=("aileron_outer", "elevator_center"),
        measurements=("load_factor", "dihedral"),
        states=("dihedral_integral", "one", "two"),
        **{
            name: np.tile(0.05 * rng.standard_normal(shape), (3, 1, 1))
            for name, shape in shapes.items()
        },
    )
    plant = servo_plant(published_aircraft, model_at(11.0), table, {})
    A, B, C, D = (getattr(table, name)[0] for name in "ABCD")
    x = rng.standard_normal(len(plant.A))
    own = rng.standard_normal(3)
    u = np.linalg.solve(np.eye(2) - D[:, :2] @ plant.D, C @ own + D[:, :2] @ plant.C @ x)
    rates = [plant.A @ x + plant.B @ u, A @ own + B[:, :2] @ (plant.C @ x + plant.D @ u)]
    np.testing.assert_allclose(
        servo_loop(plant, table).closed @ np.r_[x, own], np.concatenate(rates), rtol=1e-10
    )


def gentle(aircraft: Model, gain: float) -> ScheduledController:
    """Return a stable controller with the output aileron_outer = gain pitch_rate, valid at 5 deg
    only.
    """
    table = small_controller(aircraft)
    first = {
        name: getattr(table, name)[:1] for name in ("breakpoints", "trim_states", "trim_inputs")
    }
    zero = {name: 0.0 * getattr(table, name)[:1] for name in "BCW"}
    return replace(
        table, A=-np.ones((1, 1, 1)), D=np.array([[[gain, 0.0, 0.0, 0.0]]]), **first, **zero
    )


def test_a_controller_with_very_small_gain_passes(
    published_aircraft: Model,
) -> None:
    """A controller with a very small gain passes, with nearly the spectral abscissa of the
    aircraft.
    """
    found = check_margins(
        published_aircraft, gentle(published_aircraft, 1e-4), np.radians([5.0]), (0.5, 2.0)
    )
    assert (found.ok, len(found.rows)) == (True, 4)
    open_loop = np.linalg.eigvals(model_at(5.0).A).real.max()
    assert found.checks[0].value == pytest.approx(open_loop, rel=0.05)
    assert "PASS, 4 of 4 loops stable" in repr(found)


def test_an_unstable_controller_fails_with_worst_actuator(
    published_aircraft: Model,
) -> None:
    """A controller that is unstable with some actuators fails. The report names the worst
    actuator.
    """
    table = gentle(published_aircraft, 0.3)
    found = check_margins(published_aircraft, table, np.radians([5.0]), (0.05, 2.0))
    unstable = [row for row in found.rows if not row.stability.is_stable]
    assert not found.ok
    assert 0 < len(unstable) < len(found.rows)
    worst = max(unstable, key=lambda row: row.stability.value)
    (actuator,) = worst.actuators
    plant = servo_plant(published_aircraft, model_at(5.0), table, {"aileron_outer": actuator})
    assert servo_loop(plant, table).stability == pytest.approx(worst.stability)
    where = f"worst at 5 deg, order {actuator.order}, {actuator.bandwidth:g} rad/s"
    assert f"not stable in {len(unstable)} of 4 loops, {where}" in " ".join(repr(found).split())
    assert found.to_dict()["checks"][0]["ok"] is False
    assert not worst.loops
