"""Problem of one trim: unknowns within limits, equations, and initial values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import recognized, record
from hfa_support.errors import BadInputError, NotFiniteError
from hfa_support.matrices import LinearTable
from trim.point.condition import TrimCondition, release
from trim.point.halving import newton
from trim.point.status import BALANCE
from trim.point.system import TrimSystem, declared_start

#: Number of other initial points, and their largest distance from the default one, in scaled units,
#: if there is no limit.
STARTS = 8
_FAR = 10.0
#: Distance between 1 and the next double.
_EPSILON = float(np.finfo(float).eps)
#: Part of an effect, in balanced units, below which it counts as a combination of other effects:
#: half of the digits of a double. Where equations depend on each other only at the trim, a trim
#: that balances to `BALANCE` leaves a hundredth of it.
DEPENDENT = math.sqrt(_EPSILON)


class Evaluation(NamedTuple):
    """State, input, residuals and Jacobian of a trim's equations at one point.

    x, u: states and inputs, by name
    y: watched states and outputs (`Structure.watched`), an array
    residual: (e,), in scaled units
    jacobian: (e, k), derivatives of the residuals with respect to the scaled unknowns
    """

    x: Any
    u: Any
    y: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray


class BalancedEffects(NamedTuple):
    """Jacobian of a trim in balanced units: rows with the largest entry 1, columns of length 1.

    An entry below the rounding of its row is 0, and a row or column of zeros remains one.

    matrix: (m, k)
    lengths: (k,), the lengths by which the columns were divided
    rank: number of independent columns
    """

    matrix: np.ndarray
    lengths: np.ndarray
    rank: int


class TrimProblem:
    """Problem of one trim: a condition with numbers, its equations, and the initial values.

    asked: the condition as given
    condition: the condition with numbers, in which the speed replaces an airspeed
    system: the equations; the unknowns z are scaled
    c: (1, ..), constants of the system
    free: names of the k unknowns
    idle: names of free variables that are in no equation
    kept: states that the equations do not determine, imposed at their start values
    count: number of equations that the unknowns affect, and number k of unknowns

    Raises BadInputError if nothing is free and the point is not an equilibrium, if no free variable
    affects an equation or changes an imposed output, and for a condition of another model.
    """

    def __init__(
        self,
        model: Model,
        condition: TrimCondition,
        start: Mapping[str, float] | None = None,
        kept: tuple[str, ...] = (),
    ) -> None:
        """Build the equations and check that they can have a solution.

        start: initial values of the search instead of the start values of model and condition
        """
        if condition.model.variables != model.variables:
            raise BadInputError(
                f"the condition is for {condition.model.name}; give a condition for {model.name}"
            )

        self.asked = condition
        if any(isinstance(value, LinearTable) for value in condition.imposed.values()):
            condition = condition.at()
        if not model.airspeeds.keys().isdisjoint(condition.imposed):
            from hfa_aircraft.rigid.atmosphere import with_airspeed, with_speed

            # An airspeed, such as kcas, becomes the speed, or without an altitude an output.
            model = with_airspeed(model, condition.imposed)
            imposed = with_speed(model, condition.imposed)
            condition = replace(condition, model=model, imposed=imposed)
        if kept:
            declared = {**declared_start(model, condition.imposed), **condition.begin}
            condition = release(condition, hold={name: declared[name] for name in kept})

        self.model = model
        self.kept = kept
        self.given_start = start
        self.condition = condition
        self.system = TrimSystem(model, condition, begin=start)
        self.free = self.system.equations.unknowns
        self.idle = self.system.equations.idle
        self.count = self.system.affected_count, len(self.free)
        self.c = self.system.constants()
        self._last: dict[bytes, Evaluation] = {}  # of the last unknowns, by their bytes

        if not self.free and self.idle:
            idle = " and ".join(self.idle)
            raise BadInputError(f"the equations do not depend on {idle}; free another variable")
        if not self.free and not self.solved(self.system.start):
            raise BadInputError(
                "this point is not an equilibrium, and no variable is free; free a variable"
            )
        self._refuse_unaffected_outputs()

    def _refuse_unaffected_outputs(self) -> None:
        """Raise BadInputError if an imposed output, which no unknown affects, has another value."""
        describe = self.model.describe
        for place, row in enumerate(self.system.equations.rows):
            if row.is_rate or place < self.count[0]:
                continue
            residual = self.at(self.system.start).residual[place]
            if abs(residual) <= BALANCE:
                continue
            imposed = self.condition.imposed[row.name]
            actual = describe(row.name, imposed + residual * row.scale)
            raise BadInputError(
                f"{row.name} is {describe(row.name, imposed)}, but no free variable changes "
                f"it from {actual}; free what it depends on, or remove this value"
            )

    def keeping(self, kept: tuple[str, ...]) -> TrimProblem:
        """Return the problem in which some states are imposed at their start values."""
        return TrimProblem(self.model, self.asked, self.given_start, kept)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the arguments from which pickle restores the problem.

        Compiled functions are created again. The start of the search, which is over, is not kept.
        """
        return TrimProblem, (self.model, self.asked, None, self.kept)

    def at(self, z: np.ndarray) -> Evaluation:
        """Return the state, input, residuals and Jacobian for scaled unknowns z, (k,).

        Raises NotFiniteError if a result is not finite, and BadInputError if the model refuses
        the state.
        """
        key = z.tobytes()
        if key in self._last:
            return self._last[key]
        rows = self.system.equations.point_rows(z[None], self.c)
        x, u, y, residual, jacobian = (part[0] for part in rows)
        states = record(tuple(self.model.states))(*x.tolist())
        inputs = record(tuple(self.model.inputs))(*u.tolist())
        if check := self.model.domain.check:
            check(states)
        if not np.isfinite(np.concatenate(rows, axis=1)).all():
            self.model.at(states, inputs)  # raises an error that names the rate
            raise NotFiniteError(f"{self.model.name}: an output is not a finite number")
        derivatives = jacobian.reshape(len(residual), len(z))
        self._last = {key: Evaluation(states, inputs, y, residual, derivatives)}
        return self._last[key]

    def newton(
        self,
        z: np.ndarray,
        moving: np.ndarray | None = None,
        rows: list[int] | None = None,
        bounded: bool = False,
    ) -> np.ndarray:
        """Return the scaled unknowns (k,) after Newton's method, even if it has not converged.

        z: initial unknowns, (k,)
        moving: indices of the unknowns that may change; None for all
        rows: indices of the equations that are solved; None for all
        bounded: whether the unknowns remain within their limits
        """
        ends, _ = newton(self.system, z[None], self.c, moving, bounded, rows)
        return ends[0]

    def clip(self, z: np.ndarray) -> np.ndarray:
        """Return the scaled unknowns within their limits that are nearest to z, (k,)."""
        return np.minimum(np.maximum(z, self.system.lowest), self.system.highest)

    def solved(self, z: np.ndarray) -> bool:
        """Return whether scaled unknowns z, (k,), are a trim.

        The equations must balance, and the unknowns and the watched states and outputs must be
        within their limits.
        """
        return self.balanced(z) and self.within(z)

    def within(self, z: np.ndarray) -> bool:
        """Return whether the unknowns z, (k,), and the watched signals are in their limits."""
        system = self.system
        unknowns = system.limits.within(z * system.scales)
        return bool(unknowns.all() and system.watched.within(self.at(z).y).all())

    def balanced(self, z: np.ndarray) -> bool:
        """Return whether every scaled residual is within `BALANCE`, regardless of the limits.

        The result is False if the equations cannot be evaluated.

        z: scaled unknowns, (k,)
        """
        try:
            return bool(np.abs(self.at(z).residual).max() <= BALANCE)
        except (BadInputError, FloatingPointError):
            return False

    def starts(self, guess: np.ndarray) -> Iterator[np.ndarray]:
        """Yield initial points for further searches, evenly spread within the limits, (k,) each.

        Of `STARTS` points, those at which the equations cannot be evaluated are omitted. No point
        is yielded without unknowns, or with more equations than unknowns.

        The points are k α modulo 1 with α_j = φ^-j, φ^(d+1) = φ + 1 (Roberts' generalized golden
        ratio), without random numbers.

        guess: initial point of the first search, (k,)
        """
        equations, unknowns = self.count
        system = self.system
        if not unknowns or equations > unknowns:
            return
        far = np.minimum(_FAR, system.quarter_turn)
        lowest = np.where(np.isfinite(system.lowest), system.lowest, guess - far)
        highest = np.where(np.isfinite(system.highest), system.highest, guess + far)
        polynomial = np.concatenate([[1.0], np.zeros(unknowns - 1), [-1.0, -1.0]])  # root φ
        golden = max(np.roots(polynomial).real) ** -np.arange(1.0, unknowns + 1)  # α
        for number in range(1, STARTS + 1):
            start = lowest + (highest - lowest) * ((0.5 + number * golden) % 1.0)
            try:
                self.at(start)
            except (BadInputError, FloatingPointError):
                continue  # outside the range of the model
            yield start

    def ends_within(self, starts: list[np.ndarray]) -> np.ndarray:
        """Return the scaled unknowns after bounded Newton's method from each of N initial points,
        (N, k).

        The points need not have converged.

        starts: initial points, (k,) each
        """
        c = np.repeat(self.c, len(starts), axis=0)
        begin = np.reshape(starts, (len(starts), len(self.free)))  # (0, k) without starts
        with np.errstate(over="ignore"):
            z, _ = newton(self.system, begin, c, bounded=True)
        return z

    def balanced_effects(self, z: np.ndarray) -> BalancedEffects:
        """Return the Jacobian at scaled unknowns z, (k,), and its rank, in units in which each row
        has the largest entry 1 and each column the length 1.
        """
        jacobian = self.at(z).jacobian[: self.system.affected_count]
        largest = np.abs(jacobian).max(axis=1, keepdims=True, initial=0.0)
        rows = jacobian / np.where(largest > 0.0, largest, 1.0)
        rows[np.abs(rows) <= _EPSILON] = 0.0  # roundings
        lengths = np.sqrt((rows * rows).sum(axis=0))
        lengths = np.where(lengths > 0.0, lengths, 1.0)
        sizes = np.linalg.svd(rows / lengths, compute_uv=False)
        rank = int((sizes > DEPENDENT * sizes.max(initial=0.0)).sum())
        return BalancedEffects(rows / lengths, lengths, rank)


