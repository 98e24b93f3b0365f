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
    operations_of,
    row_function,
)
from controller.riccati.balls import midpoints, radii
from controller.riccati.gare import Solution
from verification.network.bounds import BoundedFunction
from verification.network.theorem import (
    Claim,
    NotProvedError,
    Setting,
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
#: Excess that is tried, relative to that which the largest error found requires, and share of the
#: time for a claim before a larger one is tried.
_ABOVE, _FIRST = 1.3, 0.6
_TIME = "the time is over"
#: Smallest bound that is tried.
_SMALLEST_EXCESS = 1e-5
#: Margin of the bounds, far above the rounding of roots and norms.
_MARGIN = 1e-9
#: Number of violators that are kept.
_KEPT = 8


def proof_of(
    exact: Solution,
    policy: ca.Function,
    equilibrium: np.ndarray | None,
    b: np.ndarray,
    wanted: float,
    seconds: float,
) -> Proof:
    """Return what is proved of a policy within a time.

    equilibrium: about which it is proved, or None if none is known
    b: half-widths of the box of states, (n,)
    wanted: bound of the cost above the optimum that is tried first, relative
    seconds: of the processor
    """
    end = time.process_time() + seconds
    try:
        if equilibrium is None:
            raise NotProvedError("no equilibrium near the trim is found")
        return _best_proof(_Prover(exact, policy, equilibrium, b), wanted, end)
    except NotListedError as error:
        return Proof(why=f"operation {error} has no bounds")
    except NotProvedError as error:
        return Proof(why=str(error))


def _best_proof(prover: _Prover, wanted: float, end: float) -> Proof:
    """Return the smallest bound of the cost that is proved: `wanted`, then a smaller one, or larger
    ones up to the largest of the theorem.
    """
    best, excess, began = Proof(why=_TIME), wanted, time.process_time()
    tried: set[float] = set()
    while time.process_time() < end:
        try:
            claim = prover.claim(excess)
        except NotProvedError as error:
            return best if math.isfinite(best.excess) else Proof(why=str(error))
        if claim.excess in tried:
            return best
        tried.add(claim.excess)
        worst, at = prover.sampled(claim)
        # The cost grows with the square of the error.
        nearest = _ABOVE * worst**2 * claim.excess
        if worst > 1.0:
            proof = Proof(why="its error is too large", violators=[at])
        else:
            share = _FIRST if excess <= wanted else 1.0
            now = time.process_time()
            proof = _Search(prover, claim).run(now + share * (end - now))
        proof = replace(proof, boxes=proof.boxes + best.boxes)
        if math.isfinite(proof.excess):
            best, excess = proof, max(nearest, 0.01 * proof.excess, _SMALLEST_EXCESS)
            is_late = time.process_time() - began > 0.3 * (end - began)
            if excess > 0.5 * proof.excess or is_late:
                return best
        elif math.isfinite(best.excess):  # a smaller bound is not proved
            return replace(best, boxes=proof.boxes)
        else:
            best = proof
            excess = max(nearest, 1.2 * claim.excess) if proof.violators else 1.0
    return best


class _Prover:
    """Policy of a solved game about its equilibrium, in units of the box."""

    def __init__(
        self, exact: Solution, policy: ca.Function, equilibrium: np.ndarray, b: np.ndarray
    ) -> None:
        self.setting: Setting = setting_of(exact, b)
        steps = operations_of(policy)
        rows = row_function(policy)
        assert rows is not None
        self.rows = rows
        self.b, self.center = b, equilibrium
        K = midpoints(self.setting.K) / b  # by the state
        T = self.setting.T
        last = len(steps) - 1
        steps += [
            Operation("product", (0,), K),
            Operation("add", (last, last + 1)),
            Operation("product", (last + 2,), T),
        ]
        self.error = BoundedFunction(steps)  # T (u + K z)
        # That of K itself, per unit of the state: the radius of its enclosure, and its rounding.
        self.error_of_K = np.abs(T) @ (radii(self.setting.K) / b + 2.0**-52 * np.abs(K))
        self.K = K
        n = len(b)
        at = self.error.over(self.center[:, None], np.zeros((n, 1))).form
        self.at_rest, self.radius_at_rest = at.x, at.r
        self.most = largest_share(self.setting)
        self.widths = 1.0 + np.abs(equilibrium) / b * (1.0 + 1e-6)

    def claim(self, excess: float) -> Claim:
        """Return the claim with an excess."""
        return claim_of(self.setting, excess, self.most, self.widths)

    def ratios(self, claim: Claim, y: np.ndarray) -> np.ndarray:
        """Return |e| / allowed |e| at deviations y (n, N) in units of the box, (N,)."""
        z = (self.center[:, None] + y * self.b[:, None]).T
        e = self.setting.T @ (self.rows(z) + z @ self.K.T).T - self.at_rest
        sizes = np.linalg.norm(self.setting.S @ y, axis=0)
        allowed = claim.allowed((np.linalg.norm(self.setting.SU @ y, axis=0)) ** 2) * sizes
        # At less than 1e-9 of the box, the error is rounding.
        is_away = np.abs(y).max(axis=0) > 1e-9
        return np.where(is_away, np.linalg.norm(e, axis=0) / np.maximum(allowed, 1e-300), 0.0)

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


class _Search:
    """Branch and bound of one claim, in units s of the tube, |s_i| <= 1."""

    def __init__(self, prover: _Prover, claim: Claim) -> None:
        self.prover, self.claim = prover, claim
        setting = prover.setting
        self.inverse = np.linalg.inv(setting.S)
        n = len(claim.tube)
        self.i, self.j = np.triu_indices(n)
        # |y - y'| of the exact equilibrium y' and the computed one, in the norms of W and of U
        self.off = self.off_value = 0.0
        self.off_each = np.zeros((n, 1))  # of each state
        self.central = self._central()
        # The exact equilibrium is the fixed point of y = -F⁻¹ B e(y), a contraction where e has a
        # slope below ρ (small gain): it is as near as the residual says.
        if np.any(prover.center):
            if not self.central:
                raise NotProvedError("the policy is not smooth at its equilibrium")
            self.off = self._distance_of_equilibrium()
            self.off_value = float(np.linalg.norm(setting.SU @ self.inverse, 2)) * self.off
            self.off_each = self.off * np.linalg.norm(self.inverse, axis=1)[:, None]

    def _distance_of_equilibrium(self) -> float:
        """Return a bound of |y - y'|_W between the computed equilibrium and the exact one."""
        prover, setting = self.prover, self.prover.setting
        F, B = midpoints(setting.flown[0].F), midpoints(setting.B)
        left = F - np.eye(len(F)) if setting.is_discrete else F
        inverse = np.linalg.inv(left)
        y = prover.center / prover.b
        # F y + B e, with its rounding
        e = np.linalg.solve(setting.T, prover.at_rest[:, 0])
        e_radius = np.abs(np.linalg.inv(setting.T)) @ (
            prover.radius_at_rest[:, 0] + prover.error_of_K @ np.abs(prover.center)
        )
        sizes = np.abs(left) @ np.abs(y) + np.abs(B) @ np.abs(e)
        residual = np.abs(left @ y + B @ e) + np.abs(B) @ e_radius + 64 * 2.0**-52 * sizes
        gain = float(np.linalg.norm(setting.S @ inverse @ B @ np.linalg.inv(setting.T), 2))
        contraction = gain * float(self.claim.shares[-1]) * (1.0 + 1e-6)
        distance = float(np.linalg.norm(np.abs(setting.S @ inverse) @ residual)) * (1.0 + 1e-6)
        if not contraction < 0.999:
            raise NotProvedError("the equilibrium is not proved")
        distance /= 1.0 - contraction
        inside = self.central * self.claim.tube / np.linalg.norm(self.inverse, axis=1)
        if not distance < 0.5 * inside.min():
            raise NotProvedError("the equilibrium is not proved")
        return distance

    def _central(self) -> float:
        """Return the size of the largest central box in which the slope is small enough, or 0."""
        size = 1.0
        while size >= _SMALLEST:
            whole = np.full((len(self.claim.tube), 1), size)
            if self.bounded(-whole, whole)[0][0] <= 1.0:
                return size
            size /= 2.0
        return 0.0

    def bounded(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return bounds of the ratio |e| / allowed |e| over boxes (n, N), (N,), and the scores of
        the states, (N, n).
        """
        prover, setting, claim = self.prover, self.prover.setting, self.claim
        y = 0.5 * (low + high) * claim.tube[:, None]
        h = 0.5 * (high - low) * claim.tube[:, None]
        b = prover.b[:, None]
        # With the exact equilibrium in each box that has the computed one.
        bounds = prover.error.over(prover.center[:, None] + y * b, (h + self.off_each) * b)
        x, C, Q, r = bounds.form
        r = (
            r
            + prover.radius_at_rest
            + prover.error_of_K @ (np.abs(prover.center)[:, None] + (np.abs(y) + h) * b)
        )
        r = r + 4 * 2.0**-52 * (np.abs(x) + np.abs(prover.at_rest))
        x = x - prover.at_rest
        scores = bounds.scores + np.abs(C).sum(0)
        norm = np.linalg.norm
        columns = norm(C, axis=0).sum(1)
        rows = np.abs(C).sum(2)
        if Q is not None:  # s_i² is ½ within ½
            is_square = self.i == self.j
            x = x + 0.5 * Q[:, :, is_square].sum(2)
            Q = Q * np.where(is_square, 0.5, 1.0)
            columns = columns + norm(Q, axis=0).sum(1)
            rows = rows + np.abs(Q).sum(2)
            states = np.arange(len(low))
            scores = scores + np.abs(Q).sum(0) @ (
                (self.i[:, None] == states) | (self.j[:, None] == states)
            )
        above = np.minimum(
            norm(x, axis=0) + columns + norm(r, axis=0), norm(np.abs(x) + rows + r, axis=0)
        )
        share = claim.shares[-1] * self.off
        under = _least(setting.S, y, h) - self.off
        with np.errstate(all="ignore"):
            ratio = np.where(under > 0.0, (above + share) / under, np.inf)
        ratio = np.where(np.isnan(ratio), np.inf, ratio)
        has_rest = np.flatnonzero((np.abs(y) <= h).all(0))
        if has_rest.size:
            M, R = prover.error.slopes(bounds, has_rest)
            M, R = (
                M * b[:, 0] @ self.inverse,
                (R + prover.error_of_K[:, None]) * b[:, 0] @ np.abs(self.inverse),
            )
            R = R + 16 * 2.0**-52 * (np.abs(M) @ np.abs(setting.S @ self.inverse))
            slopes = np.array([norm(M[:, k], 2) + norm(R[:, k]) for k in range(len(has_rest))])
            ratio[has_rest] = np.fmin(ratio[has_rest], slopes)
        value = norm(setting.SU @ y, axis=0) + norm(setting.SU, axis=0) @ h + self.off_value
        allowed = claim.allowed((value * (1.0 + _MARGIN)) ** 2)
        return ratio * (1.0 + _MARGIN) / allowed, scores

    def _homogeneous(self) -> bool:
        """Return whether e is positively homogeneous in the smallest box: piecewise linear, with
        kinks exactly at the trim.
        """
        error, n = self.prover.error, len(self.claim.tube)
        if np.any(self.prover.center) or not error.is_piecewise_linear:
            return False
        at = np.zeros((n, 1))
        near = error.over(
            at, np.full((n, 1), _SMALLEST) * (self.claim.tube * self.prover.b)[:, None]
        )
        values = error.over(at, at)
        for operation, of_box, of_rest in zip(
            error.operations, near.ranges, values.ranges, strict=True
        ):
            if operation.kind == "relu":
                (low, high), (least, most) = of_box[0], of_rest[0]
                if not ((low > 0.0) | (high < 0.0) | (least == 0.0) & (most == 0.0)).all():
                    return False
        return True

    def run(self, end: float) -> Proof:
        """Return the result of the search until `end`."""
        claim, prover, size = self.claim, self.prover, self.central
        n = len(claim.tube)
        boxes = [(-np.ones((n, 1)), np.ones((n, 1)))]
        if not size:
            if not self._homogeneous():
                return Proof(why="the policy is not smooth at its equilibrium", violators=[])
            size = _SMALLEST
            for i in range(n):  # the bound on the surface of the smallest box is that within
                for side in (-size, size):
                    low, high = np.full((n, 1), -size), np.full((n, 1), size)
                    low[i] = high[i] = side
                    boxes.append((low, high))
        low, high = (np.hstack([box[k] for box in boxes]) for k in (0, 1))
        batch = max(_FEWEST, _NUMBERS // (prover.error.width * (n + len(self.i))))
        proof, largest = Proof(), 0.0
        found: list[tuple[float, np.ndarray]] = []
        while low.shape[1] and time.process_time() < end:
            lower, upper = low[:, -batch:], high[:, -batch:]
            low, high = low[:, :-batch], high[:, :-batch]
            volume = np.prod((upper - lower) / 2.0, axis=0)
            is_central = ((np.abs(lower) <= size) & (np.abs(upper) <= size)).all(0) & (
                lower < upper
            ).all(0)
            proof.share += float(volume[is_central].sum())
            lower, upper, volume = lower[:, ~is_central], upper[:, ~is_central], volume[~is_central]
            if not lower.shape[1]:
                continue
            ratio, scores = self.bounded(lower, upper)
            proof.boxes += lower.shape[1]
            is_good = ratio <= 1.0
            proof.share += float(volume[is_good].sum())
            largest = max(largest, float(ratio[is_good].max(initial=0.0)))
            lower, upper, ratio, scores = (
                lower[:, ~is_good],
                upper[:, ~is_good],
                ratio[~is_good],
                scores[~is_good],
            )
            if not lower.shape[1]:
                continue
            y = 0.5 * (lower + upper) * claim.tube[:, None]
            true = prover.ratios(claim, y)
            is_wrong = true > 1.0
            if is_wrong.any():
                found += [(float(true[k]), y[:, k]) for k in np.flatnonzero(is_wrong)]
                found = sorted(found, key=lambda each: -each[0])[:_KEPT]
                break
            # Cut the state with the largest score; the worst boxes come next.
            scores = np.where((upper > lower).T, scores + 1e-300, 0.0)
            i, k = np.argmax(np.nan_to_num(scores, posinf=1e300), axis=1), np.arange(lower.shape[1])
            low2, high2 = lower.copy(), upper.copy()
            upper[i, k] = low2[i, k] = 0.5 * (lower[i, k] + high2[i, k])
            order = np.argsort(np.concatenate([ratio, ratio]), kind="stable")
            low = np.hstack([low, np.hstack([lower, low2])[:, order]])
            high = np.hstack([high, np.hstack([upper, high2])[:, order]])
        proof.violators = [each * prover.b for _, each in found]
        if found:
            proof.why = "its error is too large"
        elif low.shape[1]:
            proof.why = _TIME
        else:
            proof.excess, proof.share = claim.excess, 1.0
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
    row = S.T @ v
    size = np.linalg.norm(v, axis=0)
    least = (row * c).sum(0) - (np.abs(row) * h).sum(0)
    return np.where(size > 0.0, least / np.maximum(size, 1e-300), 0.0)
