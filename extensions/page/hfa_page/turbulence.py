"""One flight of the exact gain behind its filter in turbulence, simulated for the page."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hfa_page.main_job import Position
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.report import Picture, Report

if TYPE_CHECKING:
    from hfa_flight.simulate.flight import Flight

_TITLE = "A flight in turbulence"
_SECONDS = 20.0
_LEVEL = "moderate"
#: Standard deviations of the sensors' noise in a sample: ft/s, deg and deg/s.
_SPEED = 0.3
_ANGLES = {"alpha": 0.17, "pitch": 0.11, "dihedral": 0.11}
_RATES = {"pitch_rate": 0.17, "dihedral_rate": 0.17}
_NOT_COVERED = (
    "One flight with one seed: gusts of other shapes, biased or late sensors, other parameters and "
    "motions that the model does not have are not covered."
)


def flight_in_turbulence(angle: Position) -> Report:
    """Return the section on a flight in moderate turbulence at the altitude of a trim, or why there
    is none.

    angle: trim, linear model and solution of the game at a dihedral angle
    """
    try:
        flight = _flown(angle)
    except ImportError:
        return Report(_TITLE, ("Not on this page: the package hfa_flight is not installed.",))
    except (BadInputError, NoSolutionError) as error:
        return Report(_TITLE, (f"Not on this page: {error}",))
    limits, trim = flight.envelope, flight.point.x
    away = flight.deviations.limited
    used = np.maximum(away / (limits.highest - trim), away / (limits.lowest - trim)).max(axis=0)
    nearest = int(used.argmax())
    at_limit = max(flight.share_at_limits.values())
    figures = (
        f"{flight.title().splitlines()[0]}. Exact gain at {angle.label} behind its Kalman filter, "
        f"with sensor noise, in {_LEVEL} turbulence of MIL-F-8785C that begins in calm: "
        f"{limits.names[nearest]} comes nearest to a limit, {100.0 * used[nearest]:.0f} % of the "
        f"way from the trim; an input is at a limit for {100.0 * at_limit:.2g} % of the time. "
    )
    text = f"Exact gain behind its filter in {_LEVEL} turbulence: states, their limits and inputs"
    data = {"ok": flight.ok, "departure": flight.departure, "rms_error": flight.rms_error}
    picture = Picture("turbulence.png", text, lambda: flight.figure(text))
    return Report(_TITLE, (figures + _NOT_COVERED, picture), data=data)


def _flown(angle: Position) -> Flight:
    """Return the flight. Raises NoSolutionError without a trim or a solution of the game."""
    from hfa_flight.air.scenario import Scenario, Uncertainty
    from hfa_flight.air.turbulence import Turbulence
    from hfa_flight.policies.filter import filter
    from hfa_flight.simulate.flight import fly

    if angle.model is None or angle.solution is None:
        raise NoSolutionError(angle.reason)
    point, model = angle.model.point, angle.model.point.model
    angles = {name: math.radians(each) for name, each in (_ANGLES | _RATES).items()}
    noise = {"speed": _SPEED, **angles}
    air = Turbulence(_LEVEL, float(point["altitude"]))
    policy = filter(angle.model, noise, air).policy(angle.solution)
    scenario = Scenario(_SECONDS, uncertainty=Uncertainty(noise=noise, turbulence=air))
    return fly(model, point, policy, scenario=scenario.drawn(0, 0, point), predict=False)
