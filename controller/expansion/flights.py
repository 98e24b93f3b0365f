"""Cost of flights of the nonlinear aircraft under the policies of both players."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from hfa_aircraft.march.cost import Cost
from hfa_aircraft.march.ending import FAR_OF_EXPANSION, OF_EXPANSION, has_decayed
from hfa_aircraft.march.march import History, Rows, march
from hfa_support.native.bound import RowFunction
from hfa_support.native.machine_code import machine_code

if TYPE_CHECKING:
    from controller.expansion.expansion import Expansion

#: Step times the magnitude of the fastest eigenvalue of the loop.
_STEP = 0.2
#: A flight that has not ended after this many time constants of the slowest mode does not converge.
_LONGEST = 6.0
#: Number of steps between two tests of the end.
_TESTED = 10


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
        loop = np.linalg.eigvals(game.worst_case_loop(expansion.solution.P))
        self.expansion = expansion
        self.step = _STEP / float(np.abs(loop).max())
        self.longest = _LONGEST / float(-loop.real.max())
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
        P = self.expansion.solution.P
        initial = _quadratic(P, z0)

        def over(flown: History) -> np.ndarray:
            value = _quadratic(P, flown.states[:, -1, :-1])
            first = initial[flown.flights]
            mask = np.zeros(flown.states.shape[:2], dtype=bool)
            is_near = value <= FAR_OF_EXPANSION * first
            mask[:, -1] = has_decayed(value, first, OF_EXPANSION) | ~is_near
            return mask

        starts = np.column_stack([z0, np.zeros(len(z0))])
        loop = Rows(lambda w, _: self._rates(w[:, :-1])[0], starts, self.step, steps=_TESTED)
        ticks = (1 + int(self.longest / self.step)) // _TESTED
        with np.errstate(over="ignore", invalid="ignore"):
            flown, _ = march(loop, ticks, over=over, keep=False)
            final = flown.states[:, 0]
            ended = has_decayed(_quadratic(P, final[:, :-1]), initial, OF_EXPANSION)
        costs = np.full(len(z0), np.inf)
        if ended.any():
            final_states, cost_so_far = final[ended, :-1], final[ended, -1]
            cost_after_end = self._V(final_states)[0][:, 0]
            costs[ended] = cost_so_far + cost_after_end
        return costs


def _quadratic(P: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return z'Pz of each row of z, (N,)."""
    return np.einsum("ri,ij,rj->r", z, P, z)
