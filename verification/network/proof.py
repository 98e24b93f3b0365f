"""Proof that a policy is stabilizing and near the optimum: the bound of its error, box by box.

`theorem` says which bound suffices. Boxes of its tube are cut in two until `bounds` shows it in
each, until a state violates it, or until the time is over.
"""

from __future__ import annotations

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
from controller.riccati.balls import midpoints, radii
from controller.riccati.gare import Solution
from verification.box import starts_in
from verification.network.bounds import OUTWARD, BoundedFunction
from verification.network.theorem import (
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
#: Excess that is tried, relative to that which the largest error found requires, and to one that is
#: not proved.
_ABOVE, _NEXT = 1.3, 2.0
#: Smallest bound that is tried.
_SMALLEST_EXCESS = 1e-5
#: Distance in boxes below which an error is rounding, and violates no bound.
_AWAY = 1e-9
#: Number of violators that are kept.
_KEPT = 8


def proof_of(
    exact: Solution,
    policy: ca.Function,
    equilibrium: np.ndarray,
    b: np.ndarray,
    wanted: float,
    seconds: float,
) -> Proof:
    """Return what is proved of a policy within a time: a bound of its cost that its largest error
    found suggests, or `wanted` if this is near, or larger ones up to the largest of the theorem.

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
        setting, most = prover.setting, largest_share(prover.setting)
        claim = claim_of(setting, wanted, most)
        # The cost grows with the square of the error.
        needed = prover.worst(claim, prover.drawn)[0] ** 2 * claim.excess
        excess = wanted if needed < wanted < _ABOVE * needed else _ABOVE * needed
        claim = claim_of(setting, max(excess, _SMALLEST_EXCESS), most)
        while (left := seconds - (time.process_time() - began)) > 0.0:
            proof = prover.searched(claim, 0.5 * left, replace(proof, why=over))
            larger = claim_of(setting, _NEXT * claim.excess, most)
            if proof.is_found or larger.excess <= claim.excess:
                break
            claim = larger
    except (NotListedError, NotProvedError) as error:
        proof = Proof(why=str(error))
    return proof


class _Prover:
    """Policy of a solved game about its equilibrium.

    drawn: random states of the tube at all distances, relative to it, (n, `_SAMPLES`)
    """

    def __init__(
        self, exact: Solution, policy: ca.Function, equilibrium: np.ndarray, b: np.ndarray
    ) -> None:
        self.setting = setting = setting_of(exact, b, equilibrium)
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
        self.inverse = inverse = np.linalg.inv(S)
        self.rounding = (n + 8) * 2.0**-51 * np.abs(inverse)
        # |M S⁻¹| <= |M V| / (1 - |1 - S V|) of the inverse V in doubles.
        off = np.linalg.norm(S @ inverse - np.eye(n)) + np.linalg.norm(np.abs(S) @ self.rounding)
        if not off < 0.5:
            raise NotProvedError("the weights of the states are too unequal")
        self.loss = OUTWARD / (1.0 - off)
        distances = 2.0 ** -np.random.default_rng(0).uniform(0.0, 8.0, _SAMPLES)
        self.drawn = starts_in(np.ones(n), _SAMPLES).T * distances

    @np.errstate(all="ignore")
    def worst(self, claim: Claim, s: np.ndarray) -> tuple[float, list[np.ndarray]]:
        """Return the largest |e| / allowed |e| at states of the tube, relative to it (n, N), and up
        to `_KEPT` deviations (n,) at which it exceeds 1, the worst first.
        """
        y, norm = s * claim.tube[:, None], np.linalg.norm
        e = on_rows(self.steps, self.center + y.T * self.b).T - self.at_rest
        sizes = norm(self.setting.S @ y, axis=0)
        allowed = claim.allowed(norm(self.setting.SU @ y, axis=0) ** 2) * sizes
        ratios = norm(e, axis=0) / np.maximum(allowed, 1e-300)
        ratios = np.where(np.abs(y).max(axis=0) > _AWAY, ratios, 0.0)
        first = [k for k in np.argsort(-ratios)[:_KEPT] if ratios[k] > 1.0]
        return float(ratios.max(initial=0.0)), list(y.T[first] * self.b)

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
        scores = scores + np.abs(Z[:, :, :n]).sum(0)
        above = norm(np.abs(x) + np.abs(Z).sum(2) + r, axis=0)
        value = norm(SU @ y, axis=0) + norm(SU, axis=0) @ h
        under = np.maximum(_least(S, y, h), 0.0)
        ratio = above * OUTWARD / under / claim.allowed((value * OUTWARD) ** 2)
        return np.where(np.isnan(ratio), np.inf, ratio), scores

    def central(self, claim: Claim) -> float:
        """Return the size of the largest central box in which the slope is small enough, or 0."""
        norm, size = np.linalg.norm, 1.0
        while size >= _SMALLEST:
            h = size * claim.tube * OUTWARD
            M, R = self.error.slopes(self.center, h * self.b)
            M, R = M * self.b, (R + self.error_of_K) * self.b
            slope = norm(R @ np.abs(self.inverse) + np.abs(M) @ self.rounding)
            allowed = claim.allowed((norm(self.setting.SU, axis=0)[None] @ h * OUTWARD) ** 2)[0]
            if np.isfinite(M).all() and (norm(M @ self.inverse, 2) + slope) * self.loss <= allowed:
                return size
            size /= 2.0
        return 0.0

    def searched(self, claim: Claim, seconds: float, before: Proof) -> Proof:
        """Return the result of a search, in boxes of the tube relative to it.

        seconds: of the processor, after which the search ends
        before: result whose `why` is told then, and whose boxes count, too
        """
        end = time.process_time() + seconds
        n, proof = len(claim.tube), replace(before, share=0.0)
        _, violators = self.worst(claim, self.drawn)
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
            _, violators = self.worst(claim, s)
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
