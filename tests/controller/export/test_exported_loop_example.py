"""The example loop around a controller in C: compiled without a warning, run, and compared with the flight."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from c_files import needs_gcc, ran
from controllers import integrating_controller, small_controller

from controller import Actuators, CommandSteps, Scenario, ScheduledController
from controller.export.exported_loop import COMMANDED, CONTROLLER_FILES, SECONDS, c_controller_texts
from controller.flight.closed_loop import ClosedLoop, NonlinearPlant
from controller.flight.simulation import CompiledLoop
from controller.policy.servo_policy import servo_law
from controller.policy.signals import CommandedStates
from hfa_model import LINEAR_STATES, STATES, Aircraft, Input
from hfa_support.files import write_texts
from trim import OperatingPoint

pytestmark = needs_gcc
_, SOURCE, EXAMPLE = CONTROLLER_FILES


def actuators(order: int) -> Actuators:
    """So slow and short that the command reaches both limits."""
    return Actuators(Input(*[0.2] * 5), Input(*[-50.0] * 5), Input(*[50.0] * 5), Input(*[0.002] * 5), order=order)


def printed(
    controller: ScheduledController, aircraft: Aircraft, point: OperatingPoint, folder: Path, *words: str
) -> dict[str, float]:
    """What the example prints: name -> number."""
    write_texts(folder, c_controller_texts(controller, aircraft, point, "from */ here", actuators(2)))
    return ran(folder, *words, EXAMPLE, SOURCE)


def flown(controller: ScheduledController, aircraft: Aircraft, point: OperatingPoint) -> np.ndarray:
    """The states after the same time where the controller is continuous."""
    commands = CommandSteps((), np.zeros(0), np.zeros((0, 0)))
    if controller.commands:
        commands = CommandSteps(("dihedral",), np.zeros(1), np.array([[COMMANDED]]))
    law = servo_law(controller, commands, aircraft, point)
    initial = np.eye(len(STATES))[0]
    scenario = Scenario(
        float(SECONDS), 0.01, 0.1, initial, CommandedStates(commands, LINEAR_STATES), actuators=actuators(2)
    )
    flight = CompiledLoop(ClosedLoop(NonlinearPlant(aircraft, point), law, scenario)).fly()
    return np.asarray(flight.states[-1] + np.array(point.states))


def with_memory(aircraft: Aircraft) -> ScheduledController:
    return integrating_controller(
        aircraft,
        measurements=("aileron_outer_rate", "dihedral"),
        C=np.full((3, 1, 1), -0.5),
        D=np.array([[[0.05, -0.4, 0.4, 0.0]]] * 3),
    )


def without_memory_and_commands(aircraft: Aircraft) -> ScheduledController:
    """C has no empty arrays."""
    shapes = {"A": (3, 0, 0), "B": (3, 0, 1), "C": (3, 1, 0), "W": (3, 0, 1)}
    stacks = {name: np.zeros(shape) for name, shape in shapes.items()} | {"D": np.full((3, 1, 1), -0.1)}
    return small_controller(aircraft, **stacks, states=(), commands=(), measurements=("dihedral",))


@pytest.mark.parametrize("made", [with_memory, pytest.param(without_memory_and_commands, marks=pytest.mark.slow)])
def test_it_flies_what_we_fly_and_says_its_time(
    made: Callable[[Aircraft], ScheduledController], published_aircraft: Aircraft, point: OperatingPoint, tmp_path: Path
) -> None:
    """Holding the inputs for a tick costs an error in proportion to the tick; without it the two are one."""
    controller, states = made(published_aircraft), []
    known = flown(controller, published_aircraft, point)
    for hertz in (100, 1000):
        said = printed(controller, published_aircraft, point, tmp_path, f"-DHERTZ={hertz}")
        states.append(np.array([said[name] for name in STATES]))
        assert 0.0 <= said["microseconds a tick"] < 1000.0  # 0 where the clock is coarse
    size = np.abs(known - np.array(point.states)).max()
    assert size > 0.1
    assert np.abs(states[0] - known).max() < 0.03 * size
    assert np.abs((10 * states[1] - states[0]) / 9 - known).max() < 3e-5 * size
    text = (tmp_path / EXAMPLE).read_text()
    (tmp_path / EXAMPLE).write_text(text.replace("flown[0] += 1.0", "flown[0] += 1.02"))
    planted = ran(tmp_path, "-DHERTZ=1000", EXAMPLE, SOURCE)
    assert max(abs(planted[name] - value) for name, value in zip(STATES, known, strict=True)) > 3e-3 * size
