"""The servo of SimVFA: an LQR that feeds back the state of a reference model, which three measurements correct."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.design.design import SHORT_PERIOD
from controller.design.design_file import load_design
from controller.design.design_model import DesignModel, design_model
from controller.design.scheduled_controller import ScheduledController
from controller.policy.commands import COMMAND_FILTER
from controller.riccati.gare import solve_game
from hfa_model.aircraft import Aircraft
from hfa_model.provenance import parameter_hash
from hfa_support.errors import NoSolutionError
from trim.linear.linear_model import level_model

#: What is measured besides the integrals, and what is regulated.
RATE, REGULATED = "pitch_rate", ("dihedral", f"vertical_acceleration{SHORT_PERIOD}")
#: Coefficients of α0 + α1 s (+ α2 s²), by the order of the actuators.
ALPHAS = {1: (1.0, 0.5), 2: (2.0, np.sqrt(2.0), 1.0)}
#: Weights q I and r of the LQR that places the zeros of the squared-up plant; ε of R⁻¹; shift of A in R⁻¹, 1/s.
SQUARING_Q, SQUARING_R, EPSILON, SHIFT = 1.0, 500.0, 20.0, 0.25
_THIRD = np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True, eq=False)
class ReferenceModel:
    """x_m' = A x_m + B u - [0; I] r + L (y - C x_m),  u = -K x_m,  y = [pitch rate; integrals] (Qu 2018).

    A: (n, n). B: (n, 2). C: (3, n). K: (2, n). L = B1 R⁻¹S: (n, 3), with B1 (n, 3) the squared-up input path of
    relative degree 1, `squared_up` B itself, S: (3, 3) of the mixed output S y, for which S C B1 is symmetric and
    positive definite, R_inverse: (3, 3).
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    K: np.ndarray
    L: np.ndarray
    S: np.ndarray
    R_inverse: np.ndarray
    squared_up: np.ndarray


def reference_model(built: DesignModel) -> ReferenceModel:
    """The reference model of the design model `simvfa-1` or `simvfa-2`.

    R⁻¹ = (S C B1)⁻¹ [S C (A + σ I) B1 + its transpose] (S C B1)⁻¹ + ε I. NoSolutionError when the squared-up plant
    has a zero in the right half plane. Source: Qu, Thomsen, Annaswamy 2018; Thomsen 2018, Section 4.1.
    """
    from scipy.linalg import polar

    order = built.design.actuators[built.inputs[0]].order
    game = built.game()
    n = len(game.A)
    C = np.vstack([np.eye(n)[built.states.index(RATE)], np.eye(n)[n - 2 :]])
    squared_up = np.vstack([game.B.T, _third_row(game.A.T, C.T, game.B.T)]).T
    B1 = sum(a * np.linalg.matrix_power(game.A, k) @ squared_up for k, a in enumerate(ALPHAS[order]))
    refuse_zeros(game.A, B1, C)
    S = polar(C @ B1)[0].T
    if S[2].sum() < 0.0:  # the sign of the third input is free; the tables between the angles need one
        squared_up, B1, S = squared_up * _THIRD, B1 * _THIRD, S * _THIRD[:, None]
    mixed = S @ C
    inverse = np.linalg.inv(mixed @ B1)
    rate = mixed @ (game.A + SHIFT * np.eye(n)) @ B1
    R_inverse = inverse @ (rate + rate.T) @ inverse + EPSILON * np.eye(len(C))
    K = solve_game(game).K
    return ReferenceModel(game.A, game.B, C, K, B1 @ R_inverse @ S, S, R_inverse, squared_up)


