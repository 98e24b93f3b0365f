"""What moving air does: root mean squares of a linear loop in turbulence, and how far a gust brings the aircraft."""

from __future__ import annotations

import math

import numpy as np

from controller.design.design import Actuator
from controller.design.design_model import DesignModel
from controller.design.scheduled_controller import ScheduledController
from controller.design.servo_loop import ServoLoop
from controller.flight.actuators import ActuatorFault, Actuators
from controller.flight.envelope import angles_of_attack, flight_envelope, share_of_way
from controller.flight.gusts import OneMinusCosine
from controller.flight.nonlinear_flight import fly_law
from controller.flight.plants import NonlinearPlant
from controller.flight.scenario import Scenario
from controller.policy.commands import CommandSteps
from controller.policy.servo_policy import servo_law
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import STATES, Input
from trim.linear.linear_model import LinearModel
from trim.point.condition import CONTROL_LIMITS
from verification.synthesis.command_flight import commanded
from verification.synthesis.tuning import InGust

#: s: step of a flight in a gust, how often the envelope is looked at, and how long it lasts.
STEP, TICK, SECONDS = 0.01, 0.2, 30.0
#: ft/s: the largest peak that is tried, and how closely the one is found that ends a flight.
LARGEST, APART = 60.0, 0.5


def turbulence_rms(plant: DesignModel, loop: ServoLoop, intensity: float, scale: float) -> dict[str, float]:
    """Root mean square of every state of the plant in stationary Dryden turbulence, in its unit.

    w = sigma sqrt(τ) (1 + √3 τ s) / (1 + τ s)² n,  τ = scale / V,  n white: A_t P + P A_t' + b b' = 0 of the loop with
    the filter of the air. intensity: sigma, ft/s. scale: ft. The loop must be stable. Source: MIL-F-8785C, 3.7.1.2.
    """
    from scipy.linalg import solve_continuous_lyapunov

    tau = scale / plant.model.point.states.speed
    air = np.array([[0.0, 1.0], [-1.0 / tau**2, -2.0 / tau]])
    w = intensity * math.sqrt(tau) * np.array([[1.0, math.sqrt(3.0) * tau]])
    total = _with_air(loop, air, w)
    white = np.zeros((len(total), 1))
    white[-1] = 1.0 / tau**2
    covariance = solve_continuous_lyapunov(total, -white @ white.T)
    rms = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return dict(zip(plant.states, rms.tolist(), strict=False))


def gust_share(aircraft: Aircraft, model: LinearModel, controller: ScheduledController, gust: InGust) -> float:
    """Largest share of the way from the trim to a limit of the envelope that the nonlinear aircraft goes in a gust.

    w = peak/2 (1 - cos(2π V t / length)), alpha through the air, no commands, positions within `CONTROL_LIMITS`,
    `SECONDS` in all. 2 - t / `SECONDS` when it leaves the envelope at t: 1 is what is just held.
    """
    point, acting = model.point, gust.actuator
    names = commanded(controller)
    still = CommandSteps(names, np.zeros(0), np.zeros((0, len(names))))
    scenario = Scenario(
        duration=SECONDS,
        step=STEP,
        tick=TICK,
        actuators=flown_actuators(acting),
        gust=OneMinusCosine(gust.length, gust.peak, point.states.speed),
    )
    envelope = flight_envelope(aircraft.parameters, point)
    law = servo_law(controller, still, aircraft, point)
    flown = fly_law(NonlinearPlant(aircraft, point), law, scenario, envelope)
    if flown.departure is not None:
        return 2.0 - flown.departure.time / SECONDS
    X0 = np.array(point.states)
    states = flown.flight.states + X0
    states[:, STATES.index("alpha")] = angles_of_attack(states, flown.flight.updrafts)
    return float(share_of_way(states, X0, np.array([envelope.lowest, envelope.highest]).T).max())


def gust_held(aircraft: Aircraft, model: LinearModel, controller: ScheduledController, gust: InGust) -> float:
    """Largest peak, ft/s, > 0, that is stood in the direction of `gust`, its smaller ones too, to within `APART`.

    `LARGEST` when nothing up to it ends the flight. Peaks are tried in steps of ten times `APART`, then halved.
    """

    def stood(peak: float) -> bool:
        signed = gust._replace(peak=math.copysign(peak, gust.peak))
        return gust_share(aircraft, model, controller, signed) <= 1.0

    low, high = 0.0, 10.0 * APART
    while stood(high):
        if high >= LARGEST:
            return LARGEST
        low, high = high, min(high + 10.0 * APART, LARGEST)
    while high - low > APART:
        middle = (low + high) / 2.0
        low, high = (middle, high) if stood(middle) else (low, middle)
    return low


def flown_actuators(acting: Actuator, faults: tuple[ActuatorFault, ...] = ()) -> Actuators:
    """All five alike, within the control limits of a trim, without a limit of rate."""
    lowest, highest = (Input(*(pair[side] for pair in CONTROL_LIMITS)) for side in (0, 1))
    lag, rate = (Input(*[each] * len(lowest)) for each in (1.0 / acting.bandwidth, np.inf))
    if acting.effectiveness != 1.0:
        faults = (ActuatorFault(0.0, acting.effectiveness), *faults)
    return Actuators(lag, lowest, highest, rate, acting.order, acting.damping, faults)


def _with_air(loop: ServoLoop, air: np.ndarray, w: np.ndarray) -> np.ndarray:
    """The matrix of [x; x_c; states of the air], their output w being the updraft."""
    n = len(loop.closed)
    return np.block([[loop.closed, loop.disturbed @ w], [np.zeros((len(air), n)), air]])
