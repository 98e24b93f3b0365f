"""A critic that is a nonlinear function of the state: its errors searched over a box of states, and
flown from there.

What a search or a flight finds is a lower bound of the largest error, cost or gain.
"""

from __future__ import annotations

import math
import warnings
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from controller.riccati.gare import Solution
from hfa_support.native.bound import BoundFunction
from hfa_support.reporting.checks import Check, at_most
from verification.critic.critic_errors import SMALL

#: States from which the search starts, half of them corners of the box, and from how many of each
#: kind it climbs.
STARTS, CLIMBS = 1000, 3
#: A flight ends when the exact loop has decayed to exp(-`DECAY`), in so many steps at most; from
#: how many starts the largest box is sought, among 1, 2, ... 2^`DOUBLINGS` times the box and its
#: parts.
DECAY, STEPS, FEW, DOUBLINGS = 5.0, 1000, 6, 4
#: A flight has returned where V* has come down to this part.
RETURNED = 0.05
SAID = {"value": "V", "gradient": "a slope of V", "policy": "the policy"}


class Found(NamedTuple):
    """The largest error that was found: relative, of `name`, at the state z (n,)."""

    name: str
    error: float
    at: np.ndarray


class NetworkSearch(NamedTuple):
    """What was found of a function of the state beside its linearization, over the box; the names
    are those of JSON.

    cost_lost_flown_percent: of V*, beyond the optimum, at most, from `flights` starts. reach: the
    largest multiple of the box from which it returns, on the linear plant, on the nonlinear one,
    and there of the exact policy, None where that is not known. The others as in `Nonlinear`."""

    output: str
    precision: str
    value_at_origin: float
    searched: tuple[Found, ...] = ()
    flights: int = 0
    cost_lost_flown_percent: float = 0.0
    cost_lost_flown_mean_percent: float = 0.0
    reach: float = math.nan
    reach_nonlinear: float | None = None
    reach_nonlinear_exact: float | None = None

    @property
    def said(self) -> tuple[str, ...]:
        """For a report."""
        constant = f", V(0) = {self.value_at_origin:.4g}" if "V" in self.output else ""
        if not self.searched:
            return (f"Polynomial, {self.precision} weights{constant}",)
        errors = [
            f"{SAID[name]} {error:.3g} at ({', '.join(f'{z:.3g}' for z in at)})"
            for name, error, at in self.searched
        ]
        far = f"{self.reach:g} times the box on the linear plant"
        if self.reach_nonlinear is not None:
            far += f", {self.reach_nonlinear:g} times on the nonlinear one"
            far += f" (the exact policy {self.reach_nonlinear_exact:g})"
        return (
            f"Network of {self.output}, {self.precision} weights, linearized exactly at the origin{constant}",
            f"Largest errors in the box (searched, {STARTS} starts; not a bound): {'; '.join(errors)}",
            f"Flown from {self.flights} starts in the box (not a bound): cost lost {self.cost_lost_flown_percent:.3g} "
            f"percent at most, {self.cost_lost_flown_mean_percent:.3g} on average",
            f"Returns to trim from {far} ({FEW} starts each, doubled up to {2**DOUBLINGS})",
        )

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        starts = STARTS if self.searched else 0
        return self._asdict() | {
            "starts": starts,
            "searched": [each._asdict() for each in self.searched],
        }


def network_checks(
    game: Game,
    critic: Critic,
    exact: Solution,
    b: np.ndarray,
    limit: float,
    flights: int,
    plant: ca.Function | None = None,
) -> tuple[list[Check], NetworkSearch]:
    """Checks of the errors at the origin and of those that `search` finds over the box |z_i| <=
    b_i.

    plant: (z, u) -> z', the nonlinear plant about its trim. flights: 0 where the linear loop is
    unstable."""
    outputs = ("gradient",) if "V" not in critic.network else ("V",)
    output = " and ".join(name for name in (*outputs, "policy") if name in critic.network)
    facts = NetworkSearch(output or "V", critic.precision, critic.constant)
    if not critic.network:
        return [], facts
    origin, found = search(game, critic, exact, b)
    off = "u is" if critic.gradient is None else "the slopes of V are"
    checks = [
        at_most(
            "origin_error",
            origin,
            limit,
            f"{off} off by {origin:.2g} at the origin, where 0 is right",
        )
    ]
    for name, error, _ in found:
        checks.append(
            at_most(
                f"searched_{name}_error",
                error,
                limit,
                f"{SAID[name]} is off by {error:.2g} in the box",
            )
        )
    if not flights:
        return checks, NetworkSearch(*facts[:3], found, 0, math.inf, math.inf, reach=0.0)
    losses = flown_losses(game, critic, exact, b, flights)
    z = ca.SX.sym("z", len(b))
    u = critic.policy(z)
    rates = [ca.DM(game.A) @ z + ca.DM(game.B) @ u]
    rates += [plant(z, each) for each in (u, -ca.DM(exact.K) @ z) if plant is not None]
    mean, *far = float(losses.mean()), *(reach(_Flight(z, each), exact, game, b) for each in rates)
    return checks, NetworkSearch(*facts[:3], found, flights, float(losses.max()), mean, *far)


