"""Servos and gusts on the `unsteady` dynamics, compared with `published` and `newton`.

    python -m studies.unsteady

The study takes two minutes. Servos are designed for one of the dynamics. Their linear loops with
actuators of 2 rad/s are then analyzed for each of the dynamics. The largest gusts are found by
simulation of the nonlinear aircraft with the policy u = -K (x - x0), without actuators. K is the
exact gain of the paper's game for the `published` dynamics at the same dihedral angle. The flight
must stay within the envelope and the control limits for 20 s.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache

import numpy as np

import hfa
from hfa import LinearModel, Model, fly, solve
from hfa.paper import level_model, published_game
from hfa_design import design_controller, load_design
from hfa_design.servo_loop import servo_loop, servo_margins, servo_plant
from hfa_flight import GainPolicy, OneMinusCosine, Scenario, ScheduledController, flight_envelope
from hfa_flight.actuators import Actuator
from hfa_model.unsteady import UNSTEADY
from studies.servo.flights import largest_held
from studies.servo.simvfa import simvfa_design

PLANTS: dict[str, Model] = {name: hfa.aircraft(name) for name in ("published", "newton")}
PLANTS["unsteady"] = UNSTEADY


@cache
def model_at(plant: str, degrees: float) -> LinearModel:
    """Return the linear model of the named dynamics at the paper's level flight.

    degrees: dihedral angle
    """
    return level_model(PLANTS[plant], np.radians(degrees))


def margins(
    plant: str, degrees: float, servo: ScheduledController, order: int
) -> tuple[float, float]:
    """Return the spectral abscissa of a servo loop, 1/s, and the smallest disk margin of an input.

    The loop has actuators of 2 rad/s. Each margin is computed with the other loops closed, and is
    nan if the loop is unstable. A disk margin a guarantees a gain margin of (2 + a) / (2 - a) and a
    phase margin of 2 atan(a / 2).

    plant: name of the dynamics
    degrees: dihedral angle
    order: order of the actuators
    """
    actuators = dict.fromkeys(servo.inputs, Actuator(order, 2.0))
    loop = servo_loop(servo_plant(PLANTS[plant], model_at(plant, degrees), servo, actuators), servo)
    if loop.abscissa >= 0.0:
        return loop.abscissa, np.nan
    found = servo_margins(loop, servo.inputs, servo.measurements)
    return loop.abscissa, min(found[name].disk for name in servo.inputs)


def updraft_function(plant: str, degrees: float) -> Callable[[float, float], float]:
    """Return the function (length in ft, sign) -> largest tolerated peak of a 1-cosine gust, ft/s.

    The sign is 1 for an updraft and -1 for a downdraft. The gust is tolerated if every state and
    input stays within its limits. The resolution is 0.5 ft/s. The largest peak that is tested is 60
    ft/s.

    plant: name of the dynamics
    degrees: dihedral angle
    """
    model = model_at(plant, degrees)
    K = solve(published_game(model_at("published", degrees))).K
    law = GainPolicy("paper", np.pad(K, ((0, 0), (0, len(model.A) - K.shape[1])))[None])
    envelope = flight_envelope(PLANTS[plant], model.point)

    def largest(length: float, sign: float) -> float:
        def held(peak: float) -> bool:
            gust = OneMinusCosine(length, sign * peak, model.point.states.speed, 0.0)
            flight = fly(
                PLANTS[plant],
                model.point,
                law,
                scenario=Scenario(duration=20.0, step=0.005, gust=gust),
                envelope=envelope,
            )
            return bool(flight.ok)

        return largest_held(held, 60.0, 0.5)

    return largest


def main() -> None:
    """Run the study and print both tables."""
    argparse.ArgumentParser(
        "python -m studies.unsteady", description=__doc__.partition("\n\n")[0]
    ).parse_args()
    angles = (0.0, 5.0, 11.0, 15.0, 20.0)
    print(
        "servo, designed on, angle, flown on: 1/s, disk margin of the worst actuator, of order 1"
        " and 2"
    )
    for name, of in (("servo", "published"), ("servo", "newton"), ("simvfa-1", "published")):
        design = load_design(name, hfa.aircraft()) if name == "servo" else simvfa_design(name)
        table = design_controller(hfa.aircraft(of), design, np.radians(angles))
        for degrees in angles:
            for plant in PLANTS:
                orders = (1, 2) if name == "servo" else (1,)
                shown = []
                for order in orders:
                    abscissa, margin = margins(plant, degrees, table, order)
                    shown.append(f"{abscissa:8.4f} {margin:5.2f}")
                print(f"{name:9} {of:9} {degrees:3g} deg {plant:9}", *shown)
    print("largest 1-cosine updraft, up / down, ft/s, under the paper's policy of published")
    for degrees in (5.0, 15.0):
        for plant in PLANTS:
            largest = updraft_function(plant, degrees)
            gusts = [
                f"{length} ft {largest(length, 1):.1f}/{largest(length, -1):.1f}"
                for length in (150, 400, 1000)
            ]
            print(f"{degrees:3g} deg {plant:9}", *gusts, sep="  ", flush=True)


if __name__ == "__main__":
    main()
