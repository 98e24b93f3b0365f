"""Normal form of a discrete-time game, and the equivalent continuous-time game.

Both games have the same solution X of the Riccati equation.
"""

from __future__ import annotations

import math
import warnings
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from controller.discrete.feedthrough import without_feedthrough
from controller.game.discrete_game import DiscreteGame
from controller.riccati.balancing import largest, units_of
from controller.riccati.careful_derivations import ROUNDING
from controller.riccati.double_double import add, exact, product, transposed
from controller.riccati.frequency_response import square_root
from controller.riccati.normal_form import NormalForm, similar
from hfa_support.errors import NoSolutionError

#: Largest number of Newton steps after the Schur form.
REFINEMENTS = 8


#: A gain that exceeds δ by this relative amount is not due to rounding.
SHOWN = 1e-6


class NoValueError(NoSolutionError):
    """Raised if a game has no value, because a disturbance has a gain above δ."""


class Policies(NamedTuple):
    """Gains of both players in normal form.

    K: gain of the input, u = -K y, (m, n)
    L: gain of the disturbance, w = L y, (k, n)
    """

    K: np.ndarray
    L: np.ndarray


class NewtonStep(NamedTuple):
    """Newton step of the discrete-time Riccati equation at X.

    F is the closed loop of both policies.

    residual: Q + K'K - L'L + F'X F - X, (n, n), in which errors of K and L are of second order
    correction: Z, the solution of Z = F'Z F + residual, (n, n)
    """

    residual: np.ndarray
    correction: np.ndarray