def _third_row(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> np.ndarray:
    """c (n,) that gives (A, B, [C; c]) as many outputs as inputs, the same relative degree, and stable zeros.

    With T = [B⁺; N'], N'B = 0, the part of T z that no input reaches directly is a smaller plant with the same
    outputs; where its C B has full rank, the zeros are the eigenvalues of an LQR and c its gain.
    Source: Qu, Wiese, Annaswamy, Lavretsky, Squaring-up in the presence of transmission zeros, 2014.
    """
    from scipy.linalg import null_space, solve_continuous_are

    m, p = B.shape[1], len(C)
    T = np.vstack([np.linalg.pinv(B), null_space(B.T).T])
    moved, seen = T @ A @ np.linalg.inv(T), C @ np.linalg.inv(T)
    A21, A22, C1, C2 = moved[m:, :m], moved[m:, m:], seen[:, :m], seen[:, m:]
    if np.abs(C1).max() <= 1e-9 * np.abs(C2).max():
        row = np.concatenate([np.zeros(m), _third_row(A22, A21, C2)])
        return row @ T
    whole = np.vstack([C1, null_space(C1).T])
    pseudo = A21 @ np.linalg.inv(whole)
    drift, b = A22 - pseudo[:, :p] @ C2, pseudo[:, p:]
    R = SQUARING_R * np.eye(m - p)
    P = solve_continuous_are(drift, b, SQUARING_Q * np.eye(len(drift)), R)
    gain = np.linalg.solve(R, b.T @ P)
    return np.concatenate([whole[p], gain[0]]) @ T


def refuse_zeros(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> None:
    """NoSolutionError when (A, B, C), with as many inputs as outputs and C B regular, has a zero that is not stable."""
    from scipy.linalg import null_space

    left, right = null_space(B.T).T, null_space(C)
    zeros = np.linalg.eigvals(np.linalg.solve(left @ right, left @ A @ right))
    if zeros.real.max() >= 0.0:
        raise NoSolutionError(f"the squared-up plant has a zero at {zeros.real.max():.4g} 1/s; it must be stable")


def reference_servo(aircraft: Aircraft, design: str, dihedrals: np.ndarray) -> ScheduledController:
    """The LQR with its reference model, tabled over the dihedral, rad; `simvfa-1` or `simvfa-2`.

    x = [e; x_m]: e' = z - r of the regulated outputs, and the reference model corrected by [pitch rate; e].
    """
    chosen = load_design(design)
    built = [design_model(aircraft, level_model(aircraft, dihedral), chosen) for dihedral in dihedrals.tolist()]
    tables = [reference_model(each) for each in built]
    n = len(tables[0].A)
    shape = (len(tables), n + 2)
    A, B = np.zeros((*shape, n + 2)), np.zeros((*shape, 5))
    C = np.zeros((len(tables), 2, n + 2))
    for k, each in enumerate(tables):
        A[k, 2:, 2:] = each.A - each.B @ each.K - each.L @ each.C
        A[k, 2:, :2] = each.L[:, 1:]
        B[k, 2:, 0] = each.L[:, 0]
        B[k, :2, 1:3], B[k, :2, 3:] = np.eye(2), -np.eye(2)
        B[k, n:, 3:] = -np.eye(2)
        C[k, :, 2:] = -each.K
    points = [each.model.point for each in built]
    return ScheduledController(
        name=f"{design}, reference model",
        feedback="output",
        dihedrals=dihedrals,
        A=A,
        B=B,
        C=C,
        D=np.zeros((len(tables), 2, 5)),
        W=np.zeros((*shape, 2)),
        states=(*(f"{name}_integral" for name in REGULATED), *(f"model_{name}" for name in built[0].states)),
        measurements=(RATE, *REGULATED),
        commands=tuple(f"{name}_command" for name in REGULATED),
        inputs=chosen.inputs,
        trim_states=np.array([point.states for point in points]),
        trim_inputs=np.array([point.inputs for point in points]),
        dynamics=aircraft.variant.name,
        parameters=parameter_hash(aircraft.parameters),
        command_filter=COMMAND_FILTER,
        about={"design": design, "source": "Qu, Thomsen, Annaswamy 2018"},
    )
