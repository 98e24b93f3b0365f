"""Linear and nonlinear flights of one controller, against a second integration and frequency responses."""

from __future__ import annotations

import math
from functools import cache

import casadi as ca
import numpy as np
import pytest
from known_models import model_at
from project import ROOT
from scipy.integrate import quad
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize_scalar
from servo_cases import measured_servo

from controller import (
    ActuatorFault,
    Actuators,
    CommandSteps,
    Game,
    OneMinusCosine,
    Scenario,
    ScheduledController,
    design_model,
    flight_envelope,
    load_design,
)
from controller.design.design import Actuator
from controller.design.design_model import DesignModel
from controller.design.servo_loop import ServoLoop, servo_loop, servo_plant
from controller.flight.nonlinear_flight import NonlinearFlight, fly_law
from controller.flight.plants import NonlinearPlant
from controller.policy.servo_policy import servo_law
from controller.riccati.gare_schur import quick_solution
from hfa_model import INPUTS, STATES, Aircraft, Input
from studies.servo import flights
from studies.servo.feedforward import shaped_design
from studies.servo.flights import HELD, LARGEST, best_inputs, gust_held, gust_share, turbulence_rms, updraft_cost
from studies.servo.search import quick_controller
from studies.servo.tuning import InGust, design_entries
from verification import solve_game

SIGMA, SCALE, LENGTH = 3.0, 1750.0, 400.0
NAMES, BANDWIDTH, FINER = ("aileron_outer", "elevator_center"), 2.0, 20


@cache
def _table() -> ScheduledController:
    return quick_controller(Aircraft(), model_at(11.0), measured_servo())


@cache
def closed() -> tuple[DesignModel, ServoLoop]:
    plant = servo_plant(Aircraft(), model_at(11.0), _table(), dict.fromkeys(_table().inputs, Actuator()))
    return plant, servo_loop(plant, _table())


def rms_by_frequency(loop: ServoLoop, row: int, speed: float) -> float:
    """sqrt(1/π ∫ |G|² |H|² dω) of the Dryden filter H, over the logarithm of the frequency."""
    tau = SCALE / speed

    def density(logarithm: float) -> float:
        s = 1j * math.exp(logarithm)
        filtered = SIGMA * math.sqrt(tau) * (1 + math.sqrt(3) * tau * s) / (1 + tau * s) ** 2
        response = np.linalg.solve(s * np.eye(len(loop.closed)) - loop.closed, loop.disturbed)[row, 0]
        return float(abs(filtered * response) ** 2 * abs(s) / math.pi)

    return math.sqrt(quad(density, math.log(1e-4), math.log(1e3), limit=400, epsrel=1e-8)[0])


def test_turbulence_is_the_integral_of_the_frequency_response() -> None:
    plant, loop = closed()
    found, speed = turbulence_rms(plant, loop, SIGMA, SCALE), plant.model.point.states.speed
    for name in ("speed", "dihedral"):
        assert found[name] == pytest.approx(rms_by_frequency(loop, plant.states.index(name), speed), rel=1e-5)


def in_gust(peak: float) -> float:
    return gust_share(Aircraft(), model_at(11.0), _table(), InGust(0.0, Actuator(effectiveness=0.8), LENGTH, peak))


def flown(peak: float) -> NonlinearFlight:
    """The same gust, actuators and controller in a flight by itself, with a finer step."""
    aircraft, point = Aircraft(), model_at(11.0).point
    lowest, highest = (
        Input(200.0 * side, *[math.radians(20) * sign] * 2, *[math.radians(30) * sign] * 2)
        for side, sign in ((0, -1), (1, 1))
    )
    lag, rate = Input(*[0.5] * 5), Input(*[math.inf] * 5)
    scenario = Scenario(
        duration=30.0,
        step=0.005,
        tick=0.5,
        actuators=Actuators(lag, lowest, highest, rate, faults=(ActuatorFault(0.0, 0.8, inputs=INPUTS[1:]),)),
        gust=OneMinusCosine(LENGTH, peak, point.states.speed),
    )
    law = servo_law(_table(), CommandSteps(("dihedral",), np.zeros(0), np.zeros((0, 1))), aircraft, point)
    return fly_law(NonlinearPlant(aircraft, point), law, scenario, flight_envelope(aircraft, point))


