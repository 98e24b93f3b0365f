"""A Kalman filter in NumPy, for comparison with `hfa.filter`."""

import casadi as ca
import numpy as np
from scipy.linalg import expm, solve_discrete_lyapunov


class Recursion:
    """Extended Kalman filter in NumPy, with the covariances by Joseph's form. It uses the values of a
    sample one after the other.

    P decides whether a value is possible. The gains are those of G, which in samples without a usable
    value is updated as if all were used. Commands are faded in over a second.
    """

    def __init__(self, kalman):
        self.kalman, self.x, self.P, self.G = kalman, np.zeros(9), kalman.P, kalman.P
        self.share = self.in_a_row = self.samples = self.left_out = 0
        model = kalman.point.model
        self.last, self.trim = np.full(6, np.nan), kalman.point.x[model.state_places(kalman.states)]
        self.climate = solve_discrete_lyapunov(kalman.Phi[6:, 6:], kalman.air[6:, 6:])
        X, u, w = (ca.SX.sym("x", size) for size in (7, 5, 2))
        of_wind = dict(zip(kalman.winds, ca.vertsplit(w), strict=True))
        winds = [of_wind.get(name, 0.0) for name in model.disturbances]
        vectors = [ca.vertsplit(vector) for vector in (X, u, ca.SX(ca.DM(model.p)))]
        rates = model.layout.expressions(vectors, (), winds)[0]
        self.rates = ca.Function("rates", [X, u, w], [rates])
        slopes = [ca.jacobian(rates, X), ca.jacobian(rates, w)]
        self.slopes = ca.Function("slopes", [X, u, w], slopes)

    @staticmethod
    def after(P, L, c, r):
        kept = np.eye(len(P)) - np.outer(L, c)
        return kept @ P @ kept.T + r * np.outer(L, L)

    def winds(self):
        return self.kalman.W @ self.x[6:]

    def seen(self):
        """Return what a policy sees: the speed along the horizontal path, and alpha in the air."""
        V, alpha, pitch = (self.x[:6] + self.trim)[:3]
        headwind, updraft = self.winds()
        forward, up = V * np.cos(pitch - alpha), V * np.sin(pitch - alpha)
        in_air = pitch - np.arctan2(up - updraft, forward + headwind)
        return np.hstack([forward - self.trim[0], in_air - self.trim[1], self.x[2:6]])

    def predict(self, u):
        """Move the estimate by a sample, one Runge-Kutta step with winds that stay."""
        kalman, rows, w = self.kalman, [0, 1, 3, 4, 5, 6], self.winds()
        X, U = kalman.point.x, kalman.point.u + u
        X[rows] += self.x[:6]
        A_x, A_w = (slope.full() for slope in self.slopes(X, U, w))
        A = np.zeros((9, 9))
        A[:6, :6], A[:6, 6:], A[6:, 6:] = (
            A_x[np.ix_(rows, rows)],
            A_w[rows] @ kalman.W,
            kalman.A[6:, 6:],
        )

        def rate(X):
            return self.rates(X, U, w).full().ravel()

        k1 = rate(X)
        k2 = rate(X + 0.005 * k1)
        k3 = rate(X + 0.005 * k2)
        X = X + 0.01 / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rate(X + 0.01 * k3))
        Phi = expm(0.01 * A)
        self.x = np.append((X - kalman.point.x)[rows], Phi[6:, 6:] @ self.x[6:])
        self.P, self.G = (Phi @ covariance @ Phi.T + kalman.Q for covariance in (self.P, self.G))

    def __call__(self, y, u_of):
        C, R = self.kalman.C, self.kalman.R
        away = np.abs(y - self.trim - C @ self.x)
        finite = np.isfinite(y) & (y != self.last)
        self.last = np.where(np.isfinite(y), y, self.last)
        used = finite & (away <= 8.0 * np.sqrt(np.diag(C @ self.P @ C.T + R)))
        impossible = finite & ~used
        if impossible.any():
            self.in_a_row += 1
        elif finite.any():
            self.in_a_row = 0
        most = self.in_a_row >= 10 and 2 * impossible.sum() > finite.sum()
        begins = not self.samples or (impossible.any() and (self.samples == 1 or most))
        if begins:
            self.in_a_row, self.share = 0, 0.0
            self.x, self.P = np.append(self.x[:6], np.zeros(3)), self.P.copy()
            self.x[:6][finite] = (y - self.trim)[finite]
            with_updraft = self.climate @ self.kalman.W[1]
            updraft = -self.trim[0] * self.x[1]  # in which alpha is that of the trim
            self.x[6:] = updraft * with_updraft / (self.kalman.W[1] @ with_updraft)
            rows = [*np.flatnonzero(finite), 6, 7, 8]
            self.P[rows], self.P[:, rows] = 0.0, 0.0
            self.P[:6, :6][finite, finite] = np.diag(R)[finite]
            self.P[6:, 6:] = self.climate
            self.G = self.P
        else:
            self.share = min(self.share + 0.01, 1.0)
            self.left_out += not used.all()
            for j in range(6):
                L = self.G @ C[j] / (C[j] @ self.G @ C[j] + R[j, j])
                if used[j] or not used.any():
                    self.G = self.after(self.G, L, C[j], R[j, j])
                if used[j]:
                    self.x = self.x + L * (y[j] - self.trim[j] - C[j] @ self.x)
                    self.P = self.after(self.P, L, C[j], R[j, j])
        self.samples += 1
        u = u_of(self.seen(), self.share)
        self.predict(u)
        return u
