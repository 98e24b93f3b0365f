"""Many flights of a deployed policy at once, sampled and held as deployed, a second at a time.

A flight is a row [X; memory; lowest X; highest X; lowest U; highest U; trim; push]: the memory has
the commands u_{k-1} ... u_{k-d-1} that are still to act or act now, trim is (X0; U0; p), push adds
to the rates of the linear states.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from hfa_policy.deployed import Deployed
from hfa_policy.held_step import held_step
from hfa_support.native.bound import RowFunction
from hfa_support.native.machine_code import machine_code

#: Samples from which on compiling to machine code pays.
COMPILE_FROM = 50_000
#: Seconds after which it is asked how a flight stands.
WINDOW = 1.0
_MAKING = threading.Lock()
#: A delay within this part of a sample of a whole number of them is that number.
_WHOLE = 1e-9


@dataclass(frozen=True, eq=False)
class SampledFlight:
    """What every flight of a deployment has in common.

    deployed: the policy on its aircraft.
    dt, delay: s.
    parts: into how many steps of the integration a sample is divided.
    extra: length of further numbers of a row, which `command` takes behind the trim.
    command: (X, U before, trim, extra) -> U; that of the deployment unless given.
    """

    deployed: Deployed
    dt: float
    delay: float
    parts: int
    extra: int = 0
    command: ca.Function | None = None

    @property
    def whole(self) -> int:
        """Whole samples of the delay."""
        samples = self.delay / self.dt
        nearest = round(samples)
        return nearest if abs(samples - nearest) <= _WHOLE else math.floor(samples)

    @property
    def early(self) -> float:
        """Seconds of a sample during which the older command still acts."""
        rest = self.delay - self.whole * self.dt
        return rest if rest > _WHOLE * self.dt else 0.0

    @property
    def sizes(self) -> tuple[int, ...]:
        """Lengths of the parts of a row."""
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        trim = n + m + len(model.parameters)
        return (n, m * (self.whole + 1), n, n, m, m, trim, len(model.linear), self.extra)

    @property
    def slices(self) -> tuple[slice, ...]:
        """Where the parts of a row lie."""
        ends = np.cumsum([0, *self.sizes]).tolist()
        return tuple(slice(begin, end) for begin, end in pairwise(ends))

    @property
    def samples_in_window(self) -> int:
        """Samples of a window, at least one."""
        return max(1, round(WINDOW / self.dt))

    def sample(self) -> ca.Function:
        """row -> row a sample later."""
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        command = self.deployed.command if self.command is None else self.command
        row = ca.MX.sym("row", sum(self.sizes))
        parts = ca.vertsplit(row, np.cumsum([0, *self.sizes]).tolist())
        X, memory, low_X, high_X, low_U, high_U, trim, push, extra = parts
        before = memory[-m:]
        arguments = (X, before, trim, extra) if self.extra else (X, before, trim)
        U = command(*arguments)
        p = trim[n + m :]
        acting = U if self.whole == 0 else memory[(self.whole - 1) * m : self.whole * m]
        after = X
        if self.early:
            early_parts = max(1, math.ceil(self.parts * self.early / self.dt))
            after = held_step(model, self.early, early_parts)(after, before, push, p)
        late = self.dt - self.early
        late_parts = max(1, math.ceil(self.parts * late / self.dt - _WHOLE))
        after = held_step(model, late, late_parts)(after, acting, push, p)
        shifted = ca.vertcat(U, memory[: m * self.whole])
        ranges = (
            ca.fmin(low_X, after),
            ca.fmax(high_X, after),
            ca.fmin(low_U, acting),
            ca.fmax(high_U, acting),
        )
        later = ca.vertcat(after, shifted, *ranges, trim, push, extra)
        return ca.Function("sample", [row], [ca.densify(later)])

    def window(self, flights: int, seconds: float) -> ca.Function:
        """row -> row a window later, as machine code where so many flights pay for it."""
        several = self.sample().fold(self.samples_in_window)
        pays = flights * seconds / self.dt >= COMPILE_FROM
        return machine_code(several) if pays else several

    def rows(
        self,
        starts: np.ndarray,
        trims: np.ndarray,
        pushes: np.ndarray,
        extra: np.ndarray | None = None,
    ) -> np.ndarray:
        """The rows of flights that begin at states (N, n), about trims (N, ...), with the inputs of
        the trim acting."""
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        inputs = trims[:, n : n + m]
        memory = np.tile(inputs, (1, self.whole + 1))
        more = np.zeros((len(starts), 0)) if extra is None else extra
        columns = (starts, memory, starts, starts, inputs, inputs, trims, pushes, more)
        return np.hstack(columns)


def advanced(function: RowFunction, rows: np.ndarray) -> np.ndarray:
    """The rows a window later."""
    with np.errstate(all="ignore"):
        return function(rows)[0]


def in_threads(
    window: ca.Function, work: Callable[[RowFunction, np.ndarray], None], count: int
) -> None:
    """Calls `work` with a function of its own and numbers of rows, in as many threads as there are
    processors; the rows are dealt out like cards."""
    threads = max(1, min(os.cpu_count() or 1, count // 16))
    with _MAKING:
        functions = [RowFunction(window) for _ in range(threads)]
    dealt = [np.arange(first, count, threads) for first in range(threads)]
    if threads == 1:
        work(functions[0], dealt[0])
        return
    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(work, *pair) for pair in zip(functions, dealt, strict=True)]:
            done.result()