@pytest.mark.parametrize("peak", [16.0, -16.0])
def test_the_share_of_the_envelope_is_that_of_a_flight_by_itself(peak: float) -> None:
    whole, at, found = flown(peak), model_at(11.0).point.states, 0.0
    flight, envelope = whole.flight, whole.envelope
    for name, column in zip(STATES, flight.states.T, strict=True):
        moved = column + (np.arctan2(flight.updrafts.ravel(), at.speed) if name == "alpha" else 0.0)
        low, high = (getattr(each, name) - getattr(at, name) for each in (envelope.lowest, envelope.highest))
        found = max(found, moved.max() / high, moved.min() / low)
    assert 0.15 < found < 0.9
    assert in_gust(peak) == pytest.approx(found, rel=0.02)


def test_the_gust_that_is_just_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """A little more than what is held ends the flight; what is never ended counts as the largest that is tried."""
    monkeypatch.setattr(flights, "APART", apart := 2.0)
    asked = InGust(0.0, Actuator(effectiveness=0.8), LENGTH, 1.0)
    peak = gust_held(Aircraft(), model_at(11.0), _table(), asked)
    assert 0.0 < peak < LARGEST
    assert in_gust(peak) <= 1.0 < in_gust(peak + apart)
    down = gust_held(Aircraft(), model_at(11.0), _table(), asked._replace(peak=-1.0))
    assert in_gust(-down) <= 1.0 < in_gust(-down - apart)
    monkeypatch.setattr(flights, "LARGEST", peak - apart)
    assert gust_held(Aircraft(), model_at(11.0), _table(), asked) == peak - apart


def test_no_updraft_costs_more_than_the_worst(published_aircraft: Aircraft) -> None:
    """The mean cost of cos(ωt) in the long run, per (ft/s)² s of it, by the frequency response."""
    built = design_model(published_aircraft, model_at(11.0), load_design("simvfa-1"))
    game = built.game()
    K = solve_game(game).K
    found = updraft_cost(built, game, K).data

    def mean_cost(frequency: float) -> float:
        z = np.linalg.solve(1j * frequency * np.eye(len(K.T)) - game.A + game.B @ K, built.gust)[:, 0]
        return float((z.conj() @ (game.Q + K.T @ game.R @ K) @ z).real)

    assert mean_cost(found["frequency"]) == pytest.approx(found["cost"])
    assert all(mean_cost(frequency) <= found["cost"] * (1 + 1e-9) for frequency in np.geomspace(1e-3, 1e2, 200))
    assert 200.0 * found["dihedral"] ** 2 == pytest.approx(found["cost"])


