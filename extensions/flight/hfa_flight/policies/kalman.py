"""Stationary Kalman filter of a linear model in turbulence, with sensor noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import casadi as ca
import numpy as np

from hfa_aircraft.servos import positions_of_servos
from hfa_flight.air.gust_equations import in_gusts, seen_in_air
from hfa_flight.air.gusts import state_of
from hfa_flight.air.sensors import (
    Sensor,
    at_trim,
    measurable,
    measured,
    sensors_of,
)
from hfa_flight.air.turbulence import (
    AirFilter,
    Turbulence,
    level_text,
    turbulence_of,
)
from hfa_support.errors import (
    BadInputError,
    NoSolutionError,
    refuse_unless_positive,
)
from hfa_support.matrices import of_step, spectral_radius
from hfa_support.reporting.results import Result, without_empty
from hfa_support.reporting.text import with_unit
from trim.linear.delays import zero_order_hold
from trim.linear.linear_model import LinearModel
from trim.linear.modes import modes_of
from trim.linear.nonsmooth import linearization_at
from trim.point.operating_point import OperatingPoint

#: Drift of a state in one second, as a share of its sensor noise.
DRIFT = 0.1
#: Noise from which the drift of a state without a sensor follows, as a share of its nominal value.
_NOISE_WITHOUT_SENSOR = 0.01
#: Smallest singular value of [A - s I; C] of an observable mode, relative to that of A.
_LEAST_OBSERVABILITY = 1e-7
#: Largest relative residual of the Riccati equation.
_LARGEST_RESIDUAL = 1e-8


@dataclass(frozen=True, eq=False)
class KalmanFilter(Result):
    """Stationary filter x⁺ = Φ x̂ + Γ u, x̂ = x + L (y - C x) of the deviations from a trim.

    x are the n states: the k linear states, those of the turbulence filter, and the biases of the
    sensors that have one. C has the slopes at the trim of what is measured, h(x).

    point: the trim.
    dt: sample time, s.
    sensors: what is measured, a linear state or an output -> errors of its sensor.
    drift: linear state -> standard deviation of its unmodeled drift in one second.
    turbulence: turbulence that the filter assumes, or None for still air.
    A, B: model in continuous time, x' = A x + B u, (n, n), (n, m).
    Phi, Gamma, C: model of a sample, (n, n), (n, m), (p, n).
    Q, R: covariance of the disturbances in a sample, and of the noise.
    air: part of Q that is due to turbulence. It has only states of the air: winds are constant in a
        sample. The change of the winds within a sample is left out, because its effect on the
        aircraft depends on the states: with that at the trim, a fast gain leaves its limits in
        severe turbulence.
    climate: stationary covariance of the states of the air and of the biases, (n - k, n - k).
    P: covariance of the error of the predicted states x.
    L: gain, (n, p).
    residual: residual of the Riccati equation of P, relative to P, in balanced units.
    winds: names of the model's disturbances w = W x_air that the turbulence sets.
    W: (w, n - k).
    """

    point: OperatingPoint
    dt: float
    sensors: Mapping[str, Sensor]
    drift: Mapping[str, float]
    turbulence: Turbulence | None
    A: np.ndarray
    B: np.ndarray
    Phi: np.ndarray
    Gamma: np.ndarray
    C: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    air: np.ndarray
    climate: np.ndarray
    P: np.ndarray
    L: np.ndarray
    residual: float
    winds: tuple[str, ...]
    W: np.ndarray

    @classmethod
    def of(
        cls,
        linear: LinearModel,
        noise: Mapping[str, float | Sensor],
        turbulence: Turbulence | str | None,
        dt: float,
    ) -> Self:
        """Return the filter of an aircraft near a trim. The arguments are those of `hfa.filter`."""
        point = linear.point
        if tuple(linear.states) != tuple(point.model.linear):
            raise BadInputError(
                f"the linear model has the states {', '.join(linear.states)}; give the linear "
                f"model of all linear states ({', '.join(point.model.linear)})"
            )
        if not noise:
            raise BadInputError(
                "a filter requires the noise of its sensors; give that of at least one, "
                "--noise NAME=VALUE (in Python noise={NAME: VALUE})"
            )
        refuse_unless_positive("dt", dt, " s")
        sensors = sensors_of(noise, point.model)
        for name, sensor in sensors.items():
            refuse_unless_positive(f"the noise of {name}", sensor.noise)
        if isinstance(turbulence, str):
            turbulence = turbulence_of(turbulence)
        in_order = {name: sensors[name] for name in measurable(point.model) if name in sensors}
        return cls._solved(linear, dt, in_order, turbulence)

    @classmethod
    def _solved(
        cls,
        linear: LinearModel,
        dt: float,
        sensors: Mapping[str, Sensor],
        turbulence: Turbulence | None,
    ) -> Self:
        """Return the filter. It is computed in units of the states, and of the noise."""
        point, (k, m) = linear.point, linear.B.shape
        air = _with_biases(_air(point, turbulence, dt), sensors)
        of_linear, of_air = slice(None, k), slice(k, None)  # the states of air and biases
        A, noise = _in_air(linear, air)
        B = np.vstack([linear.B, np.zeros((len(air.A), m))])
        x = ca.SX.sym("x", len(A))
        y = _sensed(point, sensors, air, x)
        C = ca.Function("slopes", [x], [ca.densify(ca.jacobian(y, x))])(0.0).full()

        sigma = np.array([sensor.noise for sensor in sensors.values()])
        sizes = _sizes(point, sensors)
        drift = {name: DRIFT * size for name, size in sizes.items()}
        scale = np.append([*sizes.values()], np.sqrt(np.diag(air.covariance)))
        units, drifts = np.outer(scale, scale), np.append([*drift.values()], np.zeros(len(air.A)))
        A_in_units, C_in_units = A * scale / scale[:, None], C * scale / sigma[:, None]
        _refuse_unobservable(
            A_in_units[of_linear, of_linear],
            C_in_units[:, of_linear],
            tuple(drift),
            tuple(sensors),
        )

        # Covariance that drift and turbulence add in a sample.
        Phi_in_units, of_drift = of_step(A_in_units, np.diag((drifts / scale) ** 2), dt)
        by_air = np.zeros_like(A)
        if len(A) > k:
            block = of_air, of_air
            _, by_air[block] = of_step(A_in_units[block], (noise / units)[block], dt)
        Q = by_air + of_drift
        Q = 0.5 * (Q + Q.T)
        P, L, residual = _stationary(Phi_in_units, C_in_units, Q)

        Phi, Gamma = zero_order_hold(A, B, dt)
        return cls(
            point=point,
            dt=dt,
            sensors=sensors,
            drift=drift,
            turbulence=turbulence,
            A=A,
            B=B,
            Phi=Phi,
            Gamma=Gamma,
            C=C,
            Q=Q * units,
            R=np.diag(sigma**2),
            air=by_air * units,
            climate=air.covariance,
            P=P * units,
            L=L * scale[:, None] / sigma,
            residual=residual,
            winds=air.winds,
            W=air.W,
        )

    @property
    def biased(self) -> dict[str, float]:
        """Sensor -> size of its bias, of the biases that are the last states."""
        return {name: sensor.bias for name, sensor in self.sensors.items() if sensor.bias}

    def sensed(self, x: ca.SX) -> ca.SX:
        """Return the measured values at the states of the filter, (p,), as deviations from trim."""
        return _sensed(self.point, self.sensors, self, x)

    @property
    def intermittent(self) -> list[str]:
        """Sensors without a value in some samples, which the stationary filter does not know."""
        return [name for name, sensor in self.sensors.items() if sensor.every > self.dt]

    @cached_property
    def at_trim(self) -> np.ndarray:
        """Measured values at the trim, (p,)."""
        return at_trim(self.point, tuple(self.sensors))

    @cached_property
    def P_at_begin(self) -> np.ndarray:
        """Covariance at the first sample: that of the stationary filter, but of unknown biases."""
        P, first = self.P.copy(), len(self.P) - len(self.biased)
        P[first:] = P[:, first:] = 0.0
        P[first:, first:] = np.diag(np.square([*self.biased.values()]))
        return P

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the k linear states."""
        return tuple(self.drift)

    @cached_property
    def radius(self) -> float:
        """Spectral radius of the errors' dynamics Φ (I - L C)."""
        errors = self.Phi @ (np.eye(len(self.Phi)) - self.L @ self.C)
        return spectral_radius(errors)

    @property
    def estimated(self) -> dict[str, float]:
        """State -> standard deviation of the error of its estimate x̂."""
        P = self.P - self.L @ self.C @ self.P  # covariance of the error of x̂
        # The linear states come first; the states of the air are left out.
        return dict(zip(self.states, np.sqrt(np.diag(P)).tolist(), strict=False))

    def winds_at(self, x: ca.SX) -> ca.SX:
        """Return the winds of some states (n,), (w,)."""
        return ca.mtimes(ca.DM(self.W), x[len(self.states) :])

    def seen(self, x: ca.SX) -> ca.SX:
        """Return the deviations of the linear states, (k,), that a policy sees at the states x of
        the filter, (n,): flow angles relative to the air, and the speed along the path of the trim,
        relative to the air too where no sensor measures the speed over the ground.
        """
        if not self.winds:
            return x[: len(self.states)]
        trim = self.point.states._asdict()
        deviations = dict(zip(self.states, ca.vertsplit(x[: len(self.states)]), strict=True))
        over_ground = {name: trim[name] + deviations.get(name, 0.0) for name in trim}
        winds = dict(zip(self.winds, ca.vertsplit(self.winds_at(x)), strict=True))
        ground = {state_of(self.point.model, "speed"), "ground_speed"} & set(self.sensors)
        in_air = seen_in_air(
            self.point.model, over_ground, trim, winds, is_over_ground=bool(ground)
        )
        deviations |= {name: in_air[name] - trim[name] for name in in_air if name in deviations}
        return ca.vertcat(*deviations.values())

    @cached_property
    def sight(self) -> np.ndarray:
        """Derivatives of `seen` by x at the trim, (k, n)."""
        x = ca.SX.sym("x", len(self.Phi))
        slopes = ca.Function("sight", [x], [ca.densify(ca.jacobian(self.seen(x), x))])
        return np.asarray(slopes(0.0))

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "dt": self.dt,
            "noise": {name: sensor.noise for name, sensor in self.sensors.items()},
            **without_empty(bias=self.biased),
            "drift": dict(self.drift),
            "turbulence": None if self.turbulence is None else self.turbulence.text,
            "L": self.L,
            "residual": self.residual,
            "spectral_radius": self.radius,
            "estimation_error": self.estimated,
        }

    def text(self) -> str:
        """Return one line on the filter: its sensors, its air and its certificate."""
        units = self.point.model.states
        servos = positions_of_servos(self.point.model)
        missing = [
            f"{name} (error {with_unit(self.estimated[name], units[name].unit)})"
            for name in self.states
            if name not in (*self.sensors, *servos)
        ]
        outputs = [name for name in self.sensors if name not in self.states]
        without = f", without a sensor of {', '.join(missing)}" if missing else ""
        beside = f", with sensors of {', '.join(outputs)}" if outputs else ""
        air = "still air" if self.turbulence is None else level_text(self.turbulence)
        drift = f"drift {DRIFT:g} of the noise a second"
        drift += ", as if each sample had all values" * bool(self.intermittent)
        return (
            f"Kalman filter for {air}, one sample every {1e3 * self.dt:g} ms{without}{beside}: "
            f"spectral radius {near_one(self.radius)}, Riccati residual {self.residual:.1e}, "
            f"{drift}"
        )

    def text_of_biases(self) -> str:
        """Return the deviations of the biases at the beginning and after a minute, or ""."""
        if not self.biased:
            return ""
        P, R = self.P_at_begin, np.diag(self.R)
        samples = [max(1, round(sensor.every / self.dt)) for sensor in self.sensors.values()]
        for sample in range(round(60.0 / self.dt)):
            given = sample % np.array(samples) == 0
            C = self.C[given]
            gain = np.linalg.solve(C @ P @ C.T + np.diag(R[given]), C @ P).T
            P = self.Phi @ (P - gain @ C @ P) @ self.Phi.T + self.Q
        after = np.sqrt(np.diag(P)[len(P) - len(self.biased) :]).tolist()
        unit = in_gusts(self.point.model).unit
        told = [
            f"{name} {with_unit(size, unit(name))} to {with_unit(left, unit(name))}"
            for (name, size), left in zip(self.biased.items(), after, strict=True)
        ]
        return f"Deviations of the biases, unknown and after 60 s: {', '.join(told)}."


