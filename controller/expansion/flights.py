"""Cost of flights of the nonlinear aircraft under the policies of both players."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from controller.expansion.expansion import Expansion
from hfa_aircraft.batch_simulation import (
    FAR_OF_EXPANSION,
    OF_EXPANSION,
    Cost,
    History,
    Rows,
    has_decayed,
    march,
)
from hfa_support.matrices import quadratic_forms
from hfa_support.native.bound import RowFunction
from hfa_support.native.row_code import machine_code

#: Step times the magnitude of the fastest eigenvalue of the loop.
_STEP = 0.2
#: A flight that has not ended after this many time constants of the slowest mode does not converge.
_LONGEST = 6.0
#: Number of steps between two tests of the end.
TESTED = 10
#: Function of rows, with a list of one array of rows.
RateOfRows = Callable[[np.ndarray], list[np.ndarray]]


class Flights:
    """Simulated flights z' = F(z, u) + E d of both players of an expansion, by Runge-Kutta steps.

    The cost ∫ z'Qz + 2z'Nu + u'Ru - δ² d'd dt is integrated with the state.

    step: step of the integration, s; the relative error of a cost is about 1e-4
    longest: time after which a flight that still lasts does not converge, s
    """

    def __init__(self, expansion: Expansion) -> None:
        """Compile the rates of the state and of the cost, and choose the step.

        expansion: value and policies of both players
        """
        game = expansion.game
        self.expansion = expansion
        self.step, self.longest = scales_of_time(game.worst_case_loop(expansion.solution.P))
        z = ca.SX.sym("z", expansion.states)
        u = expansion.policy(z)
        rates = expansion.rates(z, u)
        cost = Cost(game.Q, game.R, game.N).rate(z, u)
        if np.isfinite(game.delta):
            d = expansion.disturbance(z)
            rates += ca.DM(game.E) @ d
            cost -= game.delta**2 * ca.dot(d, d)
        both = ca.densify(ca.vertcat(rates, cost))
        self._rates = RowFunction(machine_code(ca.Function("rates", [z], [both])))
        self._V = RowFunction(expansion.V)

    def costs(self, z0: np.ndarray) -> np.ndarray:
        """Return the cost of the flights from N initial states, (N,), inf if one does not converge.

        z0: (N, n), initial deviations from the trim
        """
        ticks = (1 + int(self.longest / self.step)) // TESTED
        P = self.expansion.solution.P
        final, ended = flown_until_decayed(self._rates, z0, P, self.step, ticks)
        costs = np.full(len(z0), np.inf)
        if ended.any():
            cost_after_end = self._V(final[ended, :-1])[0][:, 0]
            costs[ended] = final[ended, -1] + cost_after_end
        return costs


def scales_of_time(loop: np.ndarray) -> tuple[float, float]:
    """Return the step and the longest duration of flights about a stable loop z' = loop z, s."""
    eigenvalues = np.linalg.eigvals(loop)
    return _STEP / float(np.abs(eigenvalues).max()), _LONGEST / float(-eigenvalues.real.max())


def flown_until_decayed(
    rates: RateOfRows, z0: np.ndarray, P: np.ndarray, step: float, ticks: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the last states and costs of flights, (N, n + 1), and whether z'Pz has decayed, (N,).

    rates: rows (N, n) of states -> rows (N, n + 1) of their rates and of the rate of the cost
    z0: initial states, (N, n)
    P: (n, n)
    step: step of the integration, s
    ticks: largest number of intervals of `TESTED` steps
    """
    initial = quadratic_forms(z0, P)

    def over(flown: History) -> np.ndarray:
        """Return the mask of the flights whose z'Pz has decayed or is far, at the last step."""
        z_now = flown.states[:, -1, :-1]  # without the cost
        value = quadratic_forms(z_now, P)
        first = initial[flown.flights]
        mask = np.zeros(flown.states.shape[:2], dtype=bool)
        is_far = ~(value <= FAR_OF_EXPANSION * first)  # so is a nan
        mask[:, -1] = has_decayed(value, first, OF_EXPANSION) | is_far
        return mask

    starts = np.column_stack([z0, np.zeros(len(z0))])
    loop = Rows(lambda w: rates(w[:, :-1])[0], starts, step, TESTED)
    with np.errstate(all="ignore"):
        flown, _ = march(loop, ticks, over=over, keep=False)
        final = flown.states[:, 0]
        return final, has_decayed(quadratic_forms(final[:, :-1], P), initial, OF_EXPANSION)