def search(
    game: Game, critic: Critic, exact: Solution, b: np.ndarray
) -> tuple[float, tuple[Found, ...]]:
    """The largest error at the origin, and those found over the box |z_i| <= b_i: of V, of any
    dV/dz_i, of any input.

    Each relative to the largest of the exact V, dV/dz_i or u_i in the box; V but for its constant,
    on which no policy depends. Of `STARTS` states the `CLIMBS` worst corners and the `CLIMBS` worst
    others are where L-BFGS-B starts to climb."""
    from scipy.optimize import minimize

    z = ca.SX.sym("z", len(b))
    names, errors = _errors(game, critic, exact, b, z)
    w = ca.SX.sym("w", len(names))
    values = ca.Function("values", [z], [errors])
    slopes = ca.Function("slopes", [z, w], [ca.jtimes(errors, z, w, True)])

    def climbed(weights: np.ndarray, start: np.ndarray) -> tuple[float, np.ndarray]:
        """The largest weights'values(b y) on the way up from y = start, |y_i| <= 1, and y; inf
        where it is nan."""

        def descent(y: np.ndarray) -> tuple[float, np.ndarray]:
            return -float(weights @ np.array(values(b * y)).ravel()), -np.array(
                slopes(b * y, weights)
            ).ravel() * b

        inside = [(-1.0, 1.0)] * len(b)
        end = minimize(
            descent, start, jac=True, method="L-BFGS-B", bounds=inside, options={"maxiter": 25}
        )
        return (-float(end.fun) if math.isfinite(end.fun) else math.inf), end.x

    starts = _starts(np.ones(len(b)), STARTS, seed=0)
    found: dict[str, Found] = {}
    for name, sampled, unit in zip(
        names, np.array(values((b * starts).T)), np.eye(len(names)), strict=True
    ):
        sizes = np.where(np.isfinite(sampled), np.abs(sampled), math.inf)
        order = np.argsort(-sizes, kind="stable")
        ends = [(float(sizes[order[0]]), starts[order[0]])]
        if math.isfinite(ends[0][0]):
            from_here = [order[0], *order[order % 2 == 0][:CLIMBS], *order[order % 2 == 1][:CLIMBS]]
            ends += [
                climbed(np.copysign(unit, sampled[place]), starts[place]) for place in from_here
            ]
        error, at = max(ends, key=lambda end: end[0])
        if name not in found or error > found[name].error:
            found[name] = Found(name, error, b * at)
    at_origin = np.abs(np.array(values(np.zeros(len(b)))))
    return float(np.where(np.isfinite(at_origin), at_origin, math.inf).max()), tuple(found.values())


def _errors(
    game: Game, critic: Critic, exact: Solution, b: np.ndarray, z: ca.SX
) -> tuple[list[str], Any]:
    """Names of the relative errors, and the errors themselves, of the symbols z."""
    P = ca.DM(exact.P)
    scale, parts = np.sqrt(np.diag(game.R)), []
    if critic.value is not None:
        parts.append(
            (
                "value",
                critic.value(z) - critic.constant - z.T @ P @ z,
                b[None] @ np.abs(exact.P) @ b,
            )
        )
    if critic.gradient is not None:
        parts.append(
            ("gradient", critic.gradient(z) - 2.0 * P @ z, _floored(2.0 * np.abs(exact.P) @ b))
        )
    sizes = _floored(scale * (np.abs(exact.K) @ b)) / scale
    parts.append(("policy", critic.policy(z) + ca.DM(exact.K) @ z, sizes))
    names = [name for name, _, sizes in parts for _ in sizes]
    return names, ca.vertcat(*(error / ca.DM(sizes) for _, error, sizes in parts))