def flown_again(plant: NonlinearPlant, peak: float, commands: np.ndarray) -> np.ndarray:
    """States, absolute, by Runge-Kutta steps of 5 ms under the same commands."""
    rows = [INPUTS.index(name) for name in NAMES]
    trim = np.array(plant.point.inputs)[rows]
    gust = OneMinusCosine(LENGTH, peak, plant.point.states.speed)
    x, c, t = ca.SX.sym("x", 9), ca.SX.sym("c", 2), ca.SX.sym("t")
    u = ca.SX.zeros(5)
    u[rows] = x[7:]
    w = gust.updraft(t, None, None)
    f = ca.Function(
        "f", [x, c, t], [ca.vertcat(plant.rate(x[:7], u, ca.SX.zeros(6), {"updraft": w}), BANDWIDTH * (c - x[7:]))]
    )
    h, path = HELD / FINER, [np.zeros(9)]
    for k in range(FINER * len(commands)):
        held, now = commands[k // FINER] - trim, path[-1]
        a = f(now, held, k * h)
        b = f(now + h / 2 * a, held, (k + 0.5) * h)
        d = f(now + h / 2 * b, held, (k + 0.5) * h)
        path.append(np.array(now + h / 6 * (a + 2 * b + 2 * d + f(now + h * d, held, (k + 1) * h))).ravel())
    return np.array(path)[:, :7] + np.array(plant.point.states)


def test_a_shorter_look_is_the_same_problem(published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch) -> None:
    """Back at trim after 10 s, in a coarse grid: the path obeys the equations and the limits of the commands."""
    monkeypatch.setattr(flights, "BEST_SECONDS", 10.0)
    point = model_at(11.0).point
    plant = NonlinearPlant(published_aircraft, point)
    envelope = flight_envelope(published_aircraft, point)
    found = best_inputs(plant, envelope, NAMES, LENGTH, -1.0, BANDWIDTH)
    assert found.peak < -20.0
    assert np.abs(np.degrees(found.commands[:, 0])).max() < 20.0
    assert envelope.inside(found.states[[0, -1]]).all()
    again = flown_again(plant, found.peak, found.commands)[::FINER]
    names = ("speed", "pitch", "dihedral")
    columns = [STATES.index(name) for name in names]
    np.testing.assert_allclose(again[:, columns], found.states[:, columns], rtol=0.02, atol=0.05)


FAILING = {"bandwidth": 0.6, "effectiveness": 0.25}
#: Words of findings.md -> actuators: the four of the search, and those of the members flown with a fault.
BOUNDED = {
    "1, whole": Actuator(),
    "1, failing": Actuator(1, **FAILING),
    "2, whole": Actuator(2),
    "2, failing": Actuator(2, damping=0.8, **FAILING),
    "1, effectiveness 0.2, 0.5 rad/s": Actuator(1, bandwidth=0.5, effectiveness=0.2),
    "2, effectiveness 0.2, 0.5 rad/s": Actuator(2, bandwidth=0.5, effectiveness=0.2, damping=0.7),
}


@pytest.mark.parametrize("words", BOUNDED)
def test_no_one_misses_less_in_turbulence_with_the_commands_of_servo_gusts(words: str) -> None:
    """mean η² + r u'u >= E'X E for every r and u, X of the Riccati equation of η² + r u'u, the air among the states:
    mean η² >= max_r E'X E - r mean u'u, which the gain of that r attains with just these commands."""
    aircraft, model = Aircraft(), model_at(11.0)
    table = quick_controller(aircraft, model, shaped_design("servo-gusts", design_entries("servo-gusts"))[0])
    plant = servo_plant(aircraft, model, table, dict.fromkeys(table.inputs, BOUNDED[words]))
    loop, n, tau = servo_loop(plant, table), len(plant.A), SCALE / model.point.states.speed
    w = SIGMA * math.sqrt(tau) * np.array([[1.0, math.sqrt(3.0) * tau]])
    A = np.block([[plant.A, plant.gust @ w], [np.zeros((2, n)), np.array([[0.0, 1.0], [-1.0 / tau**2, -2.0 / tau]])]])
    B, E = np.vstack([plant.B, np.zeros((2, 2))]), np.append(np.zeros(n + 1), 1.0 / tau**2)[:, None]
    row = plant.states.index("dihedral")
    C = np.hstack([loop.C, loop.F @ w])
    whole = np.block([[A + B @ loop.Dk @ C, B @ loop.Ck], [loop.Bk @ C, loop.Ak]])
    P = covariance(whole, np.vstack([E, np.zeros((len(loop.Ak), 1))]))
    rms = math.sqrt(P[row, row])
    assert rms == pytest.approx(turbulence_rms(plant, loop, SIGMA, SCALE)["dihedral"], rel=1e-6)
    u = np.hstack([loop.Dk @ C, loop.Ck])
    allowed = float(np.trace(u @ P @ u.T))

    Q = np.zeros_like(A)
    Q[row, row] = 1.0

    def game(logarithm: float) -> Game:
        return Game(A=A, B=B, E=E, Q=Q, R=math.exp(logarithm) * np.eye(2), delta=math.inf)

    def below(logarithm: float) -> float:
        return math.exp(logarithm) * allowed - float((E.T @ quick_solution(game(logarithm)) @ E)[0, 0])

    found = minimize_scalar(below, bounds=(-17.0, 0.0), method="bounded", options={"xatol": 1e-4})
    K = game(found.x).gain(quick_solution(game(found.x)))
    attained, smallest = covariance(A - B @ K, E), math.sqrt(-found.fun)
    assert smallest < rms
    assert math.sqrt(attained[row, row]) == pytest.approx(smallest, rel=1e-3)
    assert np.trace(K @ attained @ K.T) == pytest.approx(allowed, rel=5e-3)
    figures = f"{math.degrees(rms):.3f} | {math.degrees(math.sqrt(allowed)):.0f} | {math.degrees(smallest):.3f}"
    assert f"| {words} | {figures} |" in (ROOT / "studies" / "servo" / "findings.md").read_text(encoding="utf-8")


def covariance(A: np.ndarray, E: np.ndarray) -> np.ndarray:
    found: np.ndarray = solve_continuous_lyapunov(A, -E @ E.T)
    return found
