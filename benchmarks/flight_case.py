"""The benchmark flight as data, and the same flight written in C."""

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
from controller.flight.closed_loop import ClosedLoop, LinearPlant
from controller.flight.scenario import Scenario
from controller.flight.simulation import CompiledLoop
from controller.game.basis import basis
from controller.game.zero_sum import published_game
from controller.policy.policies import FlownLaw
from controller.policy.signals import Harmonic, Signal, zero
from controller.riccati.gare import solve_game
from hfa_model.printed_matrices import published_models
from hfa_support.native.machine_code import c_compiler
from studies.section5.critic_policy import CriticPolicy
from studies.update_law.published_law import PublishedSettings, published_law

STEP, STEPS = 1e-4, 200_000


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of two histories, as a fraction of the largest value of that state, or of any weight.

    The power 1 - eta of Eq. (46) has an infinite slope where a residual is 0: there a rounding error of 1e-16 becomes
    1e-16 to that power, and two orders of summation differ by far more than rounding.
    """
    largest = np.abs(other).max(axis=0)
    largest[6:] = largest[6:].max()
    return float((np.abs(one - other).max(axis=0) / largest).max())


class FlightCase:
    """The loop of paper Section 5.1 at 5 degrees with a bounded setting of its law, as data for the peer."""

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
        self.plant = LinearPlant(game.A, game.B)
        weights = self.law.start()["weights"]
        self.flown = FlownLaw("published", CriticPolicy(self.law, zero(6)), np.ones((1, 1)), weights)
        self.start = np.concatenate([[5.0, 0.05, 0, 0, 0, 0], weights])
        self.compiled = lru_cache(self._compiled)

    def fly(self, compile_code: bool, steps: int = STEPS) -> np.ndarray:
        """Our loop: every state at every step."""
        flight = self.compiled(compile_code, steps).fly()
        return np.hstack([flight.states, flight.memory])

    def _compiled(self, compile_code: bool, steps: int) -> CompiledLoop:
        tick = STEP * min(steps, 1000)
        scenario = Scenario(steps * STEP, STEP, tick, self.start[:6], self.reference, self.disturbance)
        return CompiledLoop(ClosedLoop(self.plant, self.flown, scenario), flights=STEPS * compile_code)

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
            "S": law.S,
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


def c_flight(case: FlightCase, steps: int = STEPS) -> Callable[[], np.ndarray]:
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
