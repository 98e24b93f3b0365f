"""What turbulence must add to the dihedral, whoever flies: the bound of docs/servo.md, and that it is one."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from known_models import model_at
from project import ROOT
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize_scalar

from controller import Actuator, load_design
from controller.design.servo_loop import ServoLoop, servo_loop, servo_plant
from controller.game.zero_sum import Game
from controller.riccati.gare_schur import quick_solution
from hfa_model import Aircraft
from verification.synthesis.design_evaluation import quick_controller
from verification.synthesis.moving_air import turbulence_rms

#: ft/s and ft, of the searches and of the members flown in turbulence.
INTENSITY, SCALE = 3.0, 1750.0
FAILING = {"bandwidth": 0.6, "effectiveness": 0.25}
#: Words of the document -> actuators: the four of the search, and those of the members flown with a fault.
CASES = {
    "1, whole": Actuator(),
    "1, failing": Actuator(1, **FAILING),
    "2, whole": Actuator(2),
    "2, failing": Actuator(2, damping=0.8, **FAILING),
    "1, effectiveness 0.2, 0.5 rad/s": Actuator(1, bandwidth=0.5, effectiveness=0.2),
    "2, effectiveness 0.2, 0.5 rad/s": Actuator(2, bandwidth=0.5, effectiveness=0.2, damping=0.7),
}


class InAir(NamedTuple):
    """[x; air]' = A [x; air] + B u + E n, n white of unit intensity; dihedral: row of it. loop: of `servo-gusts`."""

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    dihedral: int
    loop: ServoLoop
    rms: float
    w: np.ndarray


def in_air(acting: Actuator) -> InAir:
    aircraft, model = Aircraft(), model_at(11.0)
    design = replace(load_design("servo-gusts"), feedforward=None)
    table = quick_controller(aircraft, model, design)
    plant = servo_plant(aircraft, model, table, dict.fromkeys(table.inputs, acting))
    loop, n = servo_loop(plant, table), len(plant.A)
    tau = SCALE / model.point.states.speed
    air = np.array([[0.0, 1.0], [-1.0 / tau**2, -2.0 / tau]])
    w = INTENSITY * math.sqrt(tau) * np.array([[1.0, math.sqrt(3.0) * tau]])
    A = np.block([[plant.A, plant.gust @ w], [np.zeros((2, n)), air]])
    E = np.append(np.zeros(n + 1), 1.0 / tau**2)[:, None]
    rms = turbulence_rms(plant, loop, INTENSITY, SCALE)["dihedral"]
    return InAir(A, np.vstack([plant.B, np.zeros((2, 2))]), E, plant.states.index("dihedral"), loop, rms, w)


def covariance(A: np.ndarray, E: np.ndarray) -> np.ndarray:
    found: np.ndarray = solve_continuous_lyapunov(A, -E @ E.T)
    return found


def commands(case: InAir) -> np.ndarray:
    """Mean square of what `servo-gusts` tells each input in this air, rad², (2,)."""
    loop = case.loop
    C = np.hstack([loop.C, loop.F @ case.w])
    total = np.block([[case.A + case.B @ loop.Dk @ C, case.B @ loop.Ck], [loop.Bk @ C, loop.Ak]])
    P = covariance(total, np.vstack([case.E, np.zeros((len(loop.Ak), 1))]))
    assert math.sqrt(P[case.dihedral, case.dihedral]) == pytest.approx(case.rms, rel=1e-6)
    told = np.hstack([loop.Dk @ C, loop.Ck])
    return np.asarray(np.diag(told @ P @ told.T))


def least(case: InAir, allowed: float) -> tuple[float, float, float]:
    """Smallest rms of the dihedral η, rad, of any u with mean u'u <= allowed; rms and mean u'u of the gain that has it.

    mean η² + r u'u >= E'X E for every r and u, X of the Riccati equation of η² + r u'u: mean η² >= E'X E - r allowed.
    """
    Q = np.zeros_like(case.A)
    Q[case.dihedral, case.dihedral] = 1.0

    def game(logarithm: float) -> Game:
        return Game(A=case.A, B=case.B, E=case.E, Q=Q, R=math.exp(logarithm) * np.eye(2), delta=math.inf)

    def bound(logarithm: float) -> float:
        X = quick_solution(game(logarithm))
        return float((case.E.T @ X @ case.E)[0, 0] - math.exp(logarithm) * allowed)

    found = minimize_scalar(lambda each: -bound(each), bounds=(-17.0, 0.0), method="bounded", options={"xatol": 1e-4})
    K = game(found.x).gain(quick_solution(game(found.x)))
    P = covariance(case.A - case.B @ K, case.E)
    return math.sqrt(-found.fun), math.sqrt(P[case.dihedral, case.dihedral]), float(np.trace(K @ P @ K.T))


@pytest.mark.parametrize("words", CASES)
def test_no_one_misses_less_with_such_commands(words: str) -> None:
    case = in_air(CASES[words])
    moved = commands(case)
    smallest, attained, effort = least(case, float(moved.sum()))
    assert smallest < case.rms
    # Who knows the states and the air attains it, with just these commands: the bound is the best there is.
    assert attained == pytest.approx(smallest, rel=1e-3)
    assert effort == pytest.approx(moved.sum(), rel=5e-3)
    figures = [f"{math.degrees(case.rms):.3f}", f"{math.degrees(math.sqrt(moved.sum())):.0f}"]
    row = f"| {words} | {' | '.join(figures)} | {math.degrees(smallest):.3f} |"
    assert row in (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")


def test_what_one_and_a_half_times_the_calm_error_leaves_for_turbulence() -> None:
    """Errors of commands and of the air add as squares; 0.215 deg is the calm error with that fault."""
    left = 0.215 * math.sqrt(1.5**2 - 1.0)
    case = in_air(CASES["2, effectiveness 0.2, 0.5 rad/s"])
    smallest, _, _ = least(case, float(commands(case).sum()))
    text = (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")
    assert f"may add {left:.2f} deg, and {math.degrees(smallest):.2f} deg" in text
