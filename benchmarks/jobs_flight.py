"""Simulation of a learning critic in closed loop: 20 s with a step of 1e-4 s.

The project's loop is compared with the same loop written in C. A Monte Carlo run of this simulation
is also timed.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import hfa
from benchmarks.report import FOLDER, Limit, Row, in_turn
from controller.game.basis import basis
from controller.hfa_files import published_game
from controller.learning.recording import natural_spread
from controller.riccati.gare import unconfirmed_solution
from hfa_aircraft.limits import Limits
from hfa_aircraft.waveform import Harmonic, Waveform, zero
from hfa_flight.closed_loop import ClosedLoop, LinearPlant
from hfa_flight.samples.monte_carlo import MonteCarlo, fly_member
from hfa_flight.samples.store import stream_members
from hfa_flight.scenario import Scenario, Uncertainty
from hfa_flight.simulation import CompiledLoop
from hfa_model.published import published_models
from hfa_model.vectors import STATES
from hfa_support.native.machine_code import c_compiler
from studies.section5.critic_policy import CriticPolicy
from studies.section5.laws.published import PublishedSettings, published_law
from trim.hfa.level_flight import level_flight
from trim.point.solve import trim

STEP = 1e-4
STEPS = 200_000
#: Required efficiency of a Monte Carlo run: speedup divided by the number of cores.
_EFFICIENCY = 0.85


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest relative difference of two histories of the same simulation.

    The difference of a state is relative to the state's largest magnitude in `other`. The
    difference of a weight is relative to the largest magnitude of all weights. The power 1 - eta in
    Eq. (46) has an infinite slope where a residual is 0. A rounding error of 1e-16 there becomes
    1e-16 to the power 1 - eta.

    one, other: (N, states and weights)
    """
    largest = np.abs(other).max(axis=0)
    largest[6:] = largest[6:].max()
    return float((np.abs(one - other).max(axis=0) / largest).max())


class FlightCase:
    """Simulation of the closed loop of paper Section 5.1 at 5 degrees of dihedral, while a critic
    learns.

    The settings of the learning law keep the weights bounded.
    """

    def __init__(self) -> None:
        model = next(model for model in published_models() if model.dihedral_deg == 5.0)
        game = published_game(model.A, model.B)
        # Stabilizing initial weights: the LQR value, in the paper's basis.
        start = tuple(
            basis("paper", 6).weights(unconfirmed_solution(game.with_delta(np.inf)).P).tolist()
        )
        settings = PublishedSettings(
            samples=50,
            box=tuple(natural_spread(game).tolist()),
            coordinates="scaled",
            normalisation="root",
            gains=(100.0, 100.0),
            initial_weights=start,
            recorded_weights=start,
        )
        self.law = published_law(game, settings, seed=0)
        nothing = np.zeros(6)
        swing = Harmonic(0.5, np.array([2.0, 0, 0, 0, 0, 0]), nothing)
        wave = Harmonic(
            0.1, 1.1 * np.array([0.1, 0.2, 0, 0.1, 0, 0.1]), 1.1 * np.array([0, 0, 0.2, 0, 0.1, 0])
        )
        self.reference = Waveform(
            np.array([7.0, 0.1, 0, 0, 0.5, 0]), np.array([0.01, 0, 0, 0, 0, 0]), (swing,)
        )
        self.disturbance = Waveform(nothing, nothing, (wave,))
        self.plant = LinearPlant(game.A, game.B)
        weights = self.law.start()["weights"]
        learning = np.ones((1, 1))
        self.flown = CriticPolicy("published", self.law, zero(6), held=learning, start=weights)
        self.start = np.concatenate([[5.0, 0.05, 0, 0, 0, 0], self.flown.start])
        self.compiled = lru_cache(self._compiled)

    def fly(self, compile_code: bool, steps: int = STEPS) -> np.ndarray:
        """Return the states and weights of the project's simulation, (steps + 1, states and
        weights).

        compile_code: whether machine code is used
        steps: number of steps
        """
        flight = self.compiled(compile_code, steps).fly()
        return np.hstack([flight.states, flight.memory])

    def _compiled(self, compile_code: bool, steps: int) -> CompiledLoop:
        tick = STEP * min(steps, 1000)
        scenario = Scenario(
            steps * STEP, STEP, tick, self.start[:6], self.reference, self.disturbance
        )
        return CompiledLoop(
            ClosedLoop(self.plant, self.flown, scenario), flights=STEPS * compile_code
        )

    def data(self) -> dict[str, Any]:
        """Return the data of the simulation for the C program, name -> array or number.

        The order is that of the fields of the C struct.
        """
        law = self.law
        game = self.law.game
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
            "reference": np.array(
                [self.reference.constant, self.reference.slope, self.reference.harmonics[0].sine]
            ),
            "disturbance": np.array([wave.sine, wave.cosine]),
            "gamma": law.settings.gamma,
            "alpha1": law.gains[0],
            "alpha2": law.gains[1],
            "eta": law.settings.eta,
        }


