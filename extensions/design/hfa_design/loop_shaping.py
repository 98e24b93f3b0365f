"""H-infinity loop shaping (McFarlane and Glover) with model following, for one linear model.

The plant G, which includes the actuators, is shaped: G_s = W2 G W1. W1 is diagonal and constant,
and W2 is diagonal with entries k (1 + c/s)/(1 + τ s). With G_s = M⁻¹ N, M M* + N N* = I, the
controller stabilizes all (M + Δ_M)⁻¹ (N + Δ_N), ‖[Δ_N Δ_M]‖∞ < 1/γ. The commands drive a model of
the aircraft with an optimal control law. The loop acts only on the difference between aircraft and
model.

Sources: McFarlane and Glover, IEEE Trans. Automatic Control 37 (1992), 759-769. Francis, SIAM J.
Control 15 (1977), 486-505.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from controller.riccati.frequency_response import system_gain
from hfa_design.design import Following, OutputWeight
from hfa_support.arguments import checks_arguments
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import spectral_radius
from hfa_support.reporting.checks import Check, at_most

#: Fraction by which the robustness norm may exceed gamma.
ROUNDING = 1e-6


class Robust(NamedTuple):
    """Controller u = -F x̂, x̂' = A x̂ + B u + H (y - C x̂).

    F: (m, n)
    H: (n, p)
    gamma_min: smallest robustness norm γ of any controller
    gamma: γ of this controller
    """

    F: np.ndarray
    H: np.ndarray
    gamma_min: float
    gamma: float


@checks_arguments
def robust_controller(A: np.ndarray, B: np.ndarray, C: np.ndarray, factor: float) -> Robust:
    """Return the central controller for γ = factor γ_min, robust to coprime-factor perturbations.

    The controller stabilizes all plants within the distance 1/γ of C (sI - A)⁻¹ B. With A'X + XA -
    XBB'X + C'C = 0 and AZ + ZA' - ZC'CZ + BB' = 0:

      γ_min² = 1 + ρ(XZ),  F = B'X,  H = γ² ((γ² - 1) I - ZX)⁻¹ Z C'

    Raises NoSolutionError if a mode that does not decay is not controllable or not observable.
    """
    from scipy.linalg import solve_continuous_are

    try:
        X = solve_continuous_are(A, B, C.T @ C, np.eye(B.shape[1]))
        Z = solve_continuous_are(A.T, C.T, B @ B.T, np.eye(len(C)))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError(
            f"the shaped plant has no robust controller: {error}; choose inputs that control, and "
            "outputs that measure, every mode that does not decay"
        ) from error
    smallest = float(np.sqrt(1.0 + spectral_radius(X @ Z)))
    gamma = factor * smallest
    H = gamma**2 * np.linalg.solve((gamma**2 - 1.0) * np.eye(len(A)) - Z @ X, Z @ C.T)
    return Robust(B.T @ X, H, smallest, gamma)


@checks_arguments
def robust_check(A: np.ndarray, B: np.ndarray, C: np.ndarray, found: Robust) -> Check:
    """Return the check that ‖[K; I] (I - G K)⁻¹ [I G]‖∞ is at most γ.

    The norm is inf for an unstable loop. The plant is G = C (sI - A)⁻¹ B.

    found: the controller K and its γ
    """
    n, m = B.shape
    p = len(C)
    closed = np.block([[A, -B @ found.F], [found.H @ C, A - B @ found.F - found.H @ C]])
    enters = np.block([[np.zeros((n, p)), B], [found.H, np.zeros((n, m))]])
    leaves = np.block([[np.zeros((m, n)), -found.F], [C, np.zeros((p, n))]])
    at_once = np.block([[np.zeros((m, p + m))], [np.eye(p), np.zeros((p, m))]])
    gain = system_gain(closed, enters, leaves, at_once)
    return at_most(
        "robustness",
        gain,
        (1.0 + ROUNDING) * found.gamma,
        "the robustness norm of the loop exceeds gamma",
    )


class Weights(NamedTuple):
    """Output weights as one system x' = A x + B y, y_s = C x + D y, from outputs y to weighted y_s.

    A: (n, n)
    B: (n, p)
    C: (p, n)
    D: (p, p)
    states: names of x, (n,)
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]


