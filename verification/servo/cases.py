"""What `hfa servo` flies: the commands of SimVFA, its actuator faults, and the laws beside each other."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from controller.design.controllers import design_controller
from controller.design.design import Actuator
from controller.design.design_file import load_design
from controller.design.scheduled_controller import ScheduledController
from controller.flight.actuators import ActuatorFault
from controller.flight.scenario import Scenario
from controller.game.zero_sum import Game, published_game
from controller.policy.commands import CommandedStates, CommandSteps
from controller.policy.learned_gain import learned_value
from controller.policy.policies import FlownLaw, gain_law
from controller.policy.servo_policy import servo_law
from controller.riccati.gare import solve_game
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import Parameters
from hfa_model.variants import Variant
from hfa_support.errors import BadInputError, refuse_unknown
from trim.linear.linear_model import linearize
from trim.point.operating_point import OperatingPoint
from verification.servo.adaptive_degree_2 import AdaptiveDegree2
from verification.servo.adaptive_degree_3 import AdaptiveDegree3
from verification.servo.adaptive_policy import adaptive_law
from verification.servo.reference_model import REGULATED, reference_servo
from verification.synthesis.moving_air import flown_actuators

#: Dihedral of the trim in which all flights begin, deg; angles of the tables of SimVFA, rad.
TRIM_DEG = 11.0
ANGLES = np.radians(np.arange(21.0))
#: Of the table of our servo: what the commands pass, with room.
OWN_ANGLES = np.radians(np.arange(8.0, 15.0))
#: Ours: design -> feedback. Each flies with exact and learned, scheduled and frozen gains; the last as it is.
OWN_DESIGNS = {"servo": "output", "servo-states": "state"}
FOR_GUSTS = "servo-gusts"
#: s, of the law that learns it.
LEARNING_TICK = 0.1
#: s: a step each, the first after `_FIRST`; the flight ends with the last.
_EACH, _FIRST = 70.0, 1.0
_DIHEDRAL = np.radians([1.0, 2, 1, 2, 1, 2, -1, 1, 2, 1, 2, 1, 2, -1, 0, 0])
_ACCELERATION = np.array([-1.0, -2, -1, -2, -1, -2, 1, -1, -2, -1, -2, -2, 1, 1, 0, 0])
DURATION = _FIRST + _EACH * (len(_DIHEDRAL) - 1)
#: Bandwidth ω, rad/s, and damping ζ of the actuators as designed.
BANDWIDTH, DAMPING = 2.0, 0.7
#: s; what is recorded. The integration chooses its own steps where a law is stiff.
STEP = 0.02


class Case(NamedTuple):
    """Order of the actuators, and what befalls them."""

    order: int
    faults: tuple[ActuatorFault, ...]


_WEAK = ActuatorFault(0.0, 0.2, 0.5, 0.8)
CASES: dict[str, Case] = {
    "order-1": Case(1, ()),
    "order-1-fault": Case(1, (ActuatorFault(0.0, 0.2, 0.5),)),
    "order-2": Case(2, ()),
    "order-2-fault": Case(2, (_WEAK,)),
}


def simvfa_commands() -> CommandSteps:
    """SimVFA's 16 steps of dihedral, rad, and vertical acceleration, ft/s²; its command filter."""
    times = _FIRST + _EACH * np.arange(len(_DIHEDRAL))
    return CommandSteps(REGULATED, times, np.column_stack([_DIHEDRAL, _ACCELERATION]))


def scenario_of(case: Case, commands: CommandSteps, duration: float = DURATION) -> Scenario:
    """The flight of a case, s long; BadInputError where that is longer than the commands."""
    if duration > DURATION:
        raise BadInputError(f"duration is {duration:g} s; the commands of a case end after {DURATION:g} s")
    return Scenario(
        duration=duration,
        step=STEP,
        tick=STEP,
        reference=CommandedStates(commands),
        actuators=flown_actuators(Actuator(case.order, BANDWIDTH, DAMPING), case.faults),
    )


@dataclass(frozen=True)
class Start:
    """Where all laws begin, and what they follow."""

    aircraft: Aircraft
    point: OperatingPoint
    commands: CommandSteps


def _reference(order: int) -> Callable[[Start], FlownLaw]:
    def made(on: Start) -> FlownLaw:
        controller = reference_servo(on.aircraft, f"simvfa-{order}", ANGLES)
        return servo_law(controller, on.commands, on.aircraft, on.point)

    return made


def _adaptive(order: int) -> Callable[[Start], FlownLaw]:
    kind = AdaptiveDegree2 if order == 1 else AdaptiveDegree3
    return lambda on: adaptive_law(kind, order, on.aircraft, on.point, on.commands, ANGLES)


def _own(design: str, source: str = "exact", gains: str = "scheduled") -> Callable[[Start], FlownLaw]:
    """Ours: a packaged design, one for both orders.

    source: exact or learned. gains: scheduled on the dihedral, or frozen at the trim.
    """
    angles = OWN_ANGLES if gains == "scheduled" else np.radians([TRIM_DEG])

    def made(on: Start) -> FlownLaw:
        controller = _own_controller(on.aircraft.parameters, on.aircraft.variant, design, source, tuple(angles))
        return servo_law(controller, on.commands, on.aircraft, on.point)

    return made


@lru_cache(maxsize=32)
def _own_controller(
    parameters: Parameters, variant: Variant, design: str, source: str, angles: tuple[float, ...]
) -> ScheduledController:
    """One for all cases."""
    value = _learned if source == "learned" else None
    aircraft, feedback = Aircraft(parameters, variant), OWN_DESIGNS.get(design, "")
    return design_controller(aircraft, load_design(design), np.array(angles), feedback, value=value)


def _learned(game: Game) -> np.ndarray:
    """P of the certified law, from recorded samples of the game."""
    return learned_value(game, "certified", 0, tick=LEARNING_TICK).P


def _given(controller: ScheduledController) -> Callable[[Start], FlownLaw]:
    return lambda on: servo_law(controller, on.commands, on.aircraft, on.point)


def _paper(on: Start) -> FlownLaw:
    """The exact policy of the paper's game at the trim: five inputs, six states, no actuators and no integrals."""
    model = linearize(on.aircraft, on.point)
    return gain_law("paper", solve_game(published_game(model.A, model.B)).K)


def laws_of(
    order: int, controllers: Mapping[str, ScheduledController], only: Sequence[str] = ()
) -> dict[str, Callable[[Start], FlownLaw]]:
    """Name -> how it is made. order: of the actuators that SimVFA's laws are designed for. only: names, () for all.

    BadInputError when a law of `only` is not among them.
    """
    found: dict[str, Callable[[Start], FlownLaw]] = {f"simvfa-{order}": _reference(order)}
    found[f"simvfa-{order} adaptive"] = _adaptive(order)
    for variant in itertools.product(OWN_DESIGNS, ("exact", "learned"), ("scheduled", "frozen")):
        found[" ".join(word for word in variant if word not in ("exact", "scheduled"))] = _own(*variant)
    found[FOR_GUSTS] = _own(FOR_GUSTS)
    found |= {name: _given(controller) for name, controller in controllers.items()}
    found["paper"] = _paper
    for name in only:
        refuse_unknown(f"order {order} has no law", name, found)
    return {name: made for name, made in found.items() if name in (only or found)}