def keepable(system: TrimSystem, condition: TrimCondition) -> list[str]:
    """Return the unknowns that a trim may keep at their start values, if the equations do not
    determine them: states, and outputs in their place, that the user did not set free by name.

    condition: condition as given
    """
    model = system.model
    # Bank and body rates of a turn that was guessed are no declaration.
    roles = recognized(model.states)
    turning = [roles[role] for role in ("phi", "q", "r") if role in roles]
    starts = system.declared
    guessed = [name for name in turning if starts.get(name) != model.states[name].start]
    others = {*model.inputs, *condition.set_free, *guessed}
    return [name for name in system.equations.unknowns if name not in others]


class Undetermined(NamedTuple):
    """Unknowns that can change together while the equations remain balanced.

    names: the unknowns, the one that moves farthest for its size first
    to_hold: how many of them must be held for a unique trim
    """

    names: list[str]
    to_hold: int


def undetermined(problem: TrimProblem, z: np.ndarray) -> Undetermined:
    """Return the unknowns that the equations do not determine at a trim.

    z: trim, (k,)
    """
    effects = problem.balanced_effects(z)
    if effects.rank == len(z):
        return Undetermined([], 0)
    # Directions along which the scaled unknowns change no equation, (d, k).
    directions = np.linalg.svd(effects.matrix)[2][effects.rank :] / effects.lengths
    basis, _ = np.linalg.qr(directions.T)
    movements = np.linalg.norm(basis, axis=1)  # largest part of each unknown in a unit direction
    # Unknowns that move alike to seven digits, as `DEPENDENT`, keep the order of the model.
    order = np.argsort(-np.round(movements, 7), kind="stable")
    names = [problem.free[i] for i in order if movements[i] > DEPENDENT]
    return Undetermined(names, len(directions))
