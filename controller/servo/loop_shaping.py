"""H-infinity loop shaping (McFarlane and Glover) with model following: the controller of one linear
model.

The plant G, with the actuators of the design, is shaped: G_s = W2 G W1, W1 of gains, W2 of k (1 +
c/s)/(1 + τ s). G_s = M⁻¹ N, M M* + N N* = I, is stabilized for all (M + Δ_M)⁻¹ (N + Δ_N), ‖[Δ_N
Δ_M]‖∞ < 1/γ. The commands go through a model of the aircraft under its own optimal law, so that the
loop feels only what the model did not foresee. Sources: McFarlane and Glover, IEEE Trans. Automatic
Control 37 (1992), 759-769; Francis, SIAM J. Control 15 (1977), 486-505."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from controller.riccati.frequency_response import system_gain
from controller.servo.design import Following, OutputWeight
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_most

#: The gain of the robust loop may exceed gamma by this share.
ROUNDING = 1e-6


class Robust(NamedTuple):
    """u = -F x̂, x̂' = A x̂ + B u + H (y - C x̂), F: (m, n), H: (n, p); gamma_min, the smallest γ
    of any controller."""

    F: np.ndarray
    H: np.ndarray
    gamma_min: float
    gamma: float


def robust_controller(A: np.ndarray, B: np.ndarray, C: np.ndarray, factor: float = 1.1) -> Robust:
    """The central controller of γ = factor γ_min, factor > 1, that stabilizes all plants within 1/γ
    of C (sI - A)⁻¹ B.

    With A'X + XA - XBB'X + C'C = 0 and AZ + ZA' - ZC'CZ + BB' = 0: γ_min² = 1 + ρ(XZ), F = B'X, H =
    γ² ((γ² - 1) I - ZX)⁻¹ Z C'. NoSolutionError when a mode that does not decay is not reached or
    not seen."""
    from scipy.linalg import solve_continuous_are

    try:
        X = solve_continuous_are(A, B, C.T @ C, np.eye(B.shape[1]))
        Z = solve_continuous_are(A.T, C.T, B @ B.T, np.eye(len(C)))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError(
            f"the shaped plant has no robust controller: {error}; check inputs and outputs"
        ) from error
    smallest = float(np.sqrt(1.0 + np.abs(np.linalg.eigvals(X @ Z)).max()))
    gamma = factor * smallest
    H = gamma**2 * np.linalg.solve((gamma**2 - 1.0) * np.eye(len(A)) - Z @ X, Z @ C.T)
    return Robust(B.T @ X, H, smallest, gamma)


def robust_check(A: np.ndarray, B: np.ndarray, C: np.ndarray, found: Robust) -> Check:
    """‖[K; I] (I - G K)⁻¹ [I G]‖∞ <= γ and the loop is stable, from the closed loop alone; inf
    where it is not."""
    (n, m), p = B.shape, len(C)
    closed = np.block([[A, -B @ found.F], [found.H @ C, A - B @ found.F - found.H @ C]])
    enters = np.block([[np.zeros((n, p)), B], [found.H, np.zeros((n, m))]])
    leaves = np.block([[np.zeros((m, n)), -found.F], [C, np.zeros((p, n))]])
    at_once = np.block([[np.zeros((m, p + m))], [np.eye(p), np.zeros((p, m))]])
    gain = system_gain(closed, enters, leaves, at_once)
    return at_most(
        "robustness",
        gain,
        (1.0 + ROUNDING) * found.gamma,
        "the loop is less robust than gamma promises",
    )


class Weights(NamedTuple):
    """x' = A x + B y, y_s = C x + D y: the weights of all outputs side by side, and the names of
    x."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]


def output_weights(outputs: Mapping[str, OutputWeight]) -> Weights:
    """k (1 + c/s) / (1 + τ s) of each output: v = y + c e with e' = y where c > 0, then τ x' = v -
    x where τ > 0."""
    names: list[str] = []
    for name, each in outputs.items():
        names += [f"{name}_integral"] * (each.corner > 0.0) + [f"{name}_lag_1"] * (each.lag > 0.0)
    n, p = len(names), len(outputs)
    rates, seen = np.zeros((n, n + p)), np.zeros((p, n + p))
    for row, (name, each) in enumerate(outputs.items()):
        signal = np.eye(n + p)[n + row]
        if each.corner > 0.0:
            integral = names.index(f"{name}_integral")
            rates[integral] = signal
            signal = signal + each.corner * np.eye(n + p)[integral]
        if each.lag > 0.0:
            lagged = np.eye(n + p)[names.index(f"{name}_lag_1")]
            rates[names.index(f"{name}_lag_1")] = (signal - lagged) / each.lag
            signal = lagged
        seen[row] = each.gain * signal
    return Weights(rates[:, :n], rates[:, n:], seen[:, :n], seen[:, n:], tuple(names))


def following_model(
    A: np.ndarray,
    B: np.ndarray,
    regulated: np.ndarray,
    chosen: Following,
    paid: np.ndarray,
    rates: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """A and B of x_m' = A x_m + B w: x_m = [x; u] is the optimal answer of x' = A x + B u to
    commands w of the outputs `regulated` x, (q, n), w = [r; r'; r_end].

    u' = Γ w - K (x_m - Π w): Π, Γ hold the outputs on the commands for ever (Francis), K is the LQR
    of what x_m still has to go: weights of the squared errors and of x (`paid`, (n,)), and of u'
    (`rates`, (m,)). NoSolutionError when the inputs cannot hold the outputs on every command."""
    from scipy.linalg import solve_continuous_are

    q, n, m = len(regulated), len(A), B.shape[1]
    w, zeta = chosen.filter
    one = np.array([[0.0, 1.0, 0.0], [-(w**2), -2.0 * zeta * w, w**2], [0.0, 0.0, 0.0]])
    S, told = np.kron(one, np.eye(q)), np.eye(q, 3 * q)
    moved = np.block([[A, B], [np.zeros((m, n + m))]])
    steered, seen = np.eye(n + m, m, k=-n), np.hstack([regulated, np.zeros((q, m))])
    # M Π + steered Γ = Π S and seen Π = told, column after column.
    system = np.block(
        [
            [
                np.kron(np.eye(3 * q), moved) - np.kron(S.T, np.eye(n + m)),
                np.kron(np.eye(3 * q), steered),
            ],
            [np.kron(np.eye(3 * q), seen), np.zeros((3 * q * q, 3 * q * m))],
        ]
    )
    asked = np.concatenate([np.zeros(3 * q * (n + m)), told.T.ravel()])
    solution = np.linalg.lstsq(system, asked, rcond=None)[0]
    if np.abs(system @ solution - asked).max() > 1e-6:
        raise NoSolutionError(
            "the inputs cannot hold the outputs on every command; command fewer outputs"
        )
    Pi = solution[: 3 * q * (n + m)].reshape(3 * q, n + m).T
    Gamma = solution[3 * q * (n + m) :].reshape(3 * q, m).T
    cost = seen.T @ np.diag([chosen.outputs[name] for name in chosen.outputs]) @ seen
    cost += np.diag(np.concatenate([paid, np.zeros(m)]))
    K = steered.T @ solve_continuous_are(moved, steered, cost, np.diag(rates)) / rates[:, None]
    return moved - steered @ K, steered @ (Gamma + K @ Pi)
