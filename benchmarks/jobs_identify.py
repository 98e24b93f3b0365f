"""Identification of 11 parameters of a small aircraft from a record of 3,000 samples.

`hfa.identify` is compared with two uses of SciPy's `least_squares` with finite differences: one
with Runge-Kutta steps in plain Python, one with the compiled simulation of `hfa.identify`. All
searches begin with parameters 10 % off. SciPy receives the sensor noise that `hfa.identify`
estimated. The job fails if the estimates differ by more than 1 % of the half-widths of the bands.

SciPy computes estimates alone. `hfa.identify` also computes corrected bands and searches for faults
of the record and for a second minimum.

A second job identifies 33 parameters from four records. Its time is compared with a goal.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from benchmarks.report import Comparison, Limit, Row, in_turn, shortest
from hfa import fly
from hfa_aircraft.readers.derivatives.read import from_derivatives
from hfa_identify.estimation import identify
from hfa_identify.records import record_of
from hfa_identify.response import Record, Responses
from hfa_support.files import read_toml
from trim.point.solve import trim

_UAV = str(Path(__file__).parents[1] / "examples" / "uav.toml")
PARAMETERS = (
    "CL_0", "CL_alpha", "CL_elevator", "CD_0", "CD_CL2", "Cm_0", "Cm_alpha", "Cm_q", "Cm_elevator",
)  # fmt: skip
FREE = (*PARAMETERS, "bias_alpha", "bias_pitch")
#: Measured state -> standard deviation of its sensor noise.
SENSORS = {"speed": 0.3, "alpha": 0.003, "pitch_rate": 0.01, "pitch": 0.003}
#: Time between samples, s.
_STEP = 0.01
#: Step of the peers' finite differences, relative to the unknowns. Biases start away from 0, where
#: such a step would be 0.
_DIFFERENCE = 1e-5
_BIAS = 1e-3
#: Two estimates agree if they differ by less than this fraction of the half-width of the band.
_SAME = 0.01
#: Residual returned if the simulation of a peer diverges.
_DIVERGED = 1e6


class RecordCase:
    """Identification of a small aircraft from a record, as data for `hfa.identify` and for SciPy.

    samples: number of samples of the record
    off: factor on the true parameters at the start of the search
    """

    def __init__(self, samples: int, off: float) -> None:
        true = from_derivatives(_UAV)
        point = trim(true)
        self.time = _STEP * np.arange(samples)
        self.inputs = np.tile(np.array(point.inputs), (samples, 1))
        for name, amplitude, begin, unit in (
            ("elevator", 0.035, 0.5, 0.4),
            ("thrust", 6.0, 8.0, 0.8),
            ("elevator", 0.03, 14.0, 0.6),
        ):
            moves = amplitude * _3211((self.time - begin) / unit)
            self.inputs[:, list(true.inputs).index(name)] += moves
        start = np.array(point.states)
        values = {name: off * true.parameters[name].start for name in PARAMETERS}
        self.model = true.with_parameters(**values)
        self.p = np.array(true.p)
        self.derivatives = {name: each.start for name, each in true.parameters.items()}
        self.rates = true.functions()
        self.start = start
        self.seen = [list(true.states).index(name) for name in SENSORS]
        self.noise = np.array(list(SENSORS.values()))
        states = self._integrated(start)
        noise = np.random.default_rng(1).standard_normal((samples, len(SENSORS)))
        self.measured = states[:, self.seen] + self.noise * noise
        self.columns: dict[str, np.ndarray] = {"time": self.time}
        self.columns |= dict(zip(true.inputs, self.inputs.T, strict=True))
        self.columns |= dict(zip(SENSORS, self.measured.T, strict=True))
        self.begin = np.concatenate([list(values.values()), [_BIAS, _BIAS], self.measured[0]])
        self.found = self.ours()
        self.noise = np.array([each.noise for each in self.found.quantities.values()])

    def _integrated(self, start: np.ndarray) -> np.ndarray:
        """Return the states (N, n) at the times of the record, integrated with SciPy's LSODA."""

        def rates(time: float, x: np.ndarray) -> np.ndarray:
            place = min(int(time / _STEP), len(self.time) - 2)
            part = time / _STEP - place
            u = (1.0 - part) * self.inputs[place] + part * self.inputs[place + 1]
            return np.asarray(self.rates(x, u, self.p)[0].full().ravel())

        ends = (0.0, self.time[-1])
        solved = solve_ivp(
            rates, ends, start, "LSODA", self.time, rtol=1e-6, atol=1e-8, max_step=0.2
        )
        return np.asarray(solved.y.T)

    def unknown(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the initial state (n,) and the parameters θ that a vector of unknowns contains.

        v: parameters θ, then the measured components of the initial state
        """
        start = self.start.copy()
        start[self.seen] = v[len(FREE) :]
        return start, v[: len(FREE)]

    def residuals_in_python(self, v: np.ndarray) -> np.ndarray:
        """Return the residuals of the record, in standard deviations, simulated in plain Python.

        The simulation uses Runge-Kutta steps. If the simulation fails, all residuals are
        `_DIVERGED`.

        v: unknowns, as in `unknown`
        """
        start, theta = self.unknown(v)
        k = self.derivatives | dict(zip(PARAMETERS, theta.tolist(), strict=False))
        try:
            y = _simulated_in_python(start.tolist(), self.inputs.tolist(), k)[:, self.seen]
        except (ValueError, OverflowError):
            return np.full(self.measured.size, _DIVERGED)
        y[:, list(SENSORS).index("alpha")] += theta[-2]
        y[:, list(SENSORS).index("pitch")] += theta[-1]
        return np.asarray(((self.measured - y) / self.noise).ravel())

    def compiled(self) -> Callable[[np.ndarray], np.ndarray]:
        """Return a function v -> residuals of the record that uses `hfa.identify`'s compiled
        simulation.

        If the simulation fails, all residuals are `_DIVERGED`.
        """
        responses, record = self._responses()

        def residuals(v: np.ndarray) -> np.ndarray:
            start, theta = self.unknown(v)
            try:
                y = responses.simulated(record, start, theta).y
            except FloatingPointError:
                return np.full(self.measured.size, _DIVERGED)
            return np.asarray(((self.measured - y) / self.noise).ravel())

        return residuals

    def limit(self) -> Limit:
        """Return the least time of the identification: one simulation with sensitivities for each
        step.

        One further simulation is added for the covariance.
        """
        responses, record = self._responses()
        start, theta = self.unknown(self.begin)
        seconds = shortest(partial(responses.of, record, start, theta))
        count = self.found.steps + 1
        return Limit(count * seconds, f"{count} simulations with sensitivities, one each step")

    def _responses(self) -> tuple[Responses, Record]:
        """Return the compiled simulation of the model with sensitivities, and the record."""
        responses = Responses(self.model, FREE, tuple(SENSORS))
        responses.compile()
        return responses, record_of(self.model, self.columns, {})

    def ours(self) -> Any:
        """Return the result of `hfa.identify` for the record."""
        return identify(self.model, self.columns, FREE)

    def fitted(
        self, residuals: Callable[[np.ndarray], np.ndarray], steps: int | None = None
    ) -> np.ndarray:
        """Return the parameters that SciPy's `least_squares` estimates.

        residuals: function v -> residuals
        steps: largest number of evaluations, None without a limit

        Raises RuntimeError if estimates of a search without limit differ from those of
        `hfa.identify` by more than `_SAME` of the half-width of a band.
        """
        found = least_squares(
            residuals, self.begin, x_scale="jac", diff_step=_DIFFERENCE, max_nfev=steps
        )
        estimates = np.asarray(found.x[: len(FREE)])
        ours = self.found.parameters.values()
        misses = [
            2.0 * abs(value - each.value) / (each.high - each.low)
            for value, each in zip(estimates, ours, strict=True)
        ]
        if steps is None and max(misses) > _SAME:
            raise RuntimeError(f"estimates differ by {max(misses):.2g} of half their bands")
        return estimates


def _simulated_in_python(
    start: list[float], inputs: list[list[float]], k: Mapping[str, float]
) -> np.ndarray:
    """Return the states (N, n) at the samples, simulated with Runge-Kutta steps of order 4."""
    h = _STEP
    x = start
    states = [x]
    for before, after in itertools.pairwise(inputs):
        middle = [0.5 * (one + other) for one, other in zip(before, after, strict=True)]
        k1 = _rates(x, before, k)
        k2 = _rates(_ahead(x, 0.5 * h, k1), middle, k)
        k3 = _rates(_ahead(x, 0.5 * h, k2), middle, k)
        k4 = _rates(_ahead(x, h, k3), after, k)
        for rate, weight in ((k1, h / 6.0), (k2, h / 3.0), (k3, h / 3.0), (k4, h / 6.0)):
            x = _ahead(x, weight, rate)
        states.append(x)
    return np.array(states)


def _ahead(x: Sequence[float], step: float, rates: Sequence[float]) -> list[float]:
    return [value + step * rate for value, rate in zip(x, rates, strict=True)]


def _rates(x: Sequence[float], u: Sequence[float], k: Mapping[str, float]) -> list[float]:
    """Return the time derivatives of the ten states of examples/uav.toml, in plain Python."""
    speed, alpha, beta, p, q, r, roll, pitch, _, altitude = x
    thrust, elevator, aileron, rudder = u
    area, span, chord = 0.55, 2.8956, 0.18994
    pressure = 0.5 * 1.225 * (1.0 - 2.25577e-5 * altitude) ** 4.25588 * speed**2 * area
    ph, qh, rh = (rate * size / (2.0 * speed) for rate, size in ((p, span), (q, chord), (r, span)))
    lift = k["CL_0"] + k["CL_alpha"] * alpha + k["CL_elevator"] * elevator
    drag = k["CD_0"] + k["CD_CL2"] * lift**2
    side = k["CY_beta"] * beta + k["CY_rudder"] * rudder
    Cl = k["Cl_beta"] * beta + k["Cl_p"] * ph + k["Cl_r"] * rh
    Cl += k["Cl_aileron"] * aileron + k["Cl_rudder"] * rudder
    Cm = k["Cm_0"] + k["Cm_alpha"] * alpha + k["Cm_q"] * qh + k["Cm_elevator"] * elevator
    Cn = k["Cn_beta"] * beta + k["Cn_p"] * ph + k["Cn_r"] * rh
    Cn += k["Cn_aileron"] * aileron + k["Cn_rudder"] * rudder
    sin, cos = math.sin, math.cos
    sa, ca, sb, cb = sin(alpha), cos(alpha), sin(beta), cos(beta)
    sr, cr, sp, cp = sin(roll), cos(roll), sin(pitch), cos(pitch)
    g, mass = k["gravity"], k["mass"]
    ax = (pressure * (lift * sa - drag * ca) + thrust) / mass - g * sp
    ay = pressure * side / mass + g * cp * sr
    az = -pressure * (lift * ca + drag * sa) / mass + g * cp * cr
    along = ax * ca + az * sa
    Ixx, Iyy, Izz, Ixz = k["Ixx"], k["Iyy"], k["Izz"], k["Ixz"]
    L = pressure * span * Cl - q * r * (Izz - Iyy) + Ixz * p * q
    M = pressure * chord * Cm - p * r * (Ixx - Izz) - Ixz * (p**2 - r**2)
    N = pressure * span * Cn - p * q * (Iyy - Ixx) - Ixz * q * r
    both = Ixx * Izz - Ixz**2
    turn = q * sr + r * cr
    climb = ca * cb * sp - sb * sr * cp - sa * cb * cr * cp
    return [
        along * cb + ay * sb,
        q - (p * ca + r * sa) * sb / cb + (az * ca - ax * sa) / (speed * cb),
        p * sa - r * ca + (ay * cb - along * sb) / speed,
        (Izz * L + Ixz * N) / both,
        M / Iyy,
        (Ixz * L + Ixx * N) / both,
        p + turn * sp / cp,
        q * cr - r * sr,
        turn / cp,
        speed * climb,
    ]


def _3211(units: np.ndarray) -> np.ndarray:
    """Return a 3-2-1-1 input of amplitude 1: 1, -1, 1, -1 for 3, 2, 1 and 1 units of time."""
    place = np.searchsorted([0.0, 3.0, 5.0, 6.0, 7.0], units, side="right")
    return np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])[place]


def _record(quick: bool) -> list[Row]:
    """Return comparisons of the identification of 11 parameters, one for each use of SciPy."""
    case = RecordCase(1600 if quick else 3000, 1.1)
    job = f"{len(FREE)} unknowns from a record of {len(case.time)} samples"
    rows = []
    for peer, residuals, repeats, target in (
        ("SciPy's least_squares, simulation in plain Python", case.residuals_in_python, 1, 10.0),
        ("least_squares with the same compiled simulation", case.compiled(), 2, 0.5),
    ):
        steps = 1 if quick else None
        timing = in_turn(case.ours, partial(case.fitted, residuals, steps), repeats=repeats)
        rows.append(Row(job, peer, timing, target, limit=case.limit()))
    return rows


#: Derivatives added to examples/uav.toml, so that it has 33 coefficients.
_FLAP = {"flap": ["-5 deg", "25 deg"], "CL_flap": 0.8, "CD_flap": 0.06, "Cm_flap": -0.1}
_MORE = {
    "CL_q": 6.0, "CD_elevator": 0.03, "CY_0": 0.01, "CY_p": 0.1, "CY_r": 0.3, "CY_aileron": 0.075,
    "Cl_0": 0.001, "Cn_0": -0.001, "Cm_beta": 0.02,
}  # fmt: skip
#: Inputs and amplitudes of the 3-2-1-1 maneuvers in each record.
_MANOEUVRES = (
    (("elevator", 0.035), ("thrust", 8.0)),
    (("aileron", 0.1), ("rudder", 0.12)),
    (("flap", 0.06), ("elevator", 0.03)),
    (("rudder", 0.12), ("aileron", 0.1)),
)
_LATERAL = {"beta": 0.003, "roll_rate": 0.01, "yaw_rate": 0.01, "roll": 0.003}
_GOAL = 20.0


def _large(quick: bool) -> list[Row]:
    """Return the comparison of the time to identify 33 coefficients from four records."""
    table = read_toml(_UAV)
    true = from_derivatives(table | {"more": _FLAP | _MORE})
    free = [name for name in true.parameters if name.startswith("C")]
    point = trim(true)
    random = np.random.default_rng(1)
    records = []
    every = 40 if quick else 20
    for inputs in _MANOEUVRES:
        moves = {}
        for (name, size), begin in zip(inputs, (0.5, 10.0), strict=True):
            ends = (begin + 0.5 * np.array([0.0, 3.0, 5.0, 6.0, 7.0])).tolist()
            moves[name] = list(zip(ends, (size, -size, size, -size, 0.0), strict=True))
        flight = fly(true, point, moves, seconds=20.0)
        columns = {"time": flight.time[::every]}
        columns |= dict(zip(true.inputs, flight.inputs[::every].T, strict=True))
        for name, size in (SENSORS | _LATERAL).items():
            states = flight.states[::every, list(true.states).index(name)]
            columns[name] = states + size * random.standard_normal(len(states))
        records.append(columns)
    off = random.choice([0.5, 1.5], len(free)).tolist()
    values = {name: by * true.parameters[name].start for name, by in zip(free, off, strict=True)}
    begun = time.perf_counter()
    found = identify(true.with_parameters(**values), records, free, inputs="steps")
    seconds = time.perf_counter() - begun
    assert found.converged
    assert not found.unexplained
    timing = Comparison(seconds, _GOAL, _GOAL / seconds)
    job = f"{len(free)} unknowns from {len(records)} records of {len(columns['time'])} samples"
    return [Row(job, f"a goal of {_GOAL:g} s", timing, 1.0)]


JOBS = {"record": _record, "records": _large}
