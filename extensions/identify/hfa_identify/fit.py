"""Maximum likelihood estimation by output error: parameters, initial states and noise of records.

With residuals v = z - y(θ, x₀) and a noise variance r of each measured quantity, the likelihood is
largest where

    L = ½ Σ N ln(Σ v² / N) + ½ Σ ((x₀ - guess) / (10 nominal))²

is least. The sums are over quantities, with r = Σ v² / N. The second term keeps initial states that
no sample determines near their guess. The factor 10 applies to measured states. It is 1 for other
states that a trim balances, and 1e-6 for the remaining states.

Gauss-Newton steps use exact sensitivities. A step that does not lower L is damped by Levenberg's
rule. The initial state of each record is eliminated from the normal equations.

Source: R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., 2015, chapter 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from hfa_aircraft.model import Model
from hfa_identify.records import Record
from hfa_identify.response import Response, Responses, Simulation

#: Standard deviations of the guess of an initial state, in nominal values: _MEASURED for a measured
#: state, 1 for another, and _HELD for one that a trim does not balance (altitude, heading).
_MEASURED = 10.0
_HELD = 1e-6
#: The search converges if the parameters move by less than this fraction of their standard
#: deviations.
SMALL = 1e-3
#: If no step lowers L, the search has still converged if the undamped step is smaller.
_STUCK = 0.05
#: A decrease of L below this value may be a rounding error and is not counted.
_NO_GAIN = 1e-6
MOST_STEPS = 30
#: An unknown is kept constant if its range is smaller than this fraction of its standard deviation.
_LOOSE = 0.1
#: Step of the parameters (p,), and of each initial state (n,).
Step: TypeAlias = tuple[np.ndarray, list[np.ndarray]]
#: Trials of a step, in this order: damping, and fraction of the step that is made.
_TRIALS = (
    (0.0, 1.0), (0.0, 0.5), (0.0, 0.25), (1e-4, 1.0), (1e-3, 1.0), (1e-2, 1.0), (1e-1, 1.0),
    (1.0, 1.0), (1e1, 1.0), (1e2, 1.0), (1e3, 1.0), (1e4, 1.0),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations [M B; B' A] [Δθ; Δx₀] = [g; h] of one record.

    Δθ and Δx₀ are the changes of the parameters and of the initial state.

    M: (p, p)
    B: (p, n)
    A: (n, n)
    g: right-hand side for the parameters, (p,)
    h: right-hand side for the initial state, (n,)
    prior: reciprocal variances of the guess of the initial state, which A contains, (n,)
    """

    M: np.ndarray
    B: np.ndarray
    A: np.ndarray
    g: np.ndarray
    h: np.ndarray
    prior: np.ndarray

    @cached_property
    def of_start(self) -> np.ndarray:
        """Covariance (n, n) of the initial state if the parameters are known."""
        return inverse(self.A)

    @property
    def determined(self) -> float:
        """Number of initial states that the record determines, n - tr(A⁻¹ diag(prior))."""
        return len(self.prior) - float(np.diag(self.of_start) @ self.prior)

    @property
    def information(self) -> np.ndarray:
        """Fisher information (p, p) of the parameters if the initial state is unknown."""
        part = self.M - self.B @ self.of_start @ self.B.T
        return np.asarray(0.5 * (part + part.T))


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters and initial states fitted to records, with the simulations.

    theta: unknowns, (p,).
    starts: state at the first sample of each record, (n,) each.
    noise: noise variances of the measured quantities, (k,).
    residuals: (N, k) for each record, 0 for a missing sample.
    present: (N, k) for each record, False for a missing sample.
    simulated: simulation of each record.
    likelihood: L, as defined in this module.
    steps: number of Gauss-Newton steps.
    converged: whether the search converged.
    search: the search that found the fit and computes its sensitivities.
    """

    theta: np.ndarray
    starts: tuple[np.ndarray, ...]
    noise: np.ndarray
    residuals: tuple[np.ndarray, ...]
    present: tuple[np.ndarray, ...]
    simulated: tuple[Simulation, ...]
    likelihood: float
    steps: int
    converged: bool
    search: OutputError

    @cached_property
    def responses(self) -> tuple[Response, ...]:
        """The simulated quantities of each record with their sensitivities.

        Raises FloatingPointError if a sensitivity is not finite.
        """
        slopes = self.search.responses.slopes
        return tuple(Response(each.y, slopes(each)) for each in self.simulated)

    @cached_property
    def normals(self) -> tuple[Normal, ...]:
        """The normal equations of each record.

        Raises FloatingPointError if they are not finite.
        """
        return self.search.normals(self)

    @cached_property
    def information(self) -> np.ndarray:
        """Fisher information (p, p) of the parameters if the initial states are unknown."""
        return np.sum([each.information for each in self.normals], axis=0)

    @cached_property
    def projected(self) -> tuple[np.ndarray, ...]:
        """Sensitivities to the parameters, (N, k, p) for each record.

        The part that a change of the initial state explains is subtracted.
        """
        p = len(self.theta)
        return tuple(
            self.beyond_start(number, response.slopes[:, :, :p])
            for number, response in enumerate(self.responses)
        )

    def weights(self, number: int) -> np.ndarray:
        """Return the reciprocal noise variances, 0 for a missing sample, (N, k).

        number: index of the record
        """
        return np.where(self.present[number], 1.0 / self.noise, 0.0)

    def beyond_start(self, number: int, slopes: np.ndarray) -> np.ndarray:
        """Return sensitivities without the part that a change of the initial state explains.

        number: index of the record
        slopes: sensitivities, (N, k, c)
        """
        by_start = self.responses[number].slopes[:, :, len(self.theta) :]
        weighted = by_start * self.weights(number)[:, :, None]
        of_start = self.normals[number].of_start
        return np.asarray(
            slopes - by_start @ (of_start @ np.tensordot(weighted, slopes, ((0, 1), (0, 1))))
        )

    @cached_property
    def samples(self) -> np.ndarray:
        """Number of samples of each measured quantity in all records, (k,)."""
        return np.asarray(sum(flags.sum(axis=0) for flags in self.present))


class OutputError:
    """Search for the parameters and initial states that fit records best.

    bounds: limits of the unknowns, (p, 2).
    guesses: guess of each record's initial state, (n,) each.
    least: least noise variance of each quantity, (k,).
    """

    def __init__(
        self,
        responses: Responses,
        records: Sequence[Record],
        guesses: Sequence[np.ndarray],
    ) -> None:
        self.responses = responses
        self.records = tuple(records)
        signals = responses.signals.values()
        self.bounds = np.array([(each.min, each.max) for each in signals])
        self._begin = np.array([each.start for each in signals])
        self.guesses = tuple(guesses)
        self._priors = tuple(_start_weights(responses.model, record) for record in self.records)
        tables = [record.table(responses.measured) for record in self.records]
        self._present = tuple(np.isfinite(table) for table in tables)
        self._measured = tuple(
            np.where(flags, table, 0.0) for flags, table in zip(self._present, tables, strict=True)
        )
        self._counts = sum(flags.sum(axis=0) for flags in self._present)
        sizes = [responses.model.signals[name].nominal for name in responses.measured]
        self.least = (1e-9 * np.array(sizes)) ** 2

    def fit(self, progress: Callable[[float, float], None] | None = None) -> Fit:
        """Return the fit with the least L that Gauss-Newton steps reach from the start values.

        Raises FloatingPointError if the first simulation diverges or its sensitivities are not
        finite.
        """
        found = self.at(self._begin, self.guesses)
        level = 0
        for step in range(1, MOST_STEPS + 1):
            if progress is not None:
                progress(step, MOST_STEPS)
            undamped = self._solved(found, 0.0)
            change = undamped[0]
            size = math.sqrt(max(change @ found.information @ change / len(change), 0.0))
            level, lower = self._lowered(found, undamped, max(0, level - 1), step)
            if lower is None:
                return replace(found, converged=bool(size < _STUCK))
            is_stuck = size < _STUCK and found.likelihood - lower.likelihood < _NO_GAIN
            found = lower
            if size < SMALL or is_stuck:
                return replace(found, converged=True)
        return found

    def _lowered(self, found: Fit, undamped: Step, first: int, step: int) -> tuple[int, Fit | None]:
        """Return the index and the fit of the first Gauss-Newton trial that does not raise L."""
        # Each trial, an entry of `_TRIALS`, contains a damping of the normal equations and a factor
        # on the step. The fit is None if every trial raises L or fails.
        for level in range(first, len(_TRIALS)):
            damping, part = _TRIALS[level]
            try:
                change, moves = self._solved(found, damping) if damping else undamped
                low, high = self.bounds.T
                theta = np.clip(found.theta + part * change, low, high)
                starts = [
                    start + part * move for start, move in zip(found.starts, moves, strict=True)
                ]
                lower = self.at(theta, tuple(starts), step)
                if lower.likelihood <= found.likelihood:
                    _ = lower.normals  # a step without finite sensitivities is rejected
                    return level, lower
            except (FloatingPointError, np.linalg.LinAlgError):
                continue
        return len(_TRIALS), None

    def at(self, theta: np.ndarray, starts: tuple[np.ndarray, ...], steps: int = 0) -> Fit:
        """Return the fit object of given parameters and initial states, without a search.

        It contains the simulations and L, and is marked as not converged.

        theta: unknowns, (p,)
        starts: initial state of each record, (n,) each
        steps: number of Gauss-Newton steps so far

        Raises FloatingPointError if the simulation diverges.
        """
        simulated = tuple(
            self.responses.simulated(record, start, theta)
            for record, start in zip(self.records, starts, strict=True)
        )
        residuals = tuple(
            np.where(flags, table - each.y, 0.0)
            for flags, table, each in zip(self._present, self._measured, simulated, strict=True)
        )
        with np.errstate(over="ignore", invalid="ignore"):
            noise = self._noise(residuals)
            likelihood = self._likelihood(residuals, noise, starts)
        if not math.isfinite(likelihood):
            raise FloatingPointError("the simulation diverges")
        return Fit(
            theta, starts, noise, residuals, self._present, simulated, likelihood, steps,
            converged=False, search=self,
        )  # fmt: skip

    def _noise(self, residuals: Sequence[np.ndarray]) -> np.ndarray:
        """Return the variances of the residuals (k,)."""
        squares = sum((each**2).sum(axis=0) for each in residuals)
        return np.asarray(np.maximum(squares / np.maximum(self._counts, 1), self.least))

    def _likelihood(
        self, residuals: Sequence[np.ndarray], noise: np.ndarray, starts: Sequence[np.ndarray]
    ) -> float:
        """Return L, as defined in this module."""
        # residuals (N, k), noise (k,), starts (n,)
        squares = sum((each**2).sum(axis=0) for each in residuals)
        total = 0.5 * float(np.sum(self._counts * (np.log(noise) - 1.0) + squares / noise))
        for start, guess, prior in zip(starts, self.guesses, self._priors, strict=True):
            total += 0.5 * float((start - guess) ** 2 @ prior)
        return total

    def normals(self, fit: Fit) -> tuple[Normal, ...]:
        """Return the normal equations of each record.

        Raises FloatingPointError if they are not finite.
        """
        normals = []
        for number, response in enumerate(fit.responses):
            pull = self._priors[number] * (self.guesses[number] - fit.starts[number])
            residual = fit.residuals[number]
            normals.append(self._normal(number, response.slopes, residual, fit.noise, pull))
        return tuple(normals)

    def _normal(
        self,
        number: int,
        slopes: np.ndarray,
        residual: np.ndarray,
        noise: np.ndarray,
        pull: np.ndarray,
    ) -> Normal:
        """Return the normal equations of a record for known noise variances."""
        # Raises FloatingPointError if they are not finite.
        # slopes (N, k, p + n), residual (N, k), noise (k,), pull (n,)
        p = len(self.responses.free)
        weights = np.where(self._present[number], 1.0 / np.sqrt(noise), 0.0)
        rows = (slopes * weights[:, :, None]).reshape(-1, slopes.shape[2])
        with np.errstate(over="ignore", invalid="ignore"):
            square = rows.T @ rows
            right = rows.T @ (residual * weights).ravel()
        if not (np.isfinite(square).all() and np.isfinite(right).all()):
            raise FloatingPointError("the simulation diverges")
        return Normal(
            M=square[:p, :p],
            B=square[:p, p:],
            A=square[p:, p:] + np.diag(self._priors[number]),
            g=right[:p],
            h=right[p:] + pull,
            prior=self._priors[number],
        )

    def _solved(self, found: Fit, damping: float) -> Step:
        """Return the Gauss-Newton step of the parameters (p,) and initial states (n,) each."""
        # A parameter keeps its value in two cases:
        # - The parameter is at a bound and the step points outward.
        # - The records do not determine the parameter within its bounds.
        p = len(found.theta)
        total = np.zeros((p, p))
        right = np.zeros(p)
        inverses = []
        for normal in found.normals:
            M = normal.M
            of_start = normal.of_start
            if damping:
                M = M + damping * np.diag(np.diag(M))
                with np.errstate(over="ignore", invalid="ignore"):  # such a step is rejected
                    of_start = inverse(normal.A + damping * np.diag(np.diag(normal.A)))
            inverses.append(of_start)
            total += M - normal.B @ of_start @ normal.B.T
            right += normal.g - normal.B @ of_start @ normal.h
        low = (found.theta <= self.bounds[:, 0]) & (right < 0.0)
        high = (found.theta >= self.bounds[:, 1]) & (right > 0.0)
        with np.errstate(invalid="ignore"):  # without information, or without bounds
            loose = np.diag(total) * np.ptp(self.bounds, axis=1) ** 2 < _LOOSE**2
        inside = ~(low | high | loose)
        change = np.zeros(p)
        change[inside] = _solution(total[np.ix_(inside, inside)], right[inside])
        moves = [
            of_start @ (normal.h - normal.B.T @ change)
            for of_start, normal in zip(inverses, found.normals, strict=True)
        ]
        return change, moves


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the pseudoinverse of a symmetric matrix, computed after scaling to a unit diagonal."""
    scaled, size = _with_unit_diagonal(matrix)
    return np.asarray(np.linalg.pinv(scaled, rcond=1e-14, hermitian=True) / size[:, None] / size)


def _with_unit_diagonal(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return S⁻¹ M S⁻¹ of a matrix M, with diag(S)² its diagonal where positive, and diag(S)."""
    diagonal = np.diag(matrix)
    size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return matrix / size[:, None] / size, size


def _start_weights(model: Model, record: Record) -> np.ndarray:
    """Return the reciprocal variances (n,) of the guess of a record's initial state."""
    sizes = []
    for name, signal in model.states.items():
        if name in record.measured:
            size = _MEASURED
        elif name in model.steady:
            size = 1.0
        else:
            size = _HELD
        sizes.append(size * signal.nominal)
    return 1.0 / np.square(sizes)


def _solution(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the least-squares solution x of matrix x = right, after scaling to a unit diagonal."""
    scaled, size = _with_unit_diagonal(matrix)
    return np.linalg.lstsq(scaled, right / size, rcond=1e-13)[0] / size