def output_weights(outputs: Mapping[str, OutputWeight]) -> Weights:
    """Return the weights k (1 + c/s) / (1 + τ s) of all outputs as one system.

    For c > 0, the system has a state e with e' = y, and v = y + c e. For c = 0, v = y. For τ > 0,
    it has a state x with τ x' = v - x. The weighted output is k x, or k v for τ = 0.
    """
    names: list[str] = []
    for name, weight in outputs.items():
        if weight.corner > 0.0:
            names.append(f"{name}_integral")
        if weight.lag > 0.0:
            names.append(f"{name}_lag_1")
    n = len(names)
    p = len(outputs)
    unit = np.eye(n + p)  # selects rows of [x; y]
    rates = np.zeros((n, n + p))
    weighted = np.zeros((p, n + p))
    for row, (name, weight) in enumerate(outputs.items()):
        signal = unit[n + row]
        if weight.corner > 0.0:
            integral = names.index(f"{name}_integral")
            rates[integral] = signal
            signal = signal + weight.corner * unit[integral]
        if weight.lag > 0.0:
            lagged = names.index(f"{name}_lag_1")
            rates[lagged] = (signal - unit[lagged]) / weight.lag
            signal = unit[lagged]
        weighted[row] = weight.gain * signal
    return Weights(rates[:, :n], rates[:, n:], weighted[:, :n], weighted[:, n:], tuple(names))


def following_model(
    A: np.ndarray,
    B: np.ndarray,
    regulated: np.ndarray,
    chosen: Following,
    paid: np.ndarray,
    rates: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B of x_m' = A x_m + B w, the optimal response to commands of outputs.

    x_m = [x; u] is the response of x' = A x + B u to commands w = [r; r'; r_end] of the outputs
    `regulated` x. The control law is u' = Γ w - K (x_m - Π w). With Π and Γ, the outputs equal the
    commands exactly (Francis). K is the LQR gain for the deviation x_m - Π w.

    regulated: (q, n)
    chosen: weights of the squared errors, command filter
    paid: (n,), weights of x
    rates: (m,), weights of u'

    Raises NoSolutionError if the inputs cannot track every command of the outputs.
    """
    from scipy.linalg import solve_continuous_are

    n = len(A)
    m = B.shape[1]
    M = np.block([[A, B], [np.zeros((m, n + m))]])
    steered = np.eye(n + m, m, k=-n)
    outputs = np.hstack([regulated, np.zeros((len(regulated), m))])
    Pi, Gamma = _held_for_ever(M, steered, outputs, chosen)
    error_weights = np.diag([chosen.outputs[name] for name in chosen.outputs])
    cost = outputs.T @ error_weights @ outputs + np.diag(np.concatenate([paid, np.zeros(m)]))
    P = solve_continuous_are(M, steered, cost, np.diag(rates))
    K = steered.T @ P / rates[:, None]
    return M - steered @ K, steered @ (Gamma + K @ Pi)


def _held_for_ever(
    M: np.ndarray, steered: np.ndarray, outputs: np.ndarray, chosen: Following
) -> tuple[np.ndarray, np.ndarray]:
    """Return Π and Γ with M Π + steered Γ = Π S and outputs Π = [I 0 0], for `following_model`."""
    # With x_m = Π w and u' = Γ w, the outputs equal the commands for all time. S is the matrix of
    # the command filter w' = S w. Raises NoSolutionError if Π and Γ do not exist.
    q = len(outputs)
    size, m = steered.shape
    bandwidth, damping = chosen.filter
    filter_rows = [0.0, 1.0, 0.0], [-(bandwidth**2), -2.0 * damping * bandwidth, bandwidth**2]
    S = np.kron(np.array([*filter_rows, [0.0, 0.0, 0.0]]), np.eye(q))
    commands = np.eye(q, 3 * q)
    identity = np.eye(3 * q)
    # Both equations, vectorized column by column.
    by_Pi = np.kron(identity, M) - np.kron(S.T, np.eye(size))
    by_Gamma = np.kron(identity, steered)
    output_rows = np.hstack([np.kron(identity, outputs), np.zeros((3 * q * q, 3 * q * m))])
    system = np.vstack([np.hstack([by_Pi, by_Gamma]), output_rows])
    right = np.concatenate([np.zeros(3 * q * size), commands.T.ravel()])
    solution = np.linalg.lstsq(system, right, rcond=None)[0]
    if np.abs(system @ solution - right).max() > 1e-6:
        raise NoSolutionError(
            "the inputs cannot track every command of the outputs; declare fewer commanded outputs"
        )
    Pi, Gamma = np.split(solution, [3 * q * size])
    return Pi.reshape(3 * q, size).T, Gamma.reshape(3 * q, m).T
