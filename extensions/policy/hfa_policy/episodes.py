"""Many episodes of an aircraft at once, observed, moved, sampled and held as a deployment file
describes, with its cost as the reward."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.envelope import flight_envelope
from hfa_flight.turbulence import AirFilter, Turbulence
from hfa_policy.departures import departure_at, refuse_edges
from hfa_policy.deployed import Deployed
from hfa_policy.flights import SampledFlight, Steered, symbols_of_a_sample
from hfa_policy.held_step import parts_of_a_sample
from hfa_policy.outcomes import start_box
from hfa_policy.row_code import RowCode, row_code
from hfa_support.errors import BadInputError, is_finite, shown
from trim.point.operating_point import OperatingPoint

#: Episodes from which on threads share them: fewer are flown in the time that sharing takes.
_MANY = 500
#: Cost of a sample that is no finite number.
_DEAREST = 1e6
#: Seconds of an episode unless asked for.
SECONDS = 20.0


class Stepped(NamedTuple):
    """Results of a sample of N episodes.

    observations: (N, k) of all samples of the history, the oldest first.
    rewards: (N,), minus the cost of the sample.
    lost: (N,), whether the aircraft left its limits.
    over: (N,), whether the time of the episode is over.
    left: number of a lost episode -> the state that left its limit, the limit and the time.
    """

    observations: np.ndarray
    rewards: np.ndarray
    lost: np.ndarray
    over: np.ndarray
    left: dict[int, str]


class Episodes:
    """N episodes of a deployment on its aircraft, each about one of several trims.

    The reward of a sample is -dt (x'Q x + u'R u) of the card's Q and R: x deviations from the trim
    at the sample, u the commanded inputs minus the trim. Without a cost Q and R are 1/nominal²
    of the linear states and the moved inputs. An episode that leaves the limits pays
    the rest of its time at the rate of that sample, so that leaving is never an advantage.
    """

    def __init__(
        self,
        deployed: Deployed,
        points: Sequence[OperatingPoint],
        count: int,
        seconds: float = SECONDS,
        turbulence: Turbulence | None = None,
    ) -> None:
        """turbulence: which episodes meet; drawn anew for each of them.

        BadInputError where there is no trim, an action has no box, the time is no number, or the
        aircraft takes no turbulence."""
        if not points:
            raise BadInputError("there is no trim to begin at; give at least one operating point")
        if not (is_finite(seconds) and seconds >= deployed.deployment.dt):
            raise BadInputError(f"an episode of {shown(seconds)} s; give at least one sample")
        self.deployed = deployed
        self.points = tuple(points)
        self.low, self.high = _box_of(deployed)
        refuse_edges(points)
        middle_of_box = 0.5 * self.low + 0.5 * self.high
        deployed.refuse_undefined_at(points, middle_of_box)
        self.samples = round(seconds / deployed.deployment.dt)
        actions = len(deployed.commanded)
        self._air = None
        if turbulence is not None:
            self._air = EpisodeAir(turbulence, points, count, deployed.deployment.dt)
        self._flight = SampledFlight(
            deployed,
            deployed.deployment.dt,
            deployed.deployment.delay,
            parts_of_a_sample(list(points), deployed.deployment.dt),
            extra=actions,
            other=_moved_by_actions(deployed, self.low, self.high),
            winds=() if self._air is None else self._air.names,
        )
        self._step = row_code(self._sample(), together=1 if count == 1 else None)
        self._threads = ThreadPoolExecutor() if count >= _MANY else None
        self._observe = row_code(self._observation())
        self._envelopes = [flight_envelope(deployed.model, point) for point in points]
        self._least = np.array([envelope.least for envelope in self._envelopes])
        self._most = np.array([envelope.most for envelope in self._envelopes])
        self._boxes = np.array([start_box(deployed.model, point) for point in points])
        self._trims = np.array([deployed.trim_vector(point) for point in points])
        self._linear = [list(deployed.model.states).index(name) for name in deployed.model.linear]
        self._rows = np.zeros((count, sum(self._flight.sizes)))
        self._bound = self._step.bound(self._rows) if isinstance(self._step, RowCode) else None
        slices = self._flight.slices
        self._X, self._extra = slices[0], slices[-1]
        self._winds = slice(slices[-1].start - len(self._flight.winds), slices[-1].start)
        self._U = slice(slices[1].stop - len(deployed.model.inputs), slices[1].stop)
        self._inside = self._least[np.zeros(count, dtype=int)], self._most[[0] * count]
        self._frames = np.zeros((count, deployed.deployment.width))
        self._has_past = deployed.past > 0
        self.done = np.zeros(count, dtype=int)
        self.owners = np.zeros(count, dtype=int)

    @property
    def states(self) -> np.ndarray:
        """X of each episode, (N, n)."""
        return self._rows[:, self._X].copy()

    @property
    def inputs(self) -> np.ndarray:
        """The input that acts just before the sample, of each episode, (N, m)."""
        return self._rows[:, self._U].copy()

    def begin(self, numbers: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Begin these episodes anew, at a random trim and from a random start in the box about it;
        their observations."""
        owners = random.integers(len(self.points), size=len(numbers))
        share = random.uniform(-1.0, 1.0, (len(numbers), len(self._linear)))
        trims = self._trims[owners]
        starts = trims[:, : len(self.deployed.model.states)].copy()
        starts[:, self._linear] += share * self._boxes[owners]
        if self._air is not None and len(numbers) == len(self.done):
            self._air.seed(int(random.integers(2**63)))
        return self.begin_at(numbers, owners, starts)

    def begin_at(self, numbers: np.ndarray, owners: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Begin these episodes about the trims with these numbers, from states (N, n); the earlier
        observations are the first."""
        count = len(numbers)
        pushes = np.zeros((count, len(self._linear) + len(self._flight.winds)))
        if self._air is not None:
            self._air.begin(numbers, owners)
        actions = np.zeros((count, len(self.low)))
        self._rows[numbers] = self._flight.rows(starts, self._trims[owners], pushes, actions)
        self.owners[numbers] = owners
        self._inside = self._least[self.owners], self._most[self.owners]
        self.done[numbers] = 0
        first = self.observations(numbers)
        self._frames[numbers] = np.tile(first, (1, self.deployed.deployment.history))
        return self._frames[numbers]

    def observations(self, numbers: np.ndarray) -> np.ndarray:
        """Observations of these episodes at this sample, (N, k)."""
        return np.asarray(self._observe(self._rows[numbers])[0])

    def step(self, actions: np.ndarray) -> Stepped:
        """One sample of all episodes with these actions, (N, m), beyond the box as at its end.

        BadInputError where they are of another shape, or one of them is not a number.
        """
        wanted = (len(self.done), len(self.low))
        if actions.shape != wanted or np.isnan(actions).any():
            raise BadInputError(
                f"an action is {shown(actions.tolist())}; give {wanted[0]} x {wanted[1]} numbers"
            )
        self._rows[:, self._extra] = actions
        if self._air is not None:
            self._rows[:, self._winds] = self._air.step()
        after, costs, observed = self._stepped()
        observations = observed.copy()
        X = after[:, self._X]
        least, most = self._inside
        is_inside = (least <= X) & (most >= X)
        lost = np.asarray(~is_inside.all(axis=1))
        moved = self._rows[:, : after.shape[1]]
        rewards = -costs[:, 0]
        if np.isfinite(after).all():
            moved[:] = after
        else:  # what is no number is shown where the flight was last
            finite = np.isfinite(after).all(axis=1)
            lost |= ~finite
            moved[finite] = after[finite]
            observations[~finite] = self.observations(np.flatnonzero(~finite))
            rewards = np.nan_to_num(rewards, nan=0.0, neginf=-_DEAREST)
        self.done += 1
        left: dict[int, str] = {}
        if lost.any():
            rewards[lost] *= 1 + self.samples - self.done[lost]
            left = {each: self._left(each, X[each]) for each in np.flatnonzero(lost).tolist()}
        if self._has_past:
            kept = self._frames[:, observations.shape[1] :]
            self._frames = np.hstack([kept, observations])
            observations = self._frames.copy()
        return Stepped(observations, rewards, lost, self.done >= self.samples, left)

    def _left(self, number: int, states: np.ndarray) -> str:
        """How an episode has left the envelope with these states (n,)."""
        time = float(self.done[number] * self.deployed.deployment.dt)
        return departure_at(self._envelopes[self.owners[number]], states, time)

    def _stepped(self) -> Sequence[np.ndarray]:
        """Return states, memories, costs and observations of all rows after a sample, in as many
        threads as there are processors."""
        if self._bound is not None and self._threads is None:
            return self._bound()
        if self._threads is None:
            return self._step(self._rows)
        parts = np.array_split(self._rows, os.cpu_count() or 1)
        done = self._threads.map(self._step, parts)
        return [np.concatenate(tables) for tables in zip(*done, strict=True)]

    def _sample(self) -> ca.Function:
        """row -> ([X; memory] a sample later, cost of the sample, o a sample later)."""
        flight = self._flight
        row = ca.MX.sym("row", sum(flight.sizes))
        X, before, trim, actions = flight.observed(row)
        U = flight.steered.moves(actions, X, before, trim, actions)
        cost = flight.dt * cost_rate(self.deployed)(X, U, trim)
        moved, _ = flight.moved()(row, actions)
        X_later, memory = ca.vertsplit(moved, [0, X.numel(), moved.numel()])
        o = self.deployed.observe(X_later, memory[-before.numel() :], trim)
        return ca.Function("episode", [row], [moved, ca.densify(cost), o])

    def _observation(self) -> ca.Function:
        """row -> o."""
        row = ca.MX.sym("row", sum(self._flight.sizes))
        X, before, trim, _ = self._flight.observed(row)
        return ca.Function("observation", [row], [self.deployed.observe(X, before, trim)])


class EpisodeAir:
    """The turbulence of N episodes, each about one of several trims: exact at the samples, its mean
    of both ends held during each."""

    def __init__(
        self, turbulence: Turbulence, points: Sequence[OperatingPoint], count: int, dt: float
    ) -> None:
        """BadInputError as of `Turbulence.air`."""
        airs = [turbulence.air(point, dt, 1, 0) for point in points]
        filters = [AirFilter.of(air) for air in airs]
        self.names = airs[0].names
        self._steps = np.array([each.step[0] for each in filters])
        self._noises = np.array([each.step[1] for each in filters])
        self._stationary = np.array([each.root for each in filters])
        self._seen = np.array(
            [air.factors.T @ each.C for air, each in zip(airs, filters, strict=True)]
        )
        self._states = np.zeros((count, self._steps.shape[1]))
        self._owners = np.zeros(count, dtype=int)
        self._random = np.random.default_rng()

    def seed(self, seed: int) -> None:
        """Decide everything that is drawn from now on."""
        self._random = np.random.default_rng(seed)

    def begin(self, numbers: np.ndarray, owners: np.ndarray) -> None:
        """Begin these episodes in stationary turbulence about the trims `owners`."""
        draw = self._random.standard_normal((len(numbers), self._states.shape[1]))
        self._owners[numbers] = owners
        self._states[numbers] = _rowwise(self._stationary[owners], draw)

    def step(self) -> np.ndarray:
        """The disturbances of the next sample, (N, k)."""
        owners = self._owners
        draw = self._random.standard_normal(self._states.shape)
        before = self._states
        moved = _rowwise(self._steps[owners], before)
        self._states = moved + _rowwise(self._noises[owners], draw)
        return _rowwise(self._seen[owners], 0.5 * (before + self._states))


def _rowwise(matrices: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Each row (N, n) times its matrix (N, m, n)."""
    return np.einsum("nij,nj->ni", matrices, rows)


def _box_of(deployed: Deployed) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest action; BadInputError where one has no box."""
    low, high = deployed.deployment.box
    for name, lowest, highest in zip(deployed.commanded, low, high, strict=True):
        if not (np.isfinite(lowest) and np.isfinite(highest)):
            raise BadInputError(
                f"{deployed.deployment.origin}: action.{name} has no box, which an environment"
                " needs; give box = [lowest, highest]"
            )
    return low, high


def _moved_by_actions(deployed: Deployed, low: np.ndarray, high: np.ndarray) -> Steered:
    """By actions, the further numbers of a row, clipped to their box."""
    count = len(low)
    arguments = symbols_of_a_sample(deployed, count)
    action = ca.SX.sym("a", count)
    within = ca.fmin(ca.fmax(action, ca.DM(low)), ca.DM(high))
    commanded = deployed.inputs(within, *arguments[:3])
    return Steered(
        enters=ca.Function("enters", arguments, [arguments[3]]),
        network=ca.Function("none", [action], [action]),
        moves=ca.Function("moves", [action, *arguments], [ca.densify(commanded)]),
    )


def cost_weights(deployed: Deployed) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Q of states and outputs, R of inputs: those of the card, else 1/nominal² of the linear states
    and the moved inputs."""
    model = deployed.model
    cost = deployed.deployment.cost
    if cost is not None:
        return cost["Q"], cost["R"]
    nominal = {name: model.signals[name].nominal ** -2.0 for name in model.signals}
    Q = {name: nominal[name] for name in model.linear}
    R = {name: nominal[name] for name in deployed.commanded}
    return Q, R


def cost_rate(deployed: Deployed) -> ca.Function:
    """(X, U, trim) -> x'Q x + u'R u, of deviations from the trim."""
    model = deployed.model
    Q, R = cost_weights(deployed)
    X, U, trim = (ca.SX.sym(name, size) for name, size in _sizes(deployed))
    n, m = len(model.states), len(model.inputs)
    here = deployed.values(X, U, trim)
    there = deployed.values(trim[:n], trim[n : n + m], trim)
    terms = [
        weight * (here[name] - there[name]) ** 2
        for weights in (Q, R)
        for name, weight in weights.items()
    ]
    return ca.Function("cost_rate", [X, U, trim], [ca.densify(ca.SX(sum(terms)))])


def _sizes(deployed: Deployed) -> tuple[tuple[str, int], ...]:
    model = deployed.model
    n, m = len(model.states), len(model.inputs)
    return ("X", n), ("U", m), ("trim", n + m + len(model.parameters))
