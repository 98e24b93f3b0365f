"""Simulations and linear loops that test whether a servo controller meets its requirements.

The requirements concern margins, delay, gusts, a biased gyro and noisy sensors.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hfa import LinearModel
from hfa.extend import Report
from hfa.paper import level_model
from hfa_aircraft.model import Model
from hfa_design.servo_loops import ServoLoop, check_margins, servo_loop, servo_plant
from hfa_flight import (
    ActuatorBank,
    ActuatorFault,
    CommandSteps,
    OneMinusCosine,
    Scenario,
    ScheduledController,
    Uncertainty,
    Waveform,
    flight_envelope,
)
from hfa_flight.actuators import Actuator
from hfa_flight.flight import Flight, fly
from hfa_flight.policies.controller import servo_policy
from hfa_model import INPUTS, LINEAR_STATES, Input
from hfa_model.vectors import CONTROL_LIMITS
from hfa_support.reporting.text import Table

#: Time step, interval of tests of the envelope, and duration of a flight with a gust, s.
STEP = 0.02
TICK = 0.2
SECONDS = 30.0
#: Resolution of the largest gust, ft/s.
APART = 1.0
#: Actuators with which the servo must work.
REAL = (Actuator(1, 2.0), Actuator(2, 2.0), Actuator(1, 10.0), Actuator(2, 10.0))
#: Length of a gust, ft -> required peaks, ft/s, for each of `REAL` except the last.
ASKED = {
    400.0: (30.0, 30.0, 30.0),
    600.0: (25.0, 25.0, 25.0),
    1000.0: (20.0, 20.0, 20.0),
    150.0: (15.0, 10.0, 25.0),
}
#: Delay, s; gyro bias, rad/s; states and standard deviations of the sensor noise.
DELAY = 0.02
BIAS = math.radians(0.3)
NOISE = {
    "pitch_rate": math.radians(0.1),
    "dihedral": math.radians(0.05),
    "alpha": math.radians(0.01),
}
#: Dihedral angles at which gusts are tested, deg.
ANGLES = (5.0, 11.0, 15.0)


def equal_actuators(acting: Actuator, faults: tuple[ActuatorFault, ...] = ()) -> ActuatorBank:
    """Return five equal actuators with the limits `CONTROL_LIMITS` and without a rate limit.

    acting: dynamics of each actuator. An effectiveness other than 1 is added as a fault of the
      surfaces.
    faults: further faults
    """
    lowest, highest = (Input(*(pair[side] for pair in CONTROL_LIMITS)) for side in (0, 1))
    lag, rate = (Input(*[each] * len(lowest)) for each in (1.0 / acting.bandwidth, np.inf))
    if acting.effectiveness != 1.0:
        faults = (ActuatorFault(0.0, acting.effectiveness, inputs=INPUTS[1:]), *faults)
    return ActuatorBank(lag, lowest, highest, rate, acting.order, acting.damping, faults)


def simulated_flight(
    aircraft: Model,
    model: LinearModel,
    controller: ScheduledController,
    acting: Actuator,
    **happens: Any,
) -> Flight:
    """Return the simulated flight of the nonlinear aircraft with a servo controller and no
    commands.

    acting: actuator of each input
    happens: fields of `Scenario`
    """
    still = CommandSteps((), np.zeros(0), np.zeros((0, 0)))
    scenario = Scenario(
        **{"duration": SECONDS, "step": STEP, "tick": TICK, **happens},
        actuators=equal_actuators(acting),
    )
    envelope = flight_envelope(aircraft, model.point)
    point = model.point
    law = servo_policy(controller, still, aircraft, point)
    return fly(aircraft, point, law, scenario=scenario, envelope=envelope, predict=False)


def gust_held(
    aircraft: Model,
    model: LinearModel,
    controller: ScheduledController,
    acting: Actuator,
    length: float,
    peak: float,
) -> float:
    """Return the peak of the largest 1-cosine gust with which a flight stays in the envelope, ft/s.

    length: length of the gust
    peak: largest peak in the search, ft/s, whose sign is the sign of the result

    The resolution of the search is `APART`.
    """

    def held(size: float) -> bool:
        gust = OneMinusCosine(length, math.copysign(size, peak), model.point.states.speed, 1.0)
        return simulated_flight(aircraft, model, controller, acting, gust=gust).departure is None

    return math.copysign(largest_held(held, abs(peak), APART), peak)


def largest_held(held: Callable[[float], bool], highest: float, apart: float) -> float:
    """Return the largest number up to `highest` for which `held` is true, or 0 if none is found.

    The method is bisection. `held` must not become true again above a number for which it is false.

    apart: resolution
    """
    if held(highest):
        return highest
    low = 0.0
    high = highest
    while high - low > apart:
        middle = (low + high) / 2.0
        low, high = (middle, high) if held(middle) else (low, middle)
    return low


def delayed(loop: ServoLoop, seconds: float) -> ServoLoop:
    """Return the closed loop with a delay at each input, approximated by Padé's approximant of
    order 3.

    The phase is accurate to 1e-6 below 0.7/seconds rad/s.

    seconds: delay, s
    """
    from control import pade, ss, tf

    delay = ss(tf(*pade(seconds, 3)))
    m = loop.B.shape[1]
    n = len(loop.A)
    A, B, C, D = (np.kron(np.eye(m), getattr(delay, name)) for name in "ABCD")
    return replace(
        loop,
        A=np.block([[loop.A, loop.B @ C], [np.zeros((len(A), n)), A]]),
        B=np.vstack([loop.B @ D, B]),
        C=np.hstack([loop.C, np.zeros((len(loop.C), len(A)))]),
    )


def slowest_delayed(
    aircraft: Model, controller: ScheduledController, degrees: Sequence[float]
) -> float:
    """Return the largest real part of the poles of the closed loop with the delay `DELAY`, 1/s.

    The maximum is over the dihedral angles, the actuators in `REAL`, and effectiveness 0.5 and 1.

    degrees: dihedral angles
    """
    found = []
    for model in [level_model(aircraft, math.radians(each)) for each in degrees]:
        for acting, share in itertools.product(REAL, (0.5, 1.0)):
            actuators = dict.fromkeys(controller.inputs, replace(acting, effectiveness=share))
            loop = servo_loop(servo_plant(aircraft, model, controller, actuators), controller)
            found.append(delayed(loop, DELAY).stability.value)
    return max(found)


def requirements(aircraft: Model, controller: ScheduledController) -> Report:
    """Return a report of the required and the achieved values of a servo controller.

    The report covers margins, gusts, and the effects of a biased gyro and noisy sensors.
    """
    degrees = np.arange(21.0)
    single = check_margins(aircraft, controller, np.radians(degrees), (2.0, 10.0)).single
    found: list[dict[str, Any]] = [
        {"what": "gain margin, dB", "asked": 6.0, "reached": min(each.gain for each in single)},
        {"what": "phase margin, deg", "asked": 45.0, "reached": min(each.phase for each in single)},
        {
            "what": "delay margin, one loop, ms",
            "asked": 20.0,
            "reached": 1e3 * min(each.delay for each in single),
        },
        {
            "what": "slowest pole with 20 ms, effectiveness 0.5 to 1, 1/s",
            "asked": 0.0,
            "reached": slowest_delayed(aircraft, controller, degrees.tolist()),
        },
    ]
    models = {each: level_model(aircraft, math.radians(each)) for each in ANGLES}
    for (length, asked), k in itertools.product(ASKED.items(), range(3)):
        held = {
            f"{angle:g} deg {way}": abs(
                gust_held(
                    aircraft,
                    model,
                    controller,
                    REAL[k],
                    length,
                    asked[k] if way == "up" else -asked[k],
                )
            )
            for angle, model in models.items()
            for way in ("up", "down")
        }
        worst = min(held, key=lambda where: held[where])
        what = f"gust of {length:g} ft, order {REAL[k].order}, {REAL[k].bandwidth:g} rad/s, ft/s"
        found.append(
            {"what": what, "asked": asked[k], "reached": held[worst], "where": worst, "held": held}
        )
    at_11 = models[11.0]
    one = np.eye(len(LINEAR_STATES))[LINEAR_STATES.index("pitch_rate")]
    for acting in REAL:
        words = f", order {acting.order}, {acting.bandwidth:g} rad/s, deg"
        biased = simulated_flight(
            aircraft,
            at_11,
            controller,
            acting,
            duration=120.0,
            noise=Waveform(BIAS * one, 0.0 * one),
        )
        error = np.degrees(np.abs(biased.states[-1, 5] - at_11.point.states.dihedral))
        found.append(
            {"what": f"gyro 0.3 deg/s off: dihedral{words}", "asked": 0.3, "reached": float(error)}
        )
        noisy = Scenario(
            duration=60.0, step=STEP, tick=STEP, uncertainty=Uncertainty(noise=NOISE)
        ).drawn(1, 0, at_11.point)
        quiet = simulated_flight(
            aircraft, at_11, controller, acting, duration=60.0, tick=STEP, samples=noisy.samples
        )
        rates = np.degrees(
            np.abs(np.diff(quiet.flight.inputs[:, 1:], axis=0)) / STEP
        )  # without the throttle
        found.append(
            {"what": f"noise: surface rate{words}/s", "asked": 4.0, "reached": float(rates.max())}
        )
    rows = [
        (each["what"], f"{each['asked']:g}", f"{each['reached']:.3g}", each.get("where", ""))
        for each in found
    ]
    title = f"Requirements of controller {controller.name}, {controller.dynamics} dynamics"
    return Report(
        title,
        (Table(("requirement", "asked", "reached", "where"), rows),),
        data={"requirements": found},
    )