@dataclass(frozen=True, eq=False)
class StepForm(NormalForm):
    """Discrete-time Riccati equation of a game in normal form, in the coordinates y = T x.

      X = Q + A'X A - A'X G (W + G'X G)⁻¹ G'X A,  G = [B E],  W = blkdiag(I, -I)

    low: rounding error of A, (n, n). The error matters for fast sampling, because A is then nearly
        I.
    """

    low: np.ndarray

    @classmethod
    def of_problem(cls, problem: DiscreteGame) -> StepForm:
        """Return the normal form of a game.

        The discount and the cross weights are included in the matrices of the form. The form is
        balanced if the equivalent continuous-time game exists.
        """
        form = cls.unbalanced(problem)
        with suppress(NoSolutionError):  # the solver reports this error
            game = form.with_delta(math.inf).equivalent
            return form._scaled(1.0 / units_of(game.A, game.S, game.Q))
        return form

    @classmethod
    def unbalanced(cls, problem: DiscreteGame) -> StepForm:
        """Return the normal form of a game without balancing."""
        step = problem.step.without_cross_weights
        root = math.sqrt(problem.discount)
        rounded_off = float(Fraction(problem.discount) - Fraction(root) ** 2) / (2.0 * root)
        one = np.eye(len(step.A))
        A, low = product((step.A, problem.A_low), (root * one, rounded_off * one))
        form = NormalForm.of(replace(step, A=A, B=root * step.B, E=root * step.E))
        units = np.diag(form.T)
        return cls(
            A=form.A,
            inputs=form.inputs,
            disturbance=form.disturbance,
            Q=form.Q,
            T=form.T,
            root=form.root,
            delta=form.delta,
            R=form.R,
            low=low * units[:, None] / units,
        )

    def _scaled(self, D: np.ndarray) -> Self:
        """Return the game in the coordinates D y, without rounding."""
        factors = D[:, None] / D
        return replace(
            self,
            A=self.A * factors,
            low=self.low * factors,
            inputs=self.inputs * D[:, None],
            disturbance=self.disturbance * D[:, None],
            Q=self.Q / np.outer(D, D),
            T=self.T * D[:, None],
        )

    def _turned_by(self, W: np.ndarray, D: np.ndarray) -> Self:
        """Return the game in the coordinates D W'y, with A in twice the digits."""
        A, low = similar((self.A, self.low), W, D)
        return replace(super()._turned_by(W, D), A=A, low=low)

    @cached_property
    def hamiltonian(self) -> np.ndarray:
        """Hamiltonian of the equivalent continuous-time game, (2n, 2n)."""
        return self.equivalent.hamiltonian

    @cached_property
    def equivalent(self) -> NormalForm:
        """Continuous-time game with the same X.

        The state of this game is (y + y⁺)/√2, and the rate is (y⁺ - y)/√2. This is the map
        z = (1 + s)/(1 - s). In both games, the value y'X y increases by y⁺'X y⁺ - y'X y.

        For signals of alternating sign, the step has the matrices -A, -B and -E and the same X.
        These matrices give a second equivalent game. The game with the smaller Hamiltonian is used,
        because none of its modes is near the pole of the map, z = -1 or 1.

        Raises NoSolutionError if every closed loop has modes at both poles. Raises NoValueError if
        a disturbance of constant or alternating sign has a gain above δ for every input.
        """
        games = []
        for sign in (1.0, -1.0):
            try:
                games.append(self._at_pole(sign))
            except np.linalg.LinAlgError:
                continue
        if not games:
            raise NoSolutionError(
                "every closed loop has modes at z = 1 and z = -1, so no policy stabilizes the "
                "plant; change A or B"
            )
        return _of_rates_near_one(min(games, key=_size))

    def _at_pole(self, sign: float) -> NormalForm:
        """Return the equivalent continuous-time game by the map with its pole at z = -sign."""
        # Let r = √2 ξ - E w, with the new state ξ. Then (A + I) y + B u = r, with A, B and E
        # multiplied by `sign`. All solutions are [u; y] = Y r + Z v. The smallest |u|² + |C y|² of
        # a solution, with C'C = Q, is |M r|². The new input is the part that v adds to this cost.
        n = len(self.A)
        m = self.B.shape[1]
        A = sign * self.A, sign * self.low
        B = sign * self.B
        E = sign * self.disturbance
        total = np.hstack([B, add(A, exact(np.eye(n)))[0]])
        moved = np.hstack([B, add(A, exact(-np.eye(n)))[0]])
        basis, triangle = np.linalg.qr(total.T, mode="complete")
        Y = basis[:, :n] @ np.linalg.inv(triangle[:n].T)
        Z = basis[:, n:]
        weights = np.eye(m + n)
        weights[m:, m:] = square_root(self.Q)
        spanned, root = np.linalg.qr(weights @ Z, mode="complete")
        by_input = np.linalg.solve(root[:m].T, Z.T).T
        cost = spanned.T @ weights @ Y
        M = cost[m:]
        gain = float(np.linalg.norm(M @ E, 2)) if E.size else 0.0
        if gain > self.delta * (1.0 + SHOWN):
            kind = "alternating" if sign > 0.0 else "constant"
            raise NoValueError(
                f"for every input, a disturbance of {kind} sign has a gain of at least {gain:.6g}"
            )
        rates = moved @ (Y - by_input @ cost[:m])
        loop, disturbance, Q = without_feedthrough(
            rates, (E - rates @ E) / math.sqrt(2.0), math.sqrt(2.0) * M, -M @ E, self.delta
        )
        return NormalForm(
            A=loop,
            inputs=moved @ by_input / math.sqrt(2.0),
            disturbance=disturbance,
            Q=(Q + Q.T) / 2.0,
            T=self.T,
            root=np.eye(m),
            delta=self.delta,
            R=np.eye(m),
        )

    def policies(self, X: np.ndarray) -> Policies:
        """Return the gains [K; -L] = (W + G'X G)⁻¹ G'X A of the policies for the value X."""
        m = self.B.shape[1]
        G = np.hstack([self.B, self.E])
        gains = np.linalg.solve(np.diag(self._signs) + G.T @ X @ G, G.T @ X @ self.A)
        return Policies(gains[:m], -gains[m:])

    @property
    def _signs(self) -> np.ndarray:
        """Diagonal of W = blkdiag(I, -I), (m + k,)."""
        return np.repeat([1.0, -1.0], [self.B.shape[1], self.E.shape[1]])

    def gain(self, X: np.ndarray) -> np.ndarray:
        """Return the gain K (m, n) of u = -K x in the user's coordinates, for the solution X."""
        return np.linalg.solve(self.root.T, self.policies(X).K @ self.T)

    def disturbance_gain(self, X: np.ndarray) -> np.ndarray:
        """Return the gain L (k, n) of the worst disturbance w = L x, for the solution X.

        L is in the user's coordinates.
        """
        return self.policies(X).L @ self.T / self.delta

    def newton_step(self, X: np.ndarray) -> NewtonStep:
        """Return the Newton step at X, with the residual computed in twice the digits."""
        from scipy.linalg import solve_discrete_lyapunov

        gains = self.policies(X)
        G = np.hstack([self.B, self.E])
        both = np.vstack([gains.K, -gains.L])
        F = add((self.A, self.low), product(exact(-G), exact(both)))
        paid = product(exact(both.T * self._signs), exact(both))
        total = add(add(exact(self.Q), exact(-X)), paid)
        total = add(total, product(transposed(F), product(exact(X), F)))
        residual = np.asarray(total[0])
        with warnings.catch_warnings(action="ignore"):  # near the unit circle; checked
            Z = solve_discrete_lyapunov(F[0].T, (residual + residual.T) / 2.0)
        return NewtonStep(residual, np.asarray(Z + Z.T) / 2.0)

    def refined(self, X: np.ndarray) -> np.ndarray:
        """Return X after at most `REFINEMENTS` Newton steps.

        The steps end when the correction is as small as rounding.
        """
        for _ in range(REFINEMENTS):
            correction = self.newton_step(X).correction
            X = X + correction
            if float(largest(correction)) <= ROUNDING * float(largest(X)):
                break
        return X


def _size(form: NormalForm) -> float:
    """Return the Frobenius norm of the Hamiltonian of a game, or 1 if the norm is 0."""
    return float(np.linalg.norm(form.hamiltonian)) or 1.0


def _of_rates_near_one(form: NormalForm) -> NormalForm:
    """Return a continuous-time game in a unit of time in which its rates are near 1."""
    # With fast sampling, the rates would otherwise be very small. The unit is the old unit times a
    # power of four.
    root = 2.0 ** -round(math.log(_size(form), 4.0))
    return replace(
        form,
        A=form.A * root**2,
        inputs=form.inputs * root,
        disturbance=form.disturbance * root,
        Q=form.Q * root**2,
    )
