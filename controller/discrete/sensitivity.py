"""Relative change of the gain K of a game in discrete time for a change of the last digit of every
entry.

With G = [B E], W = blkdiag(R, -δ² I), H = W + G'X G, both gains M = [K; -L] = H⁻¹G'X A and
F = A - G M, changes a, g, q and w of A, G, Q and W change X by D and M by
H⁻¹ (g'X F + G'X (a - g M) - w M + G'D F), to first order, where

  D = F'D F + Γ,  Γ = (a - g M)'X F + F'X (a - g M) + q + M'w M.

For columns p and e, p'D e is the trace of Γ Z with Z = F Z F' + (p e' + e p')/2: one Lyapunov
equation for each entry of K. It has the solution of the equation in continuous time with
(F + I)⁻¹(F - I), (F + I)⁻¹p and (F + I)⁻¹e. Source: Konstantinov, Gu, Mehrmann and Petkov,
Perturbation Theory for Matrix Equations, 2003, Chapter 5.
"""

from __future__ import annotations

import math

import numpy as np

from controller.discrete.step_form import StepForm
from controller.riccati.sensitivity import Columns, relative_change, weighted


def gain_change_in_steps(
    form: StepForm, X: np.ndarray, given: StepForm, moved: np.ndarray
) -> float:
    """Return the relative change of K for one unit in the last place of the entries of one game.

    form: normal form of the game, in the coordinates in which X is accurate
    X: (n, n), solution
    given: the game in the coordinates of its entries
    moved: the part of A of `given` that has an error in the last place, (n, n)
    """
    from scipy.linalg import block_diag

    n, m = form.B.shape
    into = given.T @ np.linalg.inv(form.T)
    back = np.linalg.inv(into)
    has_disturbance = math.isfinite(form.delta)
    G = np.hstack([form.B, form.E]) if has_disturbance else form.B
    signs = np.repeat([1.0, -1.0], [m, G.shape[1] - m])
    by_both = np.linalg.inv(np.diag(signs) + G.T @ X @ G)
    gains = by_both @ G.T @ X @ form.A
    F = form.A - G @ gains
    half = math.sqrt(2.0) * np.linalg.inv(F + np.eye(n))

    # In the inputs of the user: M and the magnitudes of the entries.
    scale = np.linalg.inv(form.root)
    W = np.abs(given.R)
    entries_G = np.abs(given.inputs)
    if has_disturbance:
        k = G.shape[1] - m
        scale = block_diag(scale, np.eye(k) / form.delta)
        W = block_diag(W, 2.0 * form.delta**2 * np.eye(k))  # the square of one entry, δ
        entries_G = np.hstack([entries_G, np.abs(given.disturbance)])
    M = scale.T @ gains
    A = np.abs(moved)
    Q = np.abs(given.Q)
    XF = back.T @ X @ F
    GX = np.linalg.inv(scale) @ G.T @ X @ back

    def change(Z: np.ndarray) -> float:
        by_A = (A * np.abs(XF @ Z @ into.T)).sum()
        by_G = (entries_G * np.abs(XF @ Z @ M.T)).sum()
        by_Q = 0.5 * (Q * np.abs(into @ Z @ into.T)).sum()
        by_W = np.abs(M @ Z @ M.T)
        by_R = 0.5 * (W[:m, :m] * by_W[:m, :m]).sum()
        by_delta = 0.5 * abs(np.trace((W * (M @ Z @ M.T))[m:, m:]))
        return float(2.0 * (by_A + by_G + by_Q + by_R + by_delta))

    direct = entries_G.T @ np.abs(XF @ back)
    direct += np.abs(GX) @ (A + entries_G @ np.abs(M @ back)) + W @ np.abs(M @ back)
    direct = np.abs(by_both[:m] @ scale) @ direct
    columns = Columns.of(half @ G @ by_both[:, :m], half @ F @ back)
    changes = [change(Z) for Z in weighted(half @ (F - np.eye(n)) / math.sqrt(2.0), columns)]
    return relative_change(given, gains[:m] @ back, direct, columns, changes)