def _floored(sizes: np.ndarray) -> np.ndarray:
    """As in `entry_error`: small ones are compared with a part of the largest."""
    return np.maximum(sizes, SMALL * sizes.max() or 1.0)


class _Flight:
    """z' = rates(z) and cost' = running(z), CasADi expressions of z (n,), integrated by LSODA."""

    def __init__(self, z: Any, rates: Any, running: Any = 0.0) -> None:
        y = ca.vertcat(z, ca.SX.sym("cost"))
        self._bound = BoundFunction(
            ca.Function("slopes", [y], [ca.densify(ca.vertcat(rates, running))])
        )

    def _slopes(self, y: np.ndarray, _: float) -> np.ndarray:
        self._bound.inputs[0][:] = y
        self._bound()
        return self._bound.results[0]

    def end(self, start: np.ndarray, time: float) -> tuple[np.ndarray, float] | None:
        """z (n,) at the time from z(0) = start, and the cost; None where LSODA gives up or a number
        is not finite."""
        from scipy.integrate import odeint

        steps = {
            "rtol": 1e-7,
            "atol": 1e-9 * np.abs(start).max(),
            "mxstep": STEPS,
            "full_output": True,
        }
        with (
            np.errstate(all="ignore"),
            warnings.catch_warnings(action="ignore"),
        ):  # of LSODA, where it gives up
            (_, end), about = odeint(self._slopes, np.append(start, 0.0), [0.0, time], **steps)
        good = about["message"] == "Integration successful." and np.all(np.isfinite(end))
        return (end[:-1], float(end[-1])) if good else None

    def returned(
        self, start: np.ndarray, exact: Solution, game: Game
    ) -> tuple[np.ndarray, float] | None:
        """`end` when the exact loop has decayed to exp(-`DECAY`); None where V* has not come down
        to `RETURNED`."""
        end = self.end(start, DECAY / abs(spectrum(game.A - game.B @ exact.K).abscissa))
        home = end is not None and end[0] @ exact.P @ end[0] <= RETURNED * (start @ exact.P @ start)
        return end if home else None


def _starts(b: np.ndarray, count: int, seed: int = 1) -> np.ndarray:
    """States of the box, every other one a corner: (count, n)."""
    starts = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(b)))
    starts[::2] = np.sign(starts[::2])
    return starts * b


def flown_losses(
    game: Game, critic: Critic, exact: Solution, b: np.ndarray, flights: int
) -> np.ndarray:
    """Percent of V* that u(z), with the gain K at the origin, costs more than u* from each start in
    the box: (flights,); all inf where it does not return from one.

    Under d = L* z, the worst disturbance of the exact policies, J - V* = ∫ (u - u*)'R(u - u*) dt.
    What comes after the end is that of the linear loop."""
    from scipy.linalg import solve_continuous_lyapunov

    A, lost = game.A + game.E @ exact.disturbance_gain, []
    z = ca.SX.sym("z", len(b))
    u = critic.policy(z)
    loop, change = A - game.B @ critic.K, critic.K - exact.K
    if spectrum(loop).abscissa >= 0.0:
        return np.full(flights, math.inf)
    rest = solve_continuous_lyapunov(loop.T, -change.T @ game.R @ change)
    away = u + ca.DM(exact.K) @ z
    flight = _Flight(z, ca.DM(A) @ z + ca.DM(game.B) @ u, away.T @ ca.DM(game.R) @ away)
    for start in _starts(b, flights):
        if (found := flight.returned(start, exact, game)) is None:
            return np.full(flights, math.inf)
        lost.append(
            100.0 * float((found[1] + found[0] @ rest @ found[0]) / (start @ exact.P @ start))
        )
    return np.array(lost)


def reach(flight: _Flight, exact: Solution, game: Game, b: np.ndarray) -> float:
    """The largest of 2^-k ... 2^k times the box, k = `DOUBLINGS`, such that a flight returns from
    `FEW` starts in it and in each smaller one tried; 0 for none."""

    def returns(size: float) -> bool:
        return all(
            flight.returned(start, exact, game) is not None for start in size * _starts(b, FEW)
        )

    sizes = 2.0 ** np.arange(-DOUBLINGS, DOUBLINGS + 1)
    if not returns(1.0):
        return next((float(size) for size in sizes[DOUBLINGS - 1 :: -1] if returns(size)), 0.0)
    lost = next(
        (place for place, size in enumerate(sizes) if size > 1.0 and not returns(size)), len(sizes)
    )
    return float(sizes[lost - 1])