def c_flight(case: FlightCase, steps: int = STEPS) -> Callable[[], np.ndarray]:
    """Return a function that runs the simulation with the hand-written C program.

    The function returns the states and weights at all steps, (steps + 1, states and weights).
    """
    compiler = c_compiler()
    assert compiler is not None
    folder = tempfile.mkdtemp()
    library = Path(folder) / "flight_loop.so"
    source = FOLDER / "flight_loop.c"
    subprocess.run(
        [compiler, "-O3", "-fPIC", "-shared", str(source), "-o", str(library), "-lm"],
        check=True,
    )
    code = ctypes.CDLL(str(library))
    pointer = ctypes.POINTER(ctypes.c_double)
    arrays = {name: np.ascontiguousarray(value, dtype=float) for name, value in case.data().items()}
    kinds = {name: pointer if value.size > 1 else ctypes.c_double for name, value in arrays.items()}
    Loop = type("Loop", (ctypes.Structure,), {"_fields_": list(kinds.items())})
    loop = Loop(
        *(
            each.ctypes.data_as(pointer) if each.size > 1 else each.item()
            for each in arrays.values()
        )
    )

    def fly() -> np.ndarray:
        history = np.empty((steps + 1, len(case.start)))
        history[0] = case.start
        code.flight(
            ctypes.byref(loop),
            ctypes.c_double(STEP),
            ctypes.c_long(steps),
            history.ctypes.data_as(pointer),
        )
        return history

    fly.keep = arrays  # type: ignore[attr-defined]
    return fly


def _loop(quick: bool) -> list[Row]:
    """Return the comparison of the project's simulation with hand-written C."""
    if c_compiler() is None:
        return []
    case = FlightCase()
    steps = 2000 if quick else STEPS
    by_hand = c_flight(case, steps)
    timing = in_turn(lambda: case.fly(True, steps), by_hand, repeats=3)
    remark = (
        "largest relative difference of the two histories"
        f" {difference(case.fly(True, steps), by_hand()):.1e}"
    )
    return [
        Row(
            "20 s of flight, critic learning, generated C",
            "C by hand, -O3",
            timing,
            0.85,
            remark,
            limit=Limit(timing.peer, "C by hand"),
        )
    ]


def critic_plan(members: int, duration: float) -> MonteCarlo:
    """Return a Monte Carlo run of the simulation of `FlightCase`, with uncertain parameters.

    The critic has 25 weights and 50 samples. The aircraft has seven states. The limits of the
    states are so wide that every simulation runs to the end.

    members: number of simulations
    duration: s
    """
    case = FlightCase()
    aircraft = hfa.aircraft()
    point = trim(aircraft, level_flight(float(np.radians(5.0))))
    initial = np.array([*case.start[:6], 0.0])
    signals = (case.reference, case.disturbance)
    uncertain = Uncertainty(
        errors={"panel_mass": 0.02, "lift_slope": 0.02, "hinge_damping": 0.05},
        noise={"alpha": 0.001, "pitch_rate": 0.001},
        turbulence=hfa.Turbulence((1.0, 1750.0)),
    )
    scenario = Scenario(duration, STEP, 0.01, initial, *signals, uncertainty=uncertain)
    everywhere = Limits.of(aircraft, STATES, dict.fromkeys(STATES, (-1e9, 1e9)))
    return MonteCarlo(members, 0, aircraft, point, case.flown, scenario, everywhere)


def _members(quick: bool) -> list[Row]:
    """Return the comparison of a Monte Carlo run on several processes with one in sequence."""
    cores = os.cpu_count() or 1
    workers = max(2, cores)
    members, alone, duration = (4, 1, 0.05) if quick else (10 * workers, 4, 20.0)
    plan = critic_plan(members, duration)

    def stored() -> None:
        with tempfile.TemporaryDirectory() as folder:
            dataset = stream_members(plan, Path(folder) / "members.zarr", workers=workers)
            assert (dataset.flown == duration).all(), "a member left: its flight was shorter"

    def one_by_one() -> None:
        for member in range(alone):
            fly_member(plan, member)

    timing = in_turn(stored, one_by_one, units=members, peer_units=alone, repeats=1)
    job = (
        f"Monte Carlo of that flight (errors, noise, turbulence) on {workers} processes, per member"
    )
    remark = f"{members} members a run with the start of the processes"
    limit = Limit(timing.peer / cores, "a member on each core")
    target = _EFFICIENCY * cores
    return [Row(job, "the members one by one", timing, target, remark, limit=limit)]


JOBS = {"loop": _loop, "members": _members}