def near_one(radius: float) -> str:
    """Return a spectral radius with as many digits as tell it from 1."""
    digits = max(5, 1 - math.floor(math.log10(abs(radius - 1.0) or 1.0)))
    return f"{radius:.{digits}f}" if digits < 17 else f"{radius!r}"


def _sizes(point: OperatingPoint, sensors: Mapping[str, Sensor]) -> dict[str, float]:
    """Return linear state -> noise of its sensor, or without one a part of its nominal value."""
    states = point.model.states
    return {
        name: sensors[name].noise
        if name in sensors
        else _NOISE_WITHOUT_SENSOR * states[name].nominal
        for name in point.model.linear
    }


def _sensed(
    point: OperatingPoint, sensors: Mapping[str, Sensor], air: _Air | KalmanFilter, x: ca.SX
) -> ca.SX:
    """Return the measured values, (p,), at states x of a filter, as deviations from the trim.

    air: what has the winds
    """
    model, linear = point.model, point.model.linear
    X = ca.SX.zeros(len(point.x))
    X[model.state_places(linear)] = x[: len(linear)]
    # Symbols, on which no measured value may depend: the filter does not know what acts.
    U = ca.SX.sym("U", len(model.inputs))
    winds = ca.vertsplit(ca.mtimes(ca.DM(air.W), x[len(linear) :]))
    by_name = dict(zip(air.winds, winds, strict=True))
    y = measured(point, tuple(sensors), X, U, model.p, by_name)
    values = dict(zip(sensors, ca.vertsplit(y), strict=True))
    for name, value in values.items():
        if ca.depends_on(value, U):
            raise BadInputError(
                f"the sensor of {name} depends on the inputs; add --servo, whose positions are "
                "states"
            )
    biased = [name for name, sensor in sensors.items() if sensor.bias]
    for name, bias in zip(biased, ca.vertsplit(x)[x.numel() - len(biased) :], strict=True):
        values[name] += bias
    return ca.vertcat(*values.values())


