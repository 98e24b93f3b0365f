"""Newton steps for P in matrix form: the last digits of a learned value, and the measure of what is still missing."""

from __future__ import annotations

import numpy as np

#: Most steps of a refinement; each squares the error until rounding stops it.
MOST_STEPS = 20


def riccati_residual(
    A: np.ndarray, control: np.ndarray, disturbance: np.ndarray, Q: np.ndarray, P: np.ndarray
) -> np.ndarray:
    """A'P + PA + Q - PSP with S = G G' - D D', G control (n, m) and D disturbance (n, k); (n, n).

    P S P is taken from its roots: where few inputs hold a large P in check, |G'P| is not a small difference of
    large numbers, and S P is.
    """
    pushed, disturbed = P @ control, P @ disturbance
    return A.T @ P + P @ A + Q - pushed @ pushed.T + disturbed @ disturbed.T


def newton_correction(
    A: np.ndarray, control: np.ndarray, disturbance: np.ndarray, Q: np.ndarray, P: np.ndarray
) -> np.ndarray:
    """N with (A - S P)'N + N (A - S P) = `riccati_residual`, (n, n): P - N is the next policy iteration.

    Solved as n² linear equations. Raises numpy.linalg.LinAlgError when they are singular.
    """
    closed = A - control @ (control.T @ P) + disturbance @ (disturbance.T @ P)
    eye = np.eye(len(P))
    operator = np.kron(closed.T, eye) + np.kron(eye, closed.T)
    right = riccati_residual(A, control, disturbance, Q, P)
    found: np.ndarray = np.linalg.solve(operator, right.reshape(-1)).reshape(P.shape)
    return (found + found.T) / 2.0


def refine(
    A: np.ndarray, control: np.ndarray, disturbance: np.ndarray, Q: np.ndarray, P: np.ndarray
) -> tuple[np.ndarray, int]:
    """P - N repeated until the correction no longer halves, which is rounding; the last P and the number of solves."""
    last, solves = np.inf, 0
    while solves < MOST_STEPS:
        try:
            correction = newton_correction(A, control, disturbance, Q, P)
        except np.linalg.LinAlgError:
            break
        solves += 1
        size = float(np.linalg.norm(correction))
        if not size < 0.5 * last:
            break
        P, last = P - correction, size
    return P, solves
