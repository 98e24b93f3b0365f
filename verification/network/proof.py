"""Proof that a policy is stabilizing and near the optimum: the bound of its error, box by box.

`theorem` says which bound suffices. Boxes of its tube are cut in two until `bounds` shows it in
each, until a state violates it, or until the time is over.
"""

from __future__ import annotations

import time

import casadi as ca
import numpy as np

from controller.critic.network.operations import (
    NotListedError,
    Operation,
    operations_of,
    row_function,
)
from controller.riccati.balls import midpoints, radii
from controller.riccati.gare import Solution
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
_TOO_LARGE = "its error is too large"


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
    began, over = time.process_time(), f"{seconds:g} s are over"
    proof = Proof(why=over)
    try:
        prover = _Prover(exact, policy, equilibrium, b)
        claim = prover.claim(wanted)
        # The cost grows with the square of the error.
        needed = prover.sampled(claim)[0] ** 2 * claim.excess
        excess = wanted if needed < wanted < _ABOVE * needed else _ABOVE * needed
        claim = prover.claim(max(excess, _SMALLEST_EXCESS))
        while (left := seconds - (time.process_time() - began)) > 0.0:
            boxes = proof.boxes
            proof = prover.searched(claim, time.process_time() + 0.5 * left, over)
            proof.boxes += boxes
            larger = prover.claim(_NEXT * claim.excess)
            if proof.is_found or larger.excess <= claim.excess:
                break
            claim = larger
    except NotListedError as error:
        proof = Proof(why=f"operation {error} has no bounds")
    except NotProvedError as error:
        proof = Proof(why=str(error))
    return proof


