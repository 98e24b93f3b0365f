"""Which gusts a controller withstands, beside those that could be withstood at all."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from controller.design.design import Actuator
from controller.design.scheduled_controller import ScheduledController
from controller.flight.envelope import flight_envelope
from controller.flight.plants import NonlinearPlant
from hfa_model.aircraft import Aircraft
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress, told
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, in_degrees
from trim.linear.linear_model import LinearModel, level_model
from verification.flights.best_inputs import best_inputs
from verification.synthesis.moving_air import LARGEST, gust_held
from verification.synthesis.tuning import InGust

#: ft: of the gusts.
LENGTH = 400.0
_ACTUATOR = Actuator()


class GustLimit(NamedTuple):
    """Peaks in ft/s, negative downward, at one dihedral, rad. held: the largest that the controller stands. best: what
    the same surfaces can stand when the gust is known as it begins, a local optimum; nan where none was found."""

    dihedral: float
    held: float
    best: float


@dataclass(frozen=True, eq=False, repr=False)
class GustLimits(Reported):
    """Of a controller, at its first and last angle, up and down, behind actuators of order 1."""

    controller: ScheduledController
    actuator: Actuator
    limits: tuple[GustLimit, ...]

    def report(self) -> Report:
        """A row for each angle and direction."""
        rows = [(f"{in_degrees(each.dihedral):g}", f"{each.held:.3g}", f"{each.best:.3g}") for each in self.limits]
        acting = self.actuator
        return Report(
            f"Gusts of {LENGTH:g} ft for controller {self.controller.name}, {self.controller.dynamics} dynamics, "
            f"actuators of order {acting.order} at {acting.bandwidth:g} rad/s",
            (
                f"largest peak held, ft/s, tried up to {LARGEST:g}; best: by one who knows the gust when it begins",
                Table(("dihedral", "held", "best"), rows),
            ),
            data=self.to_dict(),
        )

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON; angles in rad."""
        return {"length": LENGTH, "limits": [each._asdict() for each in self.limits]}


def gust_limits(aircraft: Aircraft, controller: ScheduledController, progress: Progress | None = None) -> GustLimits:
    """Flown on the nonlinear aircraft. BadInputError when the controller is for another aircraft."""
    ends = sorted({float(controller.dihedrals[0]), float(controller.dihedrals[-1])})
    controller.refuse_other(aircraft, ends[0], ends[-1])
    models = [level_model(aircraft, dihedral) for dihedral in ends]
    ways = [(model, sign) for model in models for sign in (1.0, -1.0)]
    limits = tuple(_limit(aircraft, controller, *way) for way in told(ways, progress))
    return GustLimits(controller, _ACTUATOR, limits)


def _limit(aircraft: Aircraft, controller: ScheduledController, model: LinearModel, sign: float) -> GustLimit:
    """At the angle of a linear model, upward or downward."""
    dihedral = model.point.states.dihedral
    held = gust_held(aircraft, model, controller, InGust(dihedral, _ACTUATOR, LENGTH, sign))
    plant, envelope = NonlinearPlant(aircraft, model.point), flight_envelope(aircraft.parameters, model.point)
    try:
        best = best_inputs(plant, envelope, controller.inputs, LENGTH, sign, _ACTUATOR.bandwidth).peak
    except NoSolutionError:
        best = math.nan
    return GustLimit(dihedral, math.copysign(held, sign), best)
