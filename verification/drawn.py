"""Spread of a trim, a linear model and a closed loop over aircraft with drawn parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.cost import cost_above_optimum
from controller.riccati.gare import unconfirmed_solution
from hfa_aircraft.model import Model
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress, with_progress
from hfa_support.reporting.results import Result, given
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition
from trim.point.linearize import linearize
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, trim

#: Percentiles at the ends of a 95 % band.
_BAND = (2.5, 97.5)


@dataclass(frozen=True)
class Band(Result):
    """Interval that contains 95 % of the drawn aircraft.

    value: value of the aircraft with the given parameters.
    low: 2.5th percentile.
    high: 97.5th percentile.
    unit: unit of `value`, `low` and `high`.
    """

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, eq=False)
class Draws(Result):
    """Result for aircraft with drawn parameters.

    count: number of aircraft.
    seed: seed of the draws.
    parameters: names of the drawn parameters.
    trimmed: number of aircraft that have a trim within their limits.
    stable: number of aircraft whose linear model the gain stabilizes, or None without a gain.
    stable_alone: number of aircraft whose linear model is stable without control, or None with a
        gain.
    cost_lost_worst_percent: largest excess of the gain's cost over the optimum of an aircraft's
        linear model, percent, inf if a loop is unstable, NaN if no game has a solution, or None
        without a gain.
    bands: quantity -> its band.
    unsolved: number of aircraft whose game has no solution, or None without a gain.
    """

    count: int
    seed: int
    parameters: tuple[str, ...]
    trimmed: int
    stable: int | None
    cost_lost_worst_percent: float | None
    bands: Mapping[str, Band]
    unsolved: int | None = None
    stable_alone: int | None = None

    @property
    def ok(self) -> bool:
        """True if every aircraft has a trim and the gain, if any, stabilizes every aircraft."""
        return self.trimmed == self.count and self.stable in (None, self.count)

    @property
    def first_line(self) -> str:
        """One line on the drawn aircraft, for the report.

        - Without a gain: the numbers of trimmed aircraft and of aircraft stable without control.
        - With a gain, if an aircraft has no trim: the numbers of trimmed aircraft and of stable
          loops.
        - Otherwise: the number of stable loops, the number of aircraft whose game has no solution,
          if any, and the largest excess cost, if finite.
        """
        aircraft = f"of {self.count} drawn aircraft"
        if self.stable is None:
            return (
                f"trimmed: {self.trimmed} {aircraft}; stable without control: {self.stable_alone}"
            )
        if self.trimmed < self.count:
            return f"trimmed: {self.trimmed} {aircraft}; linear loop stable for {self.stable}"
        line = f"linear loop stable for {self.stable} {aircraft}"
        cost = self.cost_lost_worst_percent
        if self.unsolved:
            line += f"; the game has no solution on {self.unsolved}"
        if cost is not None and np.isfinite(cost):
            others = " on the others" if self.unsolved else ""
            line += f"; cost at most {cost:.2g} % above the optimum{others}"
        return line

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "count": self.count,
            "seed": self.seed,
            "parameters": self.parameters,
            "trimmed": self.trimmed,
            "bands": self.bands,
            "ok": self.ok,
            "first_line": self.first_line,
        } | given(
            stable=self.stable,
            cost_lost_worst_percent=self.cost_lost_worst_percent,
            unsolved=self.unsolved,
            stable_alone=self.stable_alone,
        )


@dataclass(frozen=True, eq=False)
class WithDraws(Result):
    """Field that `--draws N` adds to a result.

    draws: result for aircraft with drawn parameters, or None without `--draws`.
    """

    draws: Draws | None = None


@dataclass(frozen=True, eq=False)
class DrawnAircraft:
    """Aircraft with drawn parameters, with the trim condition of the given aircraft.

    models: the drawn aircraft.
    parameters: names of the drawn parameters.
    seed: seed of the draws.
    condition: trim condition of all aircraft.
    point: trim of the given aircraft.
    """

    models: Sequence[Model]
    parameters: tuple[str, ...]
    seed: int
    condition: TrimCondition
    point: OperatingPoint

    def points(self, progress: Progress | None = None) -> list[OperatingPoint]:
        """Return the trims of the drawn aircraft, without aircraft that have no trim."""
        found = []
        for model in with_progress(self.models, progress):
            try:
                found.append(trim(model, self.condition, self.point))
            except TrimError:
                continue
        return found

    def trims(self, progress: Progress | None = None) -> Draws:
        """Return the bands of the trim's free quantities, and the stability without control."""
        points = self.points(progress)
        model = self.point.model
        names = [name for name in self.point.values if name not in self.condition.imposed]
        bands = {
            name: band_of(self.point[name], [point[name] for point in points], model.unit(name))
            for name in names
        }
        drawn = [linearize(point.model, point) for point in points]
        return self._alone(bands, drawn)

    def gain(self, game: Game, K: np.ndarray, progress: Progress | None = None) -> Draws:
        """Return the stability and the largest excess cost of u = -K z on the drawn aircraft.

        game: game of the given aircraft. The drawn aircraft have the same weights
        K: gain, (m, n)
        """
        linear_models = [linearize(each.model, each) for each in self.points(progress)]
        costs = []
        unsolved = 0
        for linear in linear_models:
            drawn = replace(game, A=linear.A, B=linear.B)
            try:
                solution = unconfirmed_solution(drawn)
            except NoSolutionError:
                unsolved += 1
                continue
            is_stable = _abscissa(linear.A - linear.B @ K) < 0.0
            costs.append(cost_above_optimum(drawn, solution, K)[0] if is_stable else np.inf)
        found = self._loops(K, _abscissa(game.A - game.B @ K), linear_models)
        worst = 100.0 * max(costs, default=np.nan)
        return replace(found, cost_lost_worst_percent=worst, unsolved=unsolved)

    def loops(self, K: np.ndarray, progress: Progress | None = None) -> Draws:
        """Return the result for the loops u = -K z of the drawn aircraft, without excess costs.

        K: gain, (m, n)
        """
        drawn = [linearize(each.model, each) for each in self.points(progress)]
        itself = linearize(self.point.model, self.point)
        return self._loops(K, _abscissa(itself.A - itself.B @ K), drawn)

    def _loops(self, K: np.ndarray, own: float, drawn: Sequence[LinearModel]) -> Draws:
        """Return the number of stable loops A - B K, and the band of the largest real part."""
        slowest = [_abscissa(each.A - each.B @ K) for each in drawn]
        bands = {"abscissa of the loop": band_of(own, slowest, "1/s")}
        stable = sum(each < 0.0 for each in slowest)
        return replace(self._draws(len(drawn), bands), stable=stable)

    def _alone(self, bands: Mapping[str, Band], drawn: Sequence[LinearModel]) -> Draws:
        """Return the result without a gain, with the number of stable linear models."""
        stable = sum(_abscissa(each.A) < 0.0 for each in drawn)
        return replace(self._draws(len(drawn), bands), stable_alone=stable)

    def _draws(self, trimmed: int, bands: Mapping[str, Band]) -> Draws:
        """Return a result with these bands and without counts of stable aircraft."""
        return Draws(len(self.models), self.seed, self.parameters, trimmed, None, None, bands)


def _abscissa(A: np.ndarray) -> float:
    """Return the largest real part of the eigenvalues of A."""
    return float(np.linalg.eigvals(A).real.max())


def band_of(value: float, values: Sequence[float], unit: str) -> Band:
    """Return the band that contains 95 % of the drawn values, with ends NaN if there are no values.

    value: value of the given aircraft
    """
    low, high = np.percentile(values, _BAND).tolist() if values else (np.nan, np.nan)
    return Band(float(value), low, high, unit)
