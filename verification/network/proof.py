"""Proof that a policy is stabilizing and near the optimum: the bound of its error, box by box.

`theorem` says which bound suffices. Boxes of its tube are cut in two until `bounds` shows it in
each, until a state violates it, or until the time is over.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import casadi as ca
import numpy as np

from controller.critic.network.operations import (
    NotListedError,
    Operation,
    on_rows,
    operations_of,
)
from controller.riccati.balls import BITS, ball_matrix, midpoints, precision, radii
from controller.riccati.gare import Solution
from verification.box import starts_in
from verification.network.bounds import OUTWARD, BoundedFunction
from verification.network.theorem import (
    LEVELS,
    Claim,
    NotProvedError,
    claim_of,
    largest_share,
    setting_of,
)
from verification.verdict import Proof

#: Numbers in the largest array of a batch of boxes, and the least number of boxes in it.
_NUMBERS, _FEWEST = 2_000_000, 32
#: The central box, where the slope is bounded, is at least this part of the tube.
_SMALLEST = 2.0**-30
#: Number of states of the tube at which the error is compared with its bound before a proof.
_SAMPLES = 4000
#: Excess that is tried, relative to that which the errors known require, and to one for which the
#: time was too short.
_ABOVE, _NEXT = 1.3, 6.0
#: Part of the time left for an excess, if a larger one may follow or is proved.
_PART = 0.5
#: Smallest share of a level in that of a constant error.
_OF_CONSTANT = 0.25
#: Smallest bound that is tried.
_SMALLEST_EXCESS = 1e-5
#: Distance in boxes below which an error is rounding, and violates no bound.
_AWAY = 1e-9
#: Number of violators that are kept.
_KEPT = 16


def proof_of(
    exact: Solution,
    policy: ca.Function,
    equilibrium: np.ndarray,
    b: np.ndarray,
    wanted: float,
    seconds: float,
) -> Proof:
    """Return what is proved of a policy within a time: that its cost is at most `wanted`, or a
    larger bound, up to the largest of the theorem; then a smaller one that its errors suggest.

    equilibrium: about which it is proved, (n,)
    b: half-widths of the box of states, (n,)
    wanted: bound of the cost above the optimum, relative
    seconds: of the processor
    """
    began = time.process_time()
    over = f"the limit of {seconds:g} s is over"
    proof = Proof(why=over)
    try:
        prover = _Prover(exact, policy, equilibrium, b)
        bound, end = wanted, began + seconds
        while (left := end - time.process_time()) > 0.0:
            claim = prover.claim(bound)
            found = prover.searched(claim, left if bound > wanted else _PART * left, over)
            needed = max(prover.worst(claim, prover.known)[0], _SMALLEST_EXCESS)
            if proof.is_found and not found.is_found:
                break
            proof = replace(found, violators=found.violators or proof.violators)
            if claim.excess < (_ABOVE * needed if found.is_found else 0.9 * bound):
                break
            if found.is_found:
                bound = math.sqrt(needed * claim.excess)
            else:
                bound = _ABOVE * needed if needed > claim.excess else _NEXT * bound
    except (NotListedError, NotProvedError) as error:
        proof = proof if proof.is_found else replace(proof, why=str(error))
    return proof


class _Prover:
    """Policy of a solved game about its equilibrium.

    known: states in units of the box, (n, N): random ones at all distances, and violators found
    """

    def __init__(
        self, exact: Solution, policy: ca.Function, equilibrium: np.ndarray, b: np.ndarray
    ) -> None:
        self.setting = setting = setting_of(exact, b, equilibrium)
        self.most = largest_share(setting)
        steps = operations_of(policy)
        self.b, self.center, T, S, n = b, equilibrium, setting.T, setting.S, len(b)
        K = midpoints(setting.K) / b  # by the state
        TK = np.hstack([T, T @ K])
        steps.append(Operation("", (len(steps) - 1, 0), TK, np.zeros(len(T))))
        self.steps, self.error = steps, BoundedFunction(steps)  # T (u + K z)
        # That of T K itself, per unit of the state.
        rounding = (len(T) + 2) * 2.0**-52 * np.abs(K)
        self.error_of_K = np.abs(T) @ (radii(setting.K) / b + rounding)
        self.at_rest = on_rows(steps, equilibrium[None]).T
        with precision(BITS):
            inverse = ball_matrix(S).inv()
        self.inverse = midpoints(inverse)
        self.rounding = radii(inverse) + (n + 8) * 2.0**-51 * np.abs(self.inverse)
        distances = 2.0 ** -np.random.default_rng(0).uniform(0.0, 8.0, _SAMPLES)
        peaks = np.max([loop.peaks for loop in setting.loops], axis=0)
        self.known = starts_in(peaks, _SAMPLES).T * distances

    @np.errstate(all="ignore")
    def errors(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return |e| / |y|_W and y'U y at states in units of the box, (N,) each."""
        norm = np.linalg.norm
        e = on_rows(self.steps, self.center + y.T * self.b).T - self.at_rest
        errors = norm(e, axis=0) / norm(self.setting.S @ y, axis=0)
        errors = np.nan_to_num(errors, nan=1e9, posinf=1e9)
        errors = np.where(np.abs(y).max(axis=0) > _AWAY, errors, 0.0)
        return errors, norm(self.setting.SU @ y, axis=0) ** 2

    def claim(self, excess: float) -> Claim:
        """Return a claim on the cost, of levels in the proportion of the errors known."""
        errors, values = self.errors(self.known)
        levels = self.setting.level(values)
        found = np.array([errors[levels == k].max(initial=1e-300) for k in range(LEVELS)])
        flat = 2.0 ** np.arange(LEVELS)  # a constant error
        shape = np.maximum(found, _OF_CONSTANT * (found / flat).max() * flat)
        return claim_of(self.setting, excess, self.most, np.maximum.accumulate(shape))

    def worst(self, claim: Claim, y: np.ndarray) -> tuple[float, list[np.ndarray]]:
        """Return the excess that the errors at states in units of the box (n, N) require, and up to
        `_KEPT` deviations (n,) at which they are larger than allowed, which become known.
        """
        errors, values = self.errors(y)
        ratios = errors / claim.shares[self.setting.level(values)]
        first = [k for k in np.argsort(-ratios)[:_KEPT] if ratios[k] > 1.0]
        # The cost grows with the square of the error.
        needed = claim.excess * float(ratios.max(initial=0.0)) ** 2
        self.known = np.hstack([self.known, y[:, first]])
        return needed, list(y.T[first] * self.b)

    @np.errstate(all="ignore")
    def bounded(
        self, claim: Claim, s: np.ndarray, width: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return bounds of the ratio |e| / allowed |e| over boxes of the tube, relative to it
        (n, N), (N,), and the scores of the states, (N, n).
        """
        n, S, SU, norm = len(s), self.setting.S, self.setting.SU, np.linalg.norm
        b, center = self.b[:, None], self.center[:, None]
        y = s * claim.tube[:, None]
        # Rounding of centers may leave gaps between boxes.
        h = width * claim.tube[:, None] * OUTWARD + 2.0**-50 * (np.abs(y) + np.abs(center) / b)
        x, Z, r, scores = self.error.over(center + y * b, h * b)
        r = r + self.error_of_K @ (np.abs(center) + (np.abs(y) + h) * b)
        r = r + 2.0**-50 * (np.abs(x) + np.abs(self.at_rest))
        x = x - self.at_rest
        # s² is 1/2 within 1/2.
        squares = 0.5 * Z[:, :, n:] * np.equal(*np.triu_indices(n))[: Z.shape[2] - n]
        x, above = x + squares.sum(2), np.abs(Z).sum(2) - np.abs(squares).sum(2) + r
        scores = scores + np.abs(Z[:, :, :n]).sum(0)
        above = norm(np.abs(x) + above, axis=0)
        value = norm(SU @ y, axis=0) + norm(SU, axis=0) @ h
        under = np.maximum(_least(S, y, h), 0.0)
        ratio = above * OUTWARD / under / claim.shares[self.setting.level((value * OUTWARD) ** 2)]
        return np.where(np.isnan(ratio), np.inf, ratio), scores

    def central(self, claim: Claim) -> float:
        """Return the size of the largest central box in which the slope is small enough, or 0."""
        norm, size = np.linalg.norm, 1.0
        while size >= _SMALLEST:
            h = size * claim.tube * OUTWARD
            M, R = self.error.slopes(self.center, h * self.b)
            M, R = M * self.b, (R + self.error_of_K) * self.b
            slope = norm(R @ np.abs(self.inverse) + np.abs(M) @ self.rounding)
            value = (norm(self.setting.SU, axis=0) @ h * OUTWARD) ** 2
            allowed = claim.shares[self.setting.level(value)]
            if np.isfinite(M).all() and (norm(M @ self.inverse, 2) + slope) * OUTWARD <= allowed:
                return size
            size /= 2.0
        return 0.0

    def searched(self, claim: Claim, seconds: float, over: str) -> Proof:
        """Return the result of a search, in boxes of the tube relative to it.

        seconds: of the processor, after which the search ends
        over: what is told then
        """
        end = time.process_time() + seconds
        n, proof = len(claim.tube), Proof(why=over)
        _, violators = self.worst(claim, self.known)
        size = 0.0 if violators else self.central(claim)
        boxes = np.stack([np.zeros((n, 1)), np.ones((n, 1))])  # centers and half-widths, (2, n, N)
        if not size and not violators:
            size = _SMALLEST
            if not self.error.is_homogeneous(self.center, size * claim.tube * self.b):
                return Proof(why="its slope at the equilibrium is too far off, or has a kink")
            # The bound on the surface of this box is that within.
            faces = np.hstack([np.eye(n), -np.eye(n)])
            boxes = np.concatenate([boxes, size * np.stack([faces, faces == 0.0])], axis=2)
        while boxes.shape[2] and not violators:
            if time.process_time() > end:
                return proof
            most = max(_FEWEST, _NUMBERS // (self.error.width * n * (n + 3)))
            (s, h), boxes = boxes[:, :, -most:], boxes[:, :, :-most]
            ratio, scores = self.bounded(claim, s, h)
            is_good = (ratio <= 1.0) | ((np.abs(s) + h <= size) & (h > 0.0)).all(0)
            proof.boxes += len(ratio)
            proof.share += float(np.prod(h, axis=0)[is_good].sum())
            s, h, ratio, scores = s[:, ~is_good], h[:, ~is_good], ratio[~is_good], scores[~is_good]
            y = s * claim.tube[:, None]
            _, violators = self.worst(claim, y)
            # Cut the state with the largest score; the worst boxes come next.
            scores = np.where(h.T > 0.0, np.nan_to_num(scores, posinf=1e300) + 1e-300, 0.0)
            half = np.where(np.argmax(scores, axis=1) == np.arange(n)[:, None], 0.5 * h, 0.0)
            halves = np.concatenate([[s - half, h - half], [s + half, h - half]], axis=2)
            order = np.argsort(np.tile(ratio, 2), kind="stable")
            boxes = np.concatenate([boxes, halves[:, :, order]], axis=2)
        if violators:
            return replace(proof, why="its error is too large", violators=violators)
        return Proof(claim.excess, "", 1.0, proof.boxes)


def _least(S: np.ndarray, c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return a lower bound of |S y| in the boxes |y - c| <= h: v'S y / |v| with v = S y at nearly
    the nearest y.
    """
    W = S.T @ S
    y = np.clip(0.0, c - h, c + h)
    for _ in range(3):
        for k in range(len(c)):
            y[k] = np.clip(y[k] - (W[k] @ y) / W[k, k], c[k] - h[k], c[k] + h[k])
    v = S @ y
    row, size = S.T @ v, np.abs(S.T) @ np.abs(v)
    rounding = (len(c) + 8) * 2.0**-51 * (size * (np.abs(c) + h)).sum(0)
    least = (row * c).sum(0) - (np.abs(row) * h).sum(0) - rounding
    return np.asarray(least / (np.linalg.norm(v, axis=0) * OUTWARD))