def _stationary(
    Phi: np.ndarray, C: np.ndarray, Q: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return P, L and the relative residual of the filter of x⁺ = Φ x + (noise of covariance Q),
    y = C x + (noise of covariance I).

      P = Φ (P - L C P) Φ' + Q,  L = P C' (C P C' + I)⁻¹

    Raises NoSolutionError if the Riccati equation has no solution, or not to _LARGEST_RESIDUAL.
    """
    from scipy.linalg import solve_discrete_are

    try:
        P = solve_discrete_are(Phi.T, C.T, Q, np.eye(len(C)))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError(
            f"the Riccati equation of the filter has no solution: {error}"
        ) from error
    P = 0.5 * (P + P.T)
    L = np.linalg.solve(C @ P @ C.T + np.eye(len(C)), C @ P).T
    difference = Phi @ (P - L @ C @ P) @ Phi.T + Q - P
    residual = float(np.abs(difference).max() / np.abs(P).max())
    if not residual <= _LARGEST_RESIDUAL:
        raise NoSolutionError(
            f"the Riccati equation of the filter is solved only to {residual:.1e}; leave out "
            "states that no sensor observes"
        )
    return P, L, residual


class _Air(NamedTuple):
    """Turbulence as winds w = W x_air of a filter x_air' = A x_air + G ν.

    `noise` is G G', and `covariance` that of the stationary x_air.
    """

    A: np.ndarray
    noise: np.ndarray
    covariance: np.ndarray
    winds: tuple[str, ...]
    W: np.ndarray
    E: np.ndarray  # derivatives of the rates of the linear states by x_air, (k, len(A))


def _air(point: OperatingPoint, turbulence: Turbulence | None, dt: float) -> _Air:
    """Return the turbulence at a trim, in the states of its filter that reach the winds."""
    model = point.model
    if turbulence is None:
        none = np.zeros((0, 0))  # no states and no winds
        return _Air(none, none, none, (), none, np.zeros((len(model.linear), 0)))
    air = turbulence.air(point, dt, count=1, seed=0)  # no sample of it is needed
    full = AirFilter.of(air)
    # Winds of the model by the states of the filter, whose outputs are the components of the gust.
    winds_of_states = air.factors.T @ full.C
    reaching = _reaching(full.A, winds_of_states)
    block = np.ix_(reaching, reaching)
    W = winds_of_states[:, reaching]
    # Derivatives of the rates by the winds, and so by the states of the air.
    slopes, _ = linearization_at(
        in_gusts(model), point.states, point.inputs, disturbances=air.names
    )
    E = slopes.E[model.state_places(model.linear)] @ W
    return _Air(full.A[block], full.noise[block], full.covariance[block], air.names, W, E)


#: Time constant of a bias, s.
_BIAS_TIME = 3600.0


def _with_biases(air: _Air, sensors: Mapping[str, Sensor]) -> _Air:
    """Return the air with a first-order process for each bias of a sensor, which no wind has."""
    from scipy.linalg import block_diag

    sizes = np.array([sensor.bias for sensor in sensors.values() if sensor.bias])
    count, variances = len(sizes), np.diag(sizes**2)
    return air._replace(
        A=block_diag(air.A, -np.eye(count) / _BIAS_TIME),
        noise=block_diag(air.noise, variances * 2.0 / _BIAS_TIME),
        covariance=block_diag(air.covariance, variances),
        W=np.pad(air.W, [(0, 0), (0, count)]),
        E=np.pad(air.E, [(0, 0), (0, count)]),
    )


def least_rms(point: OperatingPoint, turbulence: Turbulence, late: float) -> dict[str, float]:
    """Return linear state -> the least rms in turbulence of any policy whose commands act late.

    What the turbulence of the last `late` seconds adds to the linear aircraft is not answered yet,
    and does not correlate with anything before: ∫ e^(A t) G G' e^(A' t) dt over [0, late].

    late: s
    """
    linear = point.linearize()
    _, unanswered = of_step(*_in_air(linear, _air(point, turbulence, late)), late)
    # The linear states come first.
    return dict(zip(linear.states, np.sqrt(np.diag(unanswered)).tolist(), strict=False))


def _in_air(linear: LinearModel, air: _Air) -> tuple[np.ndarray, np.ndarray]:
    """Return A and G G' of the linear states above those of the air."""
    k, of_air = len(linear.states), len(air.A)
    A = np.block([[linear.A, air.E], [np.zeros((of_air, k)), air.A]])
    noise = np.zeros_like(A)
    noise[k:, k:] = air.noise
    return A, noise


def _reaching(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return the indices of the states of x' = A x that act on the outputs C x."""
    reaching = (C != 0.0).any(axis=0)
    # A state acts through at most all others.
    for _ in range(len(A)):
        reaching |= (A[reaching] != 0.0).any(axis=0)
    return np.flatnonzero(reaching)


def _refuse_unobservable(
    A: np.ndarray, C: np.ndarray, states: tuple[str, ...], sensors: tuple[str, ...]
) -> None:
    """Raise BadInputError for a mode that does not decay, and that the sensors do not observe.

    A, C: of the linear states, in the units in which the filter is computed
    """
    size = np.linalg.norm(A, 2)
    for mode in modes_of(A, states):
        # A mode s is observable unless [A - s I; C] has a zero singular value (Popov, Hautus). C
        # times the size of A is comparable with A.
        shifted = A - mode.eigenvalue * np.eye(len(A))
        observed = np.linalg.svd(np.vstack([shifted, size * C]), compute_uv=False)[-1]
        is_decaying = mode.eigenvalue.real < -_LEAST_OBSERVABILITY * size
        if observed <= _LEAST_OBSERVABILITY * size and not is_decaying:
            unmeasured = [name for name in states if name not in sensors]
            best = max(unmeasured, key=mode.participation.__getitem__)
            raise BadInputError(
                f"the sensors {', '.join(sensors)} do not observe a mode of {best}, which does not "
                f"decay; add a sensor of {best}"
            )
