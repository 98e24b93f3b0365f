"""Simulation of many flights of a deployed policy, sampled and held as deployed.

The state of a flight is stored as a row of numbers:

    [X; memory; lowest X; highest X; lowest U; highest U; past; trim; push; extra]

The memory contains the commands u_{k-1} ... u_{k-d-1} that act now or later. The past contains
earlier observations that the policy uses. The trim is (X0; U0; p). The push is added to the
rates of the linear states, followed by the disturbances of the aircraft. Extra entries are
arguments of the policy, such as actions.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.network.row_network import RowNetwork
from hfa_flight.held_step import held_step
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.native.bound import RowFunction
from hfa_support.native.row_code import row_code

#: Number of samples from which on compilation to machine code is faster.
COMPILE_FROM = 50_000
#: Interval at which flights are checked, s.
WINDOW = 1.0
#: A delay this close to a complete number of samples, in samples, is rounded to it.
_WHOLE = 1e-9

#: Function of tables with one row for each flight.
Rows = Callable[..., list[np.ndarray]]


class Steered(NamedTuple):
    """Command at a sample in three steps.

    enters: (X, U before, trim, extra) -> inputs of the network, (k,). If earlier observations are
        used, `past` is a further argument.
    network: inputs (k,) -> outputs (m,).
    moves: (outputs of the network, X, U before, trim, extra) -> U.
    rows: the network for many rows, or None if `network` is called for each row.
    past: (X, U before, trim, extra, past) -> past of the next sample, or None for one sample.
    """

    enters: ca.Function
    network: ca.Function
    moves: ca.Function
    rows: RowNetwork | None = None
    past: ca.Function | None = None


def steered_by(deployed: Deployed) -> Steered:
    """Return the steps by which a deployment computes its command at a sample."""
    arguments = symbols_of_a_sample(deployed, 0)
    raw = ca.SX.sym("raw", len(deployed.commanded))
    past = ca.SX.sym("past", deployed.past)
    frames = ca.vertcat(past, deployed.observe(*arguments[:3]))
    seen = deployed.normalized(frames)[1]
    entering = [*arguments, past] if deployed.past else arguments
    later = ca.densify(frames[frames.numel() - deployed.past :])
    moved = deployed.inputs(deployed.action(raw), *arguments[:3])
    actor = deployed.deployment.actor
    return Steered(
        enters=ca.Function("enters", entering, [ca.densify(seen)]),
        network=actor.function,
        moves=ca.Function("moves", [raw, *arguments], [ca.densify(moved)]),
        rows=actor.rows,
        past=ca.Function("past", entering, [later]) if deployed.past else None,
    )


def symbols_of_a_sample(deployed: Deployed, extra: int) -> list[ca.SX]:
    """Return new symbols of X, U just before the sample, the trim (X0; U0; p) and extra numbers.

    extra: number of the extra numbers
    """
    n, m = len(deployed.model.states), len(deployed.model.inputs)
    sizes = (n, m, n + m + len(deployed.model.parameters), extra)
    return [ca.SX.sym("x", size) for size in sizes]


@dataclass(frozen=True, eq=False)
class SampledFlight:
    """Simulation of flights of a deployment, and layout of the rows that contain their states.

    deployed: the policy on its aircraft.
    dt, delay: sample time and delay, s.
    parts: number of integration steps in a sample.
    extra: number of extra entries of a row. They are arguments of `steered` after the trim.
    other: another policy, or None for the policy of the deployment.
    winds: disturbances of the aircraft. They follow the push in a row.
    """

    deployed: Deployed
    dt: float
    delay: float
    parts: int
    extra: int = 0
    other: Steered | None = None
    winds: tuple[str, ...] = ()

    @cached_property
    def steered(self) -> Steered:
        """Steps by which the policy computes its command at a sample."""
        return steered_by(self.deployed) if self.other is None else self.other

    @property
    def whole(self) -> int:
        """Number of complete samples in the delay."""
        samples = self.delay / self.dt
        nearest = round(samples)
        return nearest if abs(samples - nearest) <= _WHOLE else math.floor(samples)

    @property
    def early(self) -> float:
        """Time after a sample, s, during which the earlier of two delayed commands still acts.

        The time is 0 for a delay of complete samples.
        """
        rest = self.delay - self.whole * self.dt
        return rest if rest > _WHOLE * self.dt else 0.0

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of entries of the parts of a flight's row: X, memory, lowest X, ..., extra."""
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        trim = n + m + len(model.parameters)
        past = 0 if self.steered.past is None else self.deployed.past
        pushes = len(model.linear) + len(self.winds)
        return (n, m * (self.whole + 1), n, n, m, m, past, trim, pushes, self.extra)

    @property
    def slices(self) -> tuple[slice, ...]:
        """Slices of the parts of a flight's row: X, memory, lowest X, ..., extra."""
        ends = np.cumsum([0, *self.sizes]).tolist()
        return tuple(slice(begin, end) for begin, end in pairwise(ends))

    @property
    def samples_in_window(self) -> int:
        """Number of samples in a window of `WINDOW` s, at least one."""
        return max(1, round(WINDOW / self.dt))

    @property
    def changing(self) -> int:
        """Number of leading entries of a flight's row that change from sample to sample."""
        return sum(self.sizes[:7])

    def entering(self) -> ca.Function:
        """Function from the row of a flight to the inputs of the policy's network."""
        row = ca.MX.sym("row", sum(self.sizes))
        return ca.Function("entering", [row], [self.steered.enters(*self._entered(row))])

    def moved(self) -> ca.Function:
        """Function that advances the aircraft of one flight by a sample.

        It maps (row of the flight, outputs of the network) to ([X; memory] after the sample, input
        that acts at the end of the sample).
        """
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        row = ca.MX.sym("row", sum(self.sizes))
        raw = ca.MX.sym("raw", self.steered.moves.numel_in(0))
        X, memory, _, _, _, _, _, trim, push, _ = self._parts(row)
        before = memory[-m:]
        U = self.steered.moves(raw, *self.observed(row))
        p = trim[n + m :]
        acting = U if self.whole == 0 else memory[(self.whole - 1) * m : self.whole * m]
        after = X
        if self.early:
            early_parts = max(1, math.ceil(self.parts * self.early / self.dt - _WHOLE))
            after = held_step(model, self.early, early_parts, self.winds)(after, before, push, p)
        late = self.dt - self.early
        late_parts = max(1, math.ceil(self.parts * late / self.dt - _WHOLE))
        after = held_step(model, late, late_parts, self.winds)(after, acting, push, p)
        still_to_act, _ = ca.vertsplit(memory, [0, m * self.whole, m * (self.whole + 1)])
        moved = ca.densify(ca.vertcat(after, U, still_to_act))
        return ca.Function("moved", [row, raw], [moved, ca.densify(acting)])

    def later(self) -> ca.Function:
        """Function that computes the entries of a flight's row that change in one sample.

        It maps (row, outputs of the network) to X, memory, lowest and highest X and U so far, and
        past, all one sample later.
        """
        row = ca.MX.sym("row", sum(self.sizes))
        raw = ca.MX.sym("raw", self.steered.moves.numel_in(0))
        _, _, low_X, high_X, low_U, high_U, *_ = self._parts(row)
        moved, acting = self.moved()(row, raw)
        after = moved[: len(self.deployed.model.states)]
        ranges = (
            ca.fmin(low_X, after),
            ca.fmax(high_X, after),
            ca.fmin(low_U, acting),
            ca.fmax(high_U, acting),
        )
        past = [] if self.steered.past is None else [self.steered.past(*self._entered(row))]
        return ca.Function("later", [row, raw], [ca.vertcat(moved, *ranges, *past)])

    def sample(self) -> ca.Function:
        """Return the function from the row of a flight to its row one sample later."""
        row = ca.MX.sym("row", sum(self.sizes))
        raw = ca.vec(self.steered.network(self.entering()(row)))
        later = ca.vertcat(self.later()(row, raw), row[self.changing :])
        return ca.Function("sample", [row], [later])

    def _parts(self, row: ca.MX) -> list[ca.MX]:
        """Return the parts of a flight's row: X, memory, lowest X, ..., extra."""
        return ca.vertsplit(row, np.cumsum([0, *self.sizes]).tolist())

    def observed(self, row: ca.MX) -> tuple[ca.MX, ...]:
        """Return X, U just before the sample, the trim and the extra entries of a flight's row."""
        X, memory, _, _, _, _, _, trim, _, extra = self._parts(row)
        return X, memory[-len(self.deployed.model.inputs) :], trim, extra

    def _entered(self, row: ca.MX) -> tuple[ca.MX, ...]:
        """Return the arguments of `steered.enters` at a sample, from the row of a flight."""
        past = [] if self.steered.past is None else [self._parts(row)[6]]
        return (*self.observed(row), *past)

    def window(self, flights: int, seconds: float) -> Window:
        """Return the function that advances the rows of flights by a window of several samples.

        The function is compiled if flights * seconds / dt is at least `COMPILE_FROM`.

        flights: number of flights
        seconds: duration of a flight, s
        """
        is_long = flights * seconds / self.dt >= COMPILE_FROM
        on_rows = row_code if is_long else RowFunction
        network = self.steered.rows or _first_result(on_rows(self.steered.network))
        entering = on_rows(self.entering())
        later = on_rows(self.later())
        return Window(entering, network, later, self.samples_in_window)

    def forget_extremes(self, rows: np.ndarray) -> None:
        """Restart the recording of lowest and highest values in the rows of flights, in place.

        Lowest and highest X become the present X. The lowest U becomes inf, and the highest U -inf.
        """
        X, _, low_X, high_X, low_U, high_U, *_ = self.slices
        rows[:, low_X] = rows[:, X]
        rows[:, high_X] = rows[:, X]
        rows[:, low_U] = np.inf
        rows[:, high_U] = -np.inf

    def are_inside(self, rows: np.ndarray, least: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Return a mask (N,), True for flights that stayed within the limits and are finite.

        rows: rows of the flights
        least, most: limits of X, (N, n)
        """
        X, _, low_X, high_X, *_ = self.slices
        inside = (rows[:, low_X] >= least) & (rows[:, high_X] <= most)
        return np.asarray(inside.all(axis=1) & np.isfinite(rows[:, X]).all(axis=1))

    def rows(
        self,
        starts: np.ndarray,
        trims: np.ndarray,
        pushes: np.ndarray,
        extra: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the initial rows of flights, as described in the module.

        The inputs have their trim values, and earlier observations equal the first.

        starts: initial states X, (N, n)
        trims: (X0; U0; p) of each flight's trim
        pushes: disturbance pulse of each flight, followed by the disturbances `winds`
        extra: further entries of each row, or None
        """
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        inputs = trims[:, n : n + m]
        memory = np.tile(inputs, (1, self.whole + 1))
        more = np.zeros((len(starts), 0)) if extra is None else extra
        past = np.zeros((len(starts), 0))
        if self.steered.past is not None:
            observed = RowFunction(self.deployed.observe)(starts, inputs, trims)[0]
            past = np.tile(observed, (1, self.deployed.deployment.history - 1))
        columns = (starts, memory, starts, starts, inputs, inputs, past, trims, pushes, more)
        return np.hstack(columns)


def _first_result(function: Rows) -> RowNetwork:
    """Return the function of many rows that returns only the first of the results of `function`."""
    return lambda rows: function(rows)[0]


class Window:
    """Function that advances the rows of flights by a fixed number of samples."""

    def __init__(
        self,
        entering: Rows,
        network: RowNetwork,
        later: Rows,
        samples: int,
    ) -> None:
        self._samples = samples
        self._entering = entering
        self._network = network
        self._later = later

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Return the rows of the flights at the end of the window."""
        rows = rows.copy()
        for _ in self.samples(rows):
            pass
        return rows

    def samples(self, rows: np.ndarray) -> Iterator[None]:
        """Advance the rows in place by the samples of the window, and yield after each sample."""
        for _ in range(self._samples):
            with np.errstate(all="ignore"):
                raw = self._network(self._entering(rows)[0])
                changed = self._later(rows, raw)[0]
            rows[:, : changed.shape[1]] = changed
            yield


def in_threads(work: Callable[[np.ndarray], None], count: int) -> None:
    """Call a function with disjoint sets of flights, in several threads if there are many.

    work: the function of the indices of some flights
    count: number of flights
    """
    threads = max(1, min(os.cpu_count() or 1, count // 100))
    dealt = [np.arange(first, count, threads) for first in range(threads)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, dealt))
