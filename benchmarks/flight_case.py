"""The benchmark flight as data, and the same flight written in C, NumPy and JAX."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import FOLDER
from controller.flight.closed_loop import ClosedLoop
from controller.flight.plants import LinearPlant
from controller.flight.scenario import Scenario
from controller.flight.simulation import CompiledLoop
from controller.game.basis import basis
from controller.game.zero_sum import published_game
from controller.policy.signals import Harmonic, Signal, zero
from controller.riccati.gare import solve_game
from hfa_model.printed_matrices import published_models
from hfa_support.native.machine_code import c_compiler
from studies.section5.critic_policy import CriticPolicy
from studies.update_law.published_law import PublishedSettings, published_law

STEP, STEPS = 1e-4, 200_000
_QUARTIC = (0, 1, 3, 4)

Contestant = Callable[[], np.ndarray]


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of two histories, as a fraction of the largest value of that state, or of any weight.

    The power 1 - eta of Eq. (46) has an infinite slope where a residual is 0: there a rounding error of 1e-16 becomes
    1e-16 to that power, and two orders of summation differ by far more than rounding.
    """
    largest = np.abs(other).max(axis=0)
    largest[6:] = largest[6:].max()
    return float((np.abs(one - other).max(axis=0) / largest).max())


class FlightCase:
    """The loop of paper Section 5.1 at 5 degrees with a bounded setting of its law, as data for every contestant."""

    def __init__(self) -> None:
        model = next(model for model in published_models() if model.dihedral_deg == 5.0)
        game = published_game(model.A, model.B)
        settings = PublishedSettings(
            samples=50,
            coordinates="scaled",
            normalisation="root",
            gains=(100.0, 100.0),
            initial_weights=tuple(_start(game)),
            recorded_weights=tuple(_start(game)),
        )
        self.law = published_law(game, settings, seed=0)
        nothing = np.zeros(6)
        self.reference = Signal(
            np.array([7.0, 0.1, 0, 0, 0.5, 0]),
            np.array([0.01, 0, 0, 0, 0, 0]),
            (Harmonic(0.5, np.array([2.0, 0, 0, 0, 0, 0]), nothing),),
        )
        self.disturbance = Signal(
            nothing,
            nothing,
            (Harmonic(0.1, 1.1 * np.array([0.1, 0.2, 0, 0.1, 0, 0.1]), 1.1 * np.array([0, 0, 0.2, 0, 0.1, 0])),),
        )
        policy = CriticPolicy(self.law, zero(6))
        self.plant, self.policy = LinearPlant(game.A, game.B), policy
        weights = self.law.start()["weights"]
        self.start = np.concatenate([[5.0, 0.05, 0, 0, 0, 0], weights])
        self.compiled = lru_cache(self._compiled)

    def fly(self, compile_code: bool, steps: int = STEPS) -> np.ndarray:
        """Our loop: every state at every step."""
        flight = self.compiled(compile_code, steps).fly(self.start[:6], lambda tick: np.ones(1), memory=self.start[6:])
        return np.hstack([flight.states, flight.memory])

    def _compiled(self, compile_code: bool, steps: int) -> CompiledLoop:
        tick = STEP * min(steps, 1000)
        scenario = Scenario(steps * STEP, STEP, tick, reference=self.reference, disturbance=self.disturbance)
        return CompiledLoop(ClosedLoop(self.plant, self.policy, scenario), flights=STEPS * compile_code)

    def data(self) -> dict[str, Any]:
        """Everything that the loop depends on, as arrays."""
        law, game = self.law, self.law.game
        equations = law.equations
        stored = law.recorded(np.zeros(law.basis.size))
        wave = self.disturbance.harmonics[0]
        return {
            "A": game.A,
            "B": game.B,
            "RB": game.R_inverse_B_transposed,
            "scales": equations.scales,
            "S": equations.S,
            "Q": equations.Q,
            "regressors": stored.regressors,
            "residuals": stored.residuals,
            "reference": np.array([self.reference.constant, self.reference.slope, self.reference.harmonics[0].sine]),
            "disturbance": np.array([wave.sine, wave.cosine]),
            "gamma": law.settings.gamma,
            "alpha1": law.gains[0],
            "alpha2": law.gains[1],
            "eta": law.settings.eta,
        }


def _start(game) -> list[float]:
    """A stabilizing start: the LQR value, in the paper's basis."""
    return basis("paper", 6).weights(solve_game(game.with_delta(np.inf)).P).tolist()


class _Loop(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.POINTER(ctypes.c_double)) for name in ("A", "B", "RB", "scales", "S", "Q")),
        *((name, ctypes.POINTER(ctypes.c_double)) for name in ("regressors", "residuals", "reference", "disturbance")),
        *((name, ctypes.c_double) for name in ("gamma", "alpha1", "alpha2", "eta")),
    ]


