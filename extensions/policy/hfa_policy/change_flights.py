"""Comparison of changed deployment files by the costs and the convergence of their flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.envelope import flight_envelope
from hfa_policy.assessment import Assessor
from hfa_policy.cost_above_optimum import weights_at
from hfa_policy.deployed import Deployed
from hfa_policy.episodes import cost_weights, weighted_squares
from hfa_policy.flights import SampledFlight, Steered, symbols_of_a_sample
from hfa_policy.held_step import parts_of_a_sample
from hfa_policy.outcomes import BALL, Place, seeded_starts
from hfa_policy.repairs import Repair
from hfa_policy.sampled_loop import held
from hfa_support.native.bound import RowFunction

#: A flight has not converged if it ends farther from the trim, in half-widths of the
#: initial-condition box, or moves by more than the ball in the last second. The limit exceeds 1
#: because some equilibria differ from the trim. With one of the many exchanges, a flight may end as
#: near by chance. It must therefore end in the box.
NEAR = 3.0
#: Costs above the first value are equal. The second is the smallest half-width of a box.
_MOST = 1e9
_LEAST = 1e-9


class Sample(NamedTuple):
    """Number and duration of the flights in a comparison of changed deployment files.

    starts: number of initial conditions for each change, over all trims.
    seconds: duration of each flight, s.
    """

    starts: int
    seconds: float


class FlightResults(NamedTuple):
    """Results of the N flights with one change of the deployment file.

    costs: (N,), cost of each flight.
    kept: number of flights that stay within the limits.
    back: number of these flights that end near the trim, almost steady.
    into_box: number of these flights that end in the initial-condition box, almost steady.
    """

    costs: np.ndarray
    kept: int
    back: int
    into_box: int

    def counted_in_box(self) -> FlightResults:
        """Return the results with `back` replaced by `into_box`."""
        return self._replace(back=self.into_box)

    def times(self, other: FlightResults) -> float:
        """Return the median ratio of the costs of these flights to the costs with another change.

        other: results with the other change, from the same initial conditions
        """
        return float(np.median(self.costs / other.costs))


class ChangeFlights:
    """Flights with changed deployment files from equal initial conditions about several trims.

    assessor: assessor of the unchanged deployment file.
    places: the trims.
    """

    def __init__(self, assessor: Assessor, places: Sequence[Place]) -> None:
        self.assessor = assessor
        self.deployed = assessor.deployed
        self.places = places
        self.points = [place.point for place in places]
        self.k = len(self.deployed.deployment.observation)
        self.m = len(self.deployed.deployment.action)

    def _flight(self, dt: float, delay: float) -> SampledFlight:
        """Return a simulation of flights in which each flight has its own change of the deployment.

        The change replaces the observations o by P o + c and the action a by gain * S a,
        elementwise in gain. P, c, gain and S are the extra entries of a flight's row
        (`flights.py`).

        dt, delay: sample time and delay, s
        """
        whole = self.assessor.flight()
        sizes = np.cumsum([0, self.k**2, self.k, self.m, self.m**2]).tolist()
        extra = sizes[-1]
        deployed = self.deployed
        arguments = symbols_of_a_sample(deployed, extra)
        P, c, gain, S = ca.vertsplit(arguments[3], sizes)
        raw = ca.SX.sym("raw", self.m)
        o = ca.mtimes(ca.reshape(P, self.k, self.k), deployed.observe(*arguments[:3])) + c
        seen = deployed.normalized(o)[1]
        action = ca.mtimes(ca.reshape(S, self.m, self.m), deployed.action(raw))
        moved = deployed.inputs(gain * action, *arguments[:3])
        steered = whole.steered._replace(
            enters=ca.Function("enters", arguments, [ca.densify(seen)]),
            moves=ca.Function("moves", [raw, *arguments], [ca.densify(moved)]),
        )
        return self._steered_by(steered, dt, delay, extra)

    def _steered_by(self, steered: Steered, dt: float, delay: float, extra: int) -> SampledFlight:
        """Return the simulation of flights with another policy, sample time and delay.

        steered: command steps of the other policy
        dt, delay: sample time and delay, s
        extra: number of extra entries in the row of each flight (`flights.py`)
        """
        parts = parts_of_a_sample(self.points, dt)
        whole = self.assessor.flight()
        return replace(whole, dt=dt, delay=delay, parts=parts, extra=extra, other=steered)

    def simulate_optimum(self, sample: Sample) -> FlightResults | None:
        """Return the results of flights with the sampled optimal gain of the first trim.

        The flights have no delay. The result is None if the optimum does not exist. Each flight
        that stays within the limits counts as a flight that converges.

        Raises BadInputError for the weight of an output that depends on the inputs.
        """
        gain = self._optimum()
        if gain is None:
            return None
        deployed = self.deployed
        model = deployed.model
        arguments = symbols_of_a_sample(deployed, 0)
        X, _, trim, _ = arguments
        states = list(model.states)
        inputs = list(model.inputs)
        linear = [states.index(name) for name in model.linear]
        seen = ca.vertcat(*(X[row] - trim[row] for row in linear))
        raw = ca.SX.sym("raw", self.m)
        moved = [trim[len(states) + row] for row in range(len(inputs))]
        for name, value in zip(deployed.commanded, ca.vertsplit(raw), strict=True):
            signal = model.inputs[name]
            row = inputs.index(name)
            moved[row] = ca.fmin(ca.fmax(moved[row] + value, signal.min), signal.max)
        deviation = ca.SX.sym("deviation", len(linear))
        steered = Steered(
            enters=ca.Function("enters", arguments, [ca.densify(seen)]),
            network=ca.Function("optimum", [deviation], [ca.mtimes(ca.DM(-gain), deviation)]),
            moves=ca.Function("moves", [raw, *arguments], [ca.vertcat(*moved)]),
        )
        flight = self._steered_by(steered, deployed.deployment.dt, 0.0, 0)
        starts_here = sample.starts // len(self.places)
        rows = []
        for place in self.places:
            starts, pushes = seeded_starts(place, starts_here, self.assessor.seed, False)
            trims = np.tile(deployed.trim_vector(place.point), (starts_here, 1))
            rows.append(flight.rows(starts, trims, pushes))
        owners = np.repeat(np.arange(len(self.places)), starts_here)
        costs, kept = self._costs_and_kept(flight, np.vstack(rows), owners, sample.seconds)
        return FlightResults(costs, int(kept.sum()), int(kept.sum()), int(kept.sum()))

    def _optimum(self) -> np.ndarray | None:
        """Return the gain K of the sampled optimum u = -K x at the first trim.

        The result is None if no optimum exists. Raises BadInputError for the weight of an output
        that depends on the inputs.
        """
        from scipy.linalg import LinAlgError, solve_discrete_are

        point = self.points[0]
        model = self.deployed.model
        linear = [list(model.states).index(name) for name in model.linear]
        moved = [list(model.inputs).index(name) for name in self.deployed.commanded]
        slopes = model.at(point.states, point.inputs)
        A = slopes.A[np.ix_(linear, linear)]
        B = slopes.B[np.ix_(linear, moved)]
        Q, R = weights_at(self.deployed, point)
        Phi, Gamma = held(A, B, self.deployed.deployment.dt)
        try:
            P = solve_discrete_are(Phi, Gamma, Q, R)
        except (LinAlgError, ValueError):
            return None
        return np.asarray(np.linalg.solve(R + Gamma.T @ P @ Gamma, Gamma.T @ P @ Phi))

    def simulate(
        self,
        repairs: Sequence[Repair],
        sample: Sample,
        dt: float | None = None,
        delay: float | None = None,
    ) -> list[FlightResults]:
        """Simulate flights with each change and return their costs and counts.

        repairs: the changes
        sample: number of initial conditions for each change, and duration of a flight
        dt, delay: sample time and delay, s. Default: those of the deployment file
        """
        card = self.deployed.deployment
        flight = self._flight(card.dt if dt is None else dt, card.delay if delay is None else delay)
        starts_here = sample.starts // len(self.places)
        places_of_a_change = np.repeat(np.arange(len(self.places)), starts_here)
        owners = np.tile(places_of_a_change, len(repairs))
        rows = np.vstack([self._rows(flight, repair, starts_here) for repair in repairs])
        costs, kept = self._costs_and_kept(flight, rows, owners, sample.seconds)
        distance, swing = self._distance_and_swing(flight, rows, owners)
        at_rest = kept & (swing <= BALL)
        ends = (kept, at_rest & (distance <= NEAR), at_rest & (distance <= 1.0))
        of_each_change = (len(repairs), -1)
        counts = [end.reshape(of_each_change).sum(axis=1).tolist() for end in ends]
        return [*map(FlightResults, costs.reshape(of_each_change), *counts)]

    def _rows(self, flight: SampledFlight, repair: Repair, starts_here: int) -> np.ndarray:
        """Return the initial rows of the flights with one change, ordered by trim (`flights.py`).

        starts_here: number of initial conditions at each trim
        """
        changed = Deployed(repair.deployment, self.deployed.model)
        rows = []
        for place, observed in zip(self.places, self._observed, strict=True):
            trim = self.deployed.trim_vector(place.point)
            starts, pushes = seeded_starts(place, starts_here, self.assessor.seed, False)
            c = _observed_at(changed, trim) - repair.P @ observed
            numbers = [repair.P.ravel(order="F"), c, repair.gain, repair.S.ravel(order="F")]
            extra = np.tile(np.concatenate(numbers), (starts_here, 1))
            trims = np.tile(trim, (starts_here, 1))
            rows.append(flight.rows(starts, trims, pushes, extra))
        return np.vstack(rows)

    @cached_property
    def _observed(self) -> list[np.ndarray]:
        """Observations (k,) of the unchanged file at each trim."""
        return [
            _observed_at(self.deployed, self.deployed.trim_vector(point)) for point in self.points
        ]

    def _distance_and_swing(
        self, flight: SampledFlight, rows: np.ndarray, owners: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the deviation and the swing of each flight in its last window, (N,) each.

        The deviation is the largest distance from the trim. The swing is half the range. Each is
        the maximum over the linear states, in half-widths of the initial-condition box.

        owners: (N,), index of each flight's trim
        """
        _, _, low_X, high_X, *_ = flight.slices
        model = self.deployed.model
        linear = [list(model.states).index(name) for name in model.linear]
        centre = np.array([np.array(point.states)[linear] for point in self.points])[owners]
        box = np.maximum([place.box for place in self.places], _LEAST)[owners]
        lowest = rows[:, low_X][:, linear]
        highest = rows[:, high_X][:, linear]
        distance = np.maximum(highest - centre, centre - lowest) / box
        swing = (highest - lowest) / 2.0 / box
        return distance.max(axis=1), swing.max(axis=1)

    def _costs_and_kept(
        self, flight: SampledFlight, rows: np.ndarray, owners: np.ndarray, seconds: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the costs of flights, (N,), and whether they stay within the limits, (N,).

        `rows` receives the final rows of the flights. The cost is the sum of x'Qx + u'Ru over the
        windows, with the largest deviations from trim in each window. The cost of the outputs in a
        window is the largest at a sample. For a flight that leaves the limits, the cost of that
        window is also counted for each remaining window. All costs are limited to [`_LEAST`,
        `_MOST`].

        rows: initial rows of the flights (`flights.py`)
        owners: (N,), index of each flight's trim
        seconds: duration of a flight, s
        """
        model = self.deployed.model
        X, memory, low_X, high_X, low_U, high_U, _, trim, _, _ = flight.slices
        n, m = len(model.states), len(model.inputs)
        Q, R = cost_weights(self.deployed)
        of_states = [Q.get(name, 0.0) for name in model.states]
        of_inputs = [R.get(name, 0.0) for name in model.inputs]
        weights = np.array([*of_states, *of_inputs])
        of_outputs = {name: Q[name] for name in Q if name in model.outputs}
        on_rows = RowFunction(weighted_squares(self.deployed, of_outputs))

        def output_cost(moved: np.ndarray) -> np.ndarray | float:
            U = moved[:, memory][:, -m:]
            return on_rows(moved[:, X], U, moved[:, trim])[0][:, 0] if of_outputs else 0.0

        windows = max(1, round(seconds / (flight.samples_in_window * flight.dt)))
        window = flight.window(len(rows), seconds)
        envelopes = [flight_envelope(model, point) for point in self.points]
        least = np.array([envelope.least for envelope in envelopes])[owners]
        most = np.array([envelope.most for envelope in envelopes])[owners]
        costs = np.zeros(len(rows))
        flying = np.arange(len(rows))
        for number in range(windows):
            moved = rows[flying]
            flight.forget_extremes(moved)
            output_costs = output_cost(moved)
            for _ in window.samples(moved):
                output_costs = np.maximum(output_costs, output_cost(moved))
            rows[flying] = moved
            lowest = np.hstack([moved[:, low_X], moved[:, low_U]])
            highest = np.hstack([moved[:, high_X], moved[:, high_U]])
            base = moved[:, trim][:, : n + m]
            with np.errstate(all="ignore"):
                largest = np.maximum(highest - base, base - lowest)
                rate = largest**2 @ weights + output_costs
                rate = np.nan_to_num(rate, nan=_MOST).clip(max=_MOST)
            is_lost = ~flight.are_inside(moved, least[flying], most[flying])
            costs[flying] += rate * np.where(is_lost, windows - number, 1)
            flying = flying[~is_lost]
            if not flying.size:
                break
        kept = np.zeros(len(rows), dtype=bool)
        kept[flying] = True
        return np.clip(costs, _LEAST, _MOST), kept


def _observed_at(deployed: Deployed, trim: np.ndarray) -> np.ndarray:
    """Return the observations (k,) of a deployment at a trim.

    trim: X0, U0 and parameters of the trim, as one vector
    """
    n, m = len(deployed.model.states), len(deployed.model.inputs)
    return np.array(deployed.observe(trim[:n], trim[n : n + m], trim)).ravel()