class _Prover:
    """Policy of a solved game about its equilibrium."""

    def __init__(
        self, exact: Solution, policy: ca.Function, equilibrium: np.ndarray, b: np.ndarray
    ) -> None:
        self.setting = setting = setting_of(exact, b)
        steps = operations_of(policy)
        rows = row_function(policy)
        assert rows is not None
        self.b, self.center, T = b, equilibrium, setting.T
        K = midpoints(setting.K) / b  # by the state
        TK = np.hstack([T, T @ K])
        steps.append(Operation("", (len(steps) - 1, 0), TK, np.zeros(len(T))))
        self.error = BoundedFunction(steps)  # T (u + K z)
        # That of T K itself, per unit of the state.
        rounding = (len(T) + 2) * 2.0**-52 * np.abs(K)
        self.error_of_K = np.abs(T) @ (radii(setting.K) / b + rounding)
        self.error_at = lambda z: T @ (rows(z.T) + z.T @ K.T).T
        n = len(b)
        self.at_rest, _ = self.error.over(equilibrium[:, None], np.zeros((n, 1)))
        self.most = largest_share(setting)
        self.inverse = np.linalg.inv(setting.S)
        self.i, self.j = np.triu_indices(n)

    def claim(self, excess: float) -> Claim:
        """Return the claim with an excess, from the box about the trim."""
        widths = (1.0 + np.abs(self.center) / self.b) * OUTWARD
        return claim_of(self.setting, excess, self.most, widths)

    def sampled(self, claim: Claim) -> tuple[float, np.ndarray]:
        """Return the largest ratio found at random states of the tube, at all distances, and the
        deviation z at which it was found, (n,).
        """
        draw = np.random.default_rng(0)
        shape = (len(self.b), _SAMPLES)
        y = draw.uniform(-1.0, 1.0, shape) * 2.0 ** -draw.uniform(0.0, 8.0, shape[1])
        y *= claim.tube[:, None]
        ratios = self.ratios(claim, y)
        worst = int(np.argmax(ratios))
        return float(ratios[worst]), y[:, worst] * self.b

    def ratios(self, claim: Claim, y: np.ndarray) -> np.ndarray:
        """Return |e| / allowed |e| at deviations y (n, N) in units of the box, (N,)."""
        e = self.error_at(self.center[:, None] + y * self.b[:, None]) - self.at_rest.x
        sizes = np.linalg.norm(self.setting.S @ y, axis=0)
        allowed = claim.allowed(np.linalg.norm(self.setting.SU @ y, axis=0) ** 2) * sizes
        is_away = np.abs(y).max(axis=0) > _AWAY
        return np.where(is_away, np.linalg.norm(e, axis=0) / np.maximum(allowed, 1e-300), 0.0)

    def bounded(
        self, claim: Claim, low: np.ndarray, high: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return bounds of the ratio |e| / allowed |e| over boxes of the tube (n, N), (N,), and the
        scores of the states, (N, n).
        """
        n, S, SU, norm = len(low), self.setting.S, self.setting.SU, np.linalg.norm
        y = 0.5 * (low + high) * claim.tube[:, None]
        h = 0.5 * (high - low) * claim.tube[:, None] * OUTWARD
        b, z = self.b[:, None], np.abs(self.center)[:, None]
        (x, Z, r), scores = self.error.over(self.center[:, None] + y * b, h * b)
        r = r + self.at_rest.r + self.error_of_K @ (z + (np.abs(y) + h) * b)
        r = r + 2.0**-50 * (np.abs(x) + np.abs(self.at_rest.x))
        x = x - self.at_rest.x
        scores = scores + np.abs(Z[:, :, :n]).sum(0)
        if Z.shape[2] > n:  # s_i² is ½ within ½
            is_square = self.i == self.j
            Z = Z * np.append(np.ones(n), np.where(is_square, 0.5, 1.0))
            Q = Z[:, :, n:]
            x = x + Q[:, :, is_square].sum(2)
            has = (self.i[:, None] == np.arange(n)) | (self.j[:, None] == np.arange(n))
            scores = scores + np.abs(Q).sum(0) @ has
        above = np.minimum(
            norm(x, axis=0) + norm(Z, axis=0).sum(1) + norm(r, axis=0),
            norm(np.abs(x) + np.abs(Z).sum(2) + r, axis=0),
        )
        value = norm(SU @ y, axis=0) + norm(SU, axis=0) @ h
        with np.errstate(all="ignore"):
            under = np.maximum(_least(S, y, h), 0.0)
            ratio = above * OUTWARD / under / claim.allowed((value * OUTWARD) ** 2)
        return np.where(np.isnan(ratio), np.inf, ratio), scores

    def central(self, claim: Claim) -> float:
        """Return the size of the largest central box in which the slope is small enough, or 0."""
        size = 1.0
        while size >= _SMALLEST:
            h = size * claim.tube
            M, R = self.error.slopes(self.center, h * self.b * OUTWARD)
            R = ((R + self.error_of_K) * self.b) @ np.abs(self.inverse)
            M = (M * self.b) @ self.inverse
            rounding = 2.0**-46 * (np.abs(M) @ np.abs(self.setting.S @ self.inverse))
            slope = float(np.linalg.norm(M, 2) + np.linalg.norm(R + rounding))
            value = (np.linalg.norm(self.setting.SU, axis=0) @ h * OUTWARD) ** 2
            if slope * OUTWARD <= claim.allowed(np.array([value]))[0]:
                return size
            size /= 2.0
        return 0.0

    def searched(self, claim: Claim, end: float, over: str) -> Proof:
        """Return the result of the search in units s of the tube, |s_i| <= 1, until `end`,
        which is told as `over`."""
        worst, at = self.sampled(claim)
        if worst > 1.0:
            return Proof(why=_TOO_LARGE, violators=[at])
        n, size = len(claim.tube), self.central(claim)
        low, high = -np.ones((n, 1)), np.ones((n, 1))
        if not size:
            if not self.error.is_homogeneous:
                return Proof(why="the policy is not smooth at its equilibrium")
            size = _SMALLEST  # the bound on the surface of this box is that within
            surface = np.repeat(size * np.eye(n), 2, axis=1) * np.tile([1.0, -1.0], n)
            edge = np.where(surface == 0.0, size, 0.0)
            low, high = np.hstack([low, surface - edge]), np.hstack([high, surface + edge])
        batch = max(_FEWEST, _NUMBERS // (self.error.width * (n + len(self.i))))
        proof = Proof()
        while low.shape[1] and time.process_time() < end:
            lower, upper = low[:, -batch:], high[:, -batch:]
            low, high = low[:, :-batch], high[:, :-batch]
            volume = np.prod((upper - lower) / 2.0, axis=0)
            ratio, scores = self.bounded(claim, lower, upper)
            is_central = (np.abs(lower) <= size) & (np.abs(upper) <= size) & (lower < upper)
            is_good = (ratio <= 1.0) | is_central.all(0)
            proof.boxes += lower.shape[1]
            proof.share += float(volume[is_good].sum())
            lower, upper, ratio = lower[:, ~is_good], upper[:, ~is_good], ratio[~is_good]
            true = self.ratios(claim, 0.5 * (lower + upper) * claim.tube[:, None])
            if (true > 1.0).any():
                worst_first = np.argsort(-true)[: min(_KEPT, int((true > 1.0).sum()))]
                at = 0.5 * (lower + upper)[:, worst_first] * (claim.tube * self.b)[:, None]
                proof.why, proof.violators = _TOO_LARGE, list(at.T)
                return proof
            # Cut the state with the largest score; the worst boxes come next.
            scores = np.where((upper > lower).T, scores[~is_good] * 1.0 + 1e-300, 0.0)
            i, k = np.argmax(np.nan_to_num(scores, posinf=1e300), axis=1), np.arange(len(ratio))
            low2, high2 = lower.copy(), upper.copy()
            upper[i, k] = low2[i, k] = 0.5 * (lower[i, k] + high2[i, k])
            order = np.argsort(np.concatenate([ratio, ratio]), kind="stable")
            low = np.hstack([low, np.hstack([lower, low2])[:, order]])
            high = np.hstack([high, np.hstack([upper, high2])[:, order]])
        proof.why = over
        if not low.shape[1]:
            proof.why, proof.share, proof.excess = "", 1.0, claim.excess
        return proof


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