def c_flight(case: FlightCase, steps: int = STEPS) -> Contestant:
    """The hand-written C loop as a function () -> history."""
    folder = tempfile.mkdtemp()
    library = Path(folder) / "flight_loop.so"
    source = FOLDER / "flight_loop.c"
    subprocess.run([c_compiler(), "-O3", "-fPIC", "-shared", str(source), "-o", str(library), "-lm"], check=True)
    code = ctypes.CDLL(str(library))
    pointer = ctypes.POINTER(ctypes.c_double)
    arrays = {name: np.ascontiguousarray(value, dtype=float) for name, value in case.data().items()}
    loop = _Loop(
        **{
            name: (value.ctypes.data_as(pointer) if value.size > 1 else float(value[0]))
            for name, value in arrays.items()
        }
    )

    def fly() -> np.ndarray:
        history = np.empty((steps + 1, len(case.start)))
        history[0] = case.start
        code.flight(ctypes.byref(loop), ctypes.c_double(STEP), ctypes.c_long(steps), history.ctypes.data_as(pointer))
        return history

    fly.keep = arrays  # type: ignore[attr-defined]
    return fly


def python_rate(np_: Any, data: dict[str, Any]):
    """(t, y) -> y' with arrays of `np_` (NumPy or jax.numpy)."""
    i, j = np.triu_indices(6)
    quartic = np.array(_QUARTIC)
    A, B, RB, scales, S, Q = (np_.asarray(data[name]) for name in ("A", "B", "RB", "scales", "S", "Q"))
    regressors, residuals = np_.asarray(data["regressors"]), np_.asarray(data["residuals"])
    reference, disturbance = np_.asarray(data["reference"]), np_.asarray(data["disturbance"])
    gamma, alpha1, alpha2, eta = (float(data[name]) for name in ("gamma", "alpha1", "alpha2", "eta"))
    # ∂ψ/∂z as a constant tensor on z (quadratic part); the quartic part is added by hand.
    tensor = np.zeros((25, 6, 6))
    for k, (a, b) in enumerate(zip(i, j, strict=True)):
        tensor[k, a, b] += 1
        tensor[k, b, a] += 1
    tensor = np_.asarray(tensor)
    place = np.zeros((25, 6))
    place[21 + np.arange(4), quartic] = 4.0
    place = np_.asarray(place)

    def powers(e):
        size = np_.abs(e)
        low = size ** (1 - eta)
        return np_.sign(e) * ((alpha1 + 1) * low + (alpha2 + 1) * (size * size / (low + 2.2e-308)))

    def rate(t, y):
        x, w = y[:6], y[6:]
        z = x - (reference[0] + reference[1] * t + reference[2] * np_.sin(0.5 * t))
        v = z / scales
        jacobian = tensor @ v + place * v**3
        g = jacobian.T @ w
        u = -0.5 * RB @ (g / scales)
        d = disturbance[0] * np_.sin(0.1 * t) + disturbance[1] * np_.cos(0.1 * t)
        pushed = S @ g
        sigma = jacobian @ (A @ z / scales - 0.5 * pushed)
        e = w @ sigma + v @ Q @ v + 0.25 * g @ pushed
        n = np_.sqrt(1 + sigma @ sigma)
        push = regressors.T @ powers(regressors @ w + residuals) + sigma / n * powers(e / n)
        return np_.concatenate([A @ x + B @ u + d, -gamma * push])

    return rate


def runge_kutta(rate, t, y, h):
    """One classical step."""
    k1 = rate(t, y)
    k2 = rate(t + h / 2, y + h / 2 * k1)
    k3 = rate(t + h / 2, y + h / 2 * k2)
    k4 = rate(t + h, y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def numpy_flight(case: FlightCase, steps: int) -> np.ndarray:
    """The loop in NumPy, step by step."""
    rate = python_rate(np, case.data())
    history = np.empty((steps + 1, len(case.start)))
    history[0] = case.start
    for step in range(steps):
        history[step + 1] = runge_kutta(rate, step * STEP, history[step], STEP)
    return history


def jax_flight(case: FlightCase, steps: int = STEPS) -> Contestant:
    """The loop as a JAX scan on the CPU, in double precision; ImportError where it is not installed."""
    import jax

    jax.config.update("jax_enable_x64", True)
    rate = python_rate(jax.numpy, case.data())

    def step(y, k):
        following = runge_kutta(rate, k * STEP, y, STEP)
        return following, following

    scan = jax.jit(lambda y: jax.lax.scan(step, y, jax.numpy.arange(steps))[1])
    return lambda: np.vstack([case.start, np.asarray(scan(case.start))])
