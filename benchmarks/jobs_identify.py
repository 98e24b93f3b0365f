"""11 unknowns of a small aircraft from a record of 3,000 samples: `hfa.identify` against SciPy's
`least_squares` with its own differences, on the same equations, from parameters 10 % off.

The first peer simulates by SciPy's `solve_ivp`, the second by the compiled simulation of
`hfa.identify`. Both know the noise of the sensors and compute the estimates alone; `hfa.identify`
also computes corrected bands, and looks for faults of the record and for a second minimum."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from benchmarks.report import Limit, Row, in_turn, shortest
from hfa_derivatives.aircraft import from_derivatives
from hfa_identify.estimation import identify
from hfa_identify.records import record_of
from hfa_identify.response import Record, Responses
from trim.point.solve import find_operating_point

_UAV = str(Path(__file__).parents[1] / "examples" / "uav.toml")
PARAMETERS = (
    "CL_0", "CL_alpha", "CL_elevator", "CD_0", "CD_CL2", "Cm_0", "Cm_alpha", "Cm_q", "Cm_elevator",
)  # fmt: skip
FREE = (*PARAMETERS, "bias_alpha", "bias_pitch")
#: Measured state -> standard deviation of its sensor's noise.
SENSORS = {"speed": 0.3, "alpha": 0.003, "pitch_rate": 0.01, "pitch": 0.003}
#: Time between samples, s.
_STEP = 0.01
#: Differences of the peers are these parts of the unknowns, large against errors of integration.
#: Biases begin away from 0, where such a part is 0.
_DIFFERENCE = 1e-3
_BIAS = 1e-3
#: A peer is given up where its simulation diverges.
_DIVERGED = 1e6


class RecordCase:
    """A record of a small aircraft, and the residuals of its least squares.

    samples: of the record.
    off: factor of the parameters at the start of the search.
    """

    def __init__(self, samples: int, off: float) -> None:
        true = from_derivatives(_UAV)
        point = find_operating_point(true)
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
        self.places = [list(true.parameters).index(name) for name in PARAMETERS]
        self.rates = true.functions()
        self.start = start
        self.seen = [list(true.states).index(name) for name in SENSORS]
        self.noise = np.array(list(SENSORS.values()))
        states = self._integrated(start, self.p)
        noise = np.random.default_rng(1).standard_normal((samples, len(SENSORS)))
        self.measured = states[:, self.seen] + self.noise * noise
        self.columns: dict[str, np.ndarray] = {"time": self.time}
        self.columns |= dict(zip(true.inputs, self.inputs.T, strict=True))
        self.columns |= dict(zip(SENSORS, self.measured.T, strict=True))
        self.begin = np.concatenate([list(values.values()), [_BIAS, _BIAS], self.measured[0]])

    def _integrated(self, start: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(N, n) states by SciPy."""

        def rates(time: float, x: np.ndarray) -> np.ndarray:
            place = min(int(time / _STEP), len(self.time) - 2)
            part = time / _STEP - place
            u = (1.0 - part) * self.inputs[place] + part * self.inputs[place + 1]
            return np.asarray(self.rates(x, u, p)[0].full().ravel())

        ends = (0.0, self.time[-1])
        solved = solve_ivp(
            rates, ends, start, "LSODA", self.time, rtol=1e-6, atol=1e-8, max_step=0.2
        )
        return np.asarray(solved.y.T)

    def unknown(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Start (n,) and unknowns θ of those of the least squares."""
        start = self.start.copy()
        start[self.seen] = v[len(FREE) :]
        return start, v[: len(FREE)]

    def by_scipy(self, v: np.ndarray) -> np.ndarray:
        """Residuals of a simulation by SciPy."""
        start, theta = self.unknown(v)
        p = self.p.copy()
        p[self.places] = theta[: len(PARAMETERS)]
        states = self._integrated(start, p)
        if len(states) < len(self.time):
            return np.full(self.measured.size, _DIVERGED)
        y = states[:, self.seen]
        y[:, list(SENSORS).index("alpha")] += theta[-2]
        y[:, list(SENSORS).index("pitch")] += theta[-1]
        return np.asarray(((self.measured - y) / self.noise).ravel())

    def compiled(self) -> Callable[[np.ndarray], np.ndarray]:
        """Residuals of the compiled simulation of `hfa.identify`."""
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
        """The time of the response with its sensitivities, once for a step and once for the
        covariance."""
        responses, record = self._responses()
        start, theta = self.unknown(self.begin)
        seconds = shortest(partial(responses.of, record, start, theta))
        return Limit(2.0 * seconds, "two simulations with sensitivities")

    def _responses(self) -> tuple[Responses, Record]:
        """The compiled responses of the model, and the record."""
        responses = Responses(self.model, FREE, tuple(SENSORS))
        responses.compile()
        return responses, record_of(self.model, self.columns, {})

    def ours(self) -> Any:
        """The result of `hfa.identify`."""
        return identify(self.model, self.columns, FREE)

    def fitted(
        self, residuals: Callable[[np.ndarray], np.ndarray], steps: int | None = None
    ) -> np.ndarray:
        """The estimates by SciPy's least squares. steps: the most that are made."""
        found = least_squares(
            residuals, self.begin, x_scale="jac", diff_step=_DIFFERENCE, max_nfev=steps
        )
        return np.asarray(found.x[: len(FREE)])


def _3211(units: np.ndarray) -> np.ndarray:
    """Steps of alternating sign that last 3, 2, 1 and 1 units."""
    place = np.searchsorted([0.0, 3.0, 5.0, 6.0, 7.0], units, side="right")
    return np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])[place]


def _record(quick: bool) -> list[Row]:
    """A record of 3,000 samples."""
    case = RecordCase(1600 if quick else 3000, 1.1)
    job = f"{len(FREE)} unknowns from a record of {len(case.time)} samples"
    rows = []
    for peer, residuals, repeats, target in (
        ("least_squares and solve_ivp of SciPy", case.by_scipy, 1, 10.0),
        ("least_squares with the same compiled simulation", case.compiled(), 2, 0.5),
    ):
        steps = 1 if quick else None
        timing = in_turn(case.ours, partial(case.fitted, residuals, steps), repeats=repeats)
        rows.append(Row(job, peer, timing, target, limit=case.limit()))
    return rows


JOBS = {"record": _record}
