"""A critic that is a nonlinear function of the state: its errors searched over a box of states, and
flown from there.

What a search or a flight finds is a lower bound of the largest error, cost or gain; a proof gives
an upper bound of the error.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from hfa_support.native.bound import BoundFunction
from hfa_support.reporting.checks import Check, at_most
from verification.critic.about_trim import NonlinearPlant
from verification.critic.critic_errors import SMALL, Exact, error_check
from verification.critic.network_bound import Proof, prove
from verification.critic.verdict import Section

if TYPE_CHECKING:
    from verification.critic.scope import Scope

#: States at which the errors are computed, half of them corners of the box.
STARTS = 1000
#: From how many corners and how many others a search climbs.
CLIMBS = 3
#: From how many starts a wide network is flown: a policy of it takes 2 to 20 ms.
_WIDE_FLIGHTS = 2
#: A flight ends when the exact loop has decayed to exp(-`DECAY`).
DECAY = 5.0
#: Steps of LSODA in a flight, at most.
STEPS = 1000
#: A flight has returned where V* has come down to this part.
RETURNED = 0.05
#: From how many starts at most the largest box is sought, among 2^-`DOUBLINGS` ...
#: 2^`DOUBLINGS` times the box.
FEW = 6
DOUBLINGS = 4
#: Newton steps to a rest point, and its largest distance, in boxes.
_NEWTON_STEPS = 30
_FARTHEST_REST = 100.0
#: How often a search begins again at a state that a proof came upon.
_SEARCHES = 3
#: Of a policy that is not exact this much more than the largest error found is to be proved.
_MARGIN = 1.25
_NOUNS = {"value": "V", "gradient": "a slope of V", "policy": "the policy"}


class Found(NamedTuple):
    """The largest error that was found: relative, of `name`, at the state z (n,)."""

    name: str
    error: float
    at: np.ndarray


class Flown(NamedTuple):
    """What flights of a network from the box showed; the names are those of the JSON.

    flights: from how many starts; 0 where the linear loop is unstable.
    cost_lost_flown_percent: beyond V*, at most.
    cost_lost_flown_mean_percent: on average.
    rest_point: (n,), where the linear loop comes to rest; None for nowhere.
    reach: the largest multiple of the box from which it returns, on the linear plant.
    reach_nonlinear: on the nonlinear plant; None without one.
    reach_nonlinear_exact: there, of the exact policy.
    """

    flights: int = 0
    cost_lost_flown_percent: float = math.inf
    cost_lost_flown_mean_percent: float = math.inf
    rest_point: np.ndarray | None = None
    reach: float = 0.0
    reach_nonlinear: float | None = None
    reach_nonlinear_exact: float | None = None


class Findings(NamedTuple):
    """errors: at the origin and in the box. checks: these, and that of the rest point."""

    errors: list[Check]
    checks: list[Check]
    proof: Proof | None
    flown: Flown
    section: Section


def findings(
    game: Game, critic: Critic, exact: Exact, b: np.ndarray, limit: float, scope: Scope
) -> Findings:
    """Search a network over the box |z_i| <= b_i, prove a bound, and fly it from there, if its
    linear loop is stable."""
    origin, worst, proof = _searched_and_proved(game, critic, exact, b, limit, scope)
    errors = search_checks(critic, origin, worst, limit)
    checks = list(errors)
    flown = Flown()
    if spectrum(game.A - game.B @ critic.K).abscissa < 0.0:
        flights = min(scope.flights, _WIDE_FLIGHTS) if critic.wide else scope.flights
        flown = fly(game, critic, exact, b, flights, scope.plant)
        checks.append(rest_check(flown.rest_point, b, limit))
    section = network_section(critic, b, worst, proof, flown)
    return Findings(errors, checks, proof, flown, section)


# The search and the proof.


def _searched_and_proved(
    game: Game, critic: Critic, exact: Exact, b: np.ndarray, limit: float, scope: Scope
) -> tuple[float, tuple[Found, ...], Proof | None]:
    """What `search` finds, and a proof: of the limit for all errors where no larger one is found,
    else of `_MARGIN` times what the policy is off.

    A larger error that the proof comes upon is searched from there.
    """
    z = critic.symbols
    names, errors = _errors(game, critic, exact, b, z)
    end = time.monotonic() + scope.seconds
    origin, worst = search(game, critic, exact, b)
    proof = None
    seconds = 0.0 if critic.wide else scope.seconds  # its operations are bounded one by one
    for _ in range(_SEARCHES if seconds else 0):
        largest = {item.name: item.error for item in worst}
        what = "error"
        bound = limit
        if max(largest.values()) > limit:
            what = "error of the policy"
            errors = errors[[index for index, name in enumerate(names) if name == "policy"]]
            names = ["policy"] * errors.numel()
            if largest["policy"] > limit:
                bound = _rounded_up(_MARGIN * largest["policy"])
        function = ca.Function("errors", [z], [errors])
        proof = prove(what, function, b, bound, end - time.monotonic(), scope.progress)
        if proof is None or proof.beyond is None:
            break
        origin, worst = search(game, critic, exact, b, proof.beyond)
    return origin, worst, proof


def _rounded_up(number: float) -> float:
    """To two digits."""
    if not math.isfinite(number):
        return number
    digit = 10.0 ** (math.floor(math.log10(number)) - 1)
    return float(f"{math.ceil(number / digit) * digit:.2g}")


def search_checks(
    critic: Critic, origin: float, found: tuple[Found, ...], limit: float
) -> list[Check]:
    """The checks of what `search` found."""
    what = "u" if critic.gradient is None else "the slope of V"
    checks = [error_check("origin_error", origin, limit, f"{what} at the origin")]
    for item in found:
        what = f"{_NOUNS[item.name]} in the box"
        checks.append(error_check(f"searched_{item.name}_error", item.error, limit, what))
    return checks


def search(
    game: Game, critic: Critic, exact: Exact, b: np.ndarray, also: np.ndarray | None = None
) -> tuple[float, tuple[Found, ...]]:
    """The largest error at the origin, and those found over the box |z_i| <= b_i: of V, of any
    dV/dz_i, of any input.

    Each is relative to the largest of the exact V, dV/dz_i or u_i in the box; V but for its
    constant, on which no policy depends. L-BFGS-B climbs each error from the `CLIMBS` worst corners
    and the `CLIMBS` worst others of `STARTS` states, of a wide network from the worst state alone,
    and from the state `also` (n,). All errors are compared at all states that any climb reaches.
    """
    z = critic.symbols
    names, errors = _errors(game, critic, exact, b, z)
    values = ca.Function("values", [z], [errors])
    climb = _climber(errors, z, b)
    climbs = 0 if critic.wide else CLIMBS
    starts = _starts(np.ones(len(b)), STARTS, seed=0)
    if also is not None:
        starts = np.vstack([starts, also / b])
    ends = []
    for sampled, unit in zip(np.array(values((b * starts).T)), np.eye(len(names)), strict=True):
        sizes = np.where(np.isfinite(sampled), np.abs(sampled), math.inf)
        order = np.argsort(-sizes, kind="stable")
        ends.append(starts[order[0]])
        if not math.isfinite(sizes[order[0]]):
            continue
        corners = order[order % 2 == 0][:climbs]
        inside = order[order % 2 == 1][:climbs]
        for index in (order[0], *corners, *inside, *range(STARTS, len(starts))):
            ends.append(climb(np.copysign(unit, sampled[index]), starts[index]))
    reached = b * np.array(ends)
    sizes = _sizes(values(reached.T))
    largest: dict[str, Found] = {}
    for name, row in zip(names, sizes, strict=True):
        worst = int(np.argmax(row))
        if name not in largest or row[worst] > largest[name].error:
            largest[name] = Found(name, float(row[worst]), reached[worst])
    return float(_sizes(values(np.zeros(len(b)))).max()), tuple(largest.values())


def _sizes(values: ca.DM) -> np.ndarray:
    sizes = np.abs(np.array(values))
    return np.where(np.isfinite(sizes), sizes, math.inf)


def _climber(
    errors: ca.SX, z: ca.SX, b: np.ndarray
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """(weights, y) -> where weights'errors(b y), |y_i| <= 1, is largest on the way up from y."""
    from scipy.optimize import minimize

    w = type(z).sym("w", errors.numel())
    weighted = ca.dot(w, errors)
    ascent = ca.Function("ascent", [z, w], [weighted, ca.gradient(weighted, z)])

    def climb(weights: np.ndarray, start: np.ndarray) -> np.ndarray:
        def descent(y: np.ndarray) -> tuple[float, np.ndarray]:
            value, slope = ascent(b * y, weights)
            return -float(value), -np.array(slope).ravel() * b

        bounds = [(-1.0, 1.0)] * len(b)
        end = minimize(
            descent, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 25}
        )
        return np.asarray(end.x)

    return climb


def _errors(
    game: Game, critic: Critic, exact: Exact, b: np.ndarray, z: ca.SX
) -> tuple[list[str], ca.SX]:
    """Names of the relative errors, and the errors themselves, of the symbols z."""
    P = ca.DM(exact.P)
    scale = np.sqrt(np.diag(game.R))
    parts = []
    if critic.value is not None:
        error = critic.value(z) - critic.constant - ca.bilin(P, z, z)
        parts.append(("value", error, np.atleast_1d(b @ np.abs(exact.P) @ b)))
    if critic.gradient is not None:
        error = critic.gradient(z) - 2.0 * P @ z
        parts.append(("gradient", error, _floored(2.0 * np.abs(exact.P) @ b)))
    error = critic.policy(z) + ca.DM(exact.K) @ z
    parts.append(("policy", error, _floored(scale * (np.abs(exact.K) @ b)) / scale))
    names = [name for name, _, sizes in parts for _ in sizes]
    return names, ca.vertcat(*(error / ca.DM(sizes) for _, error, sizes in parts))


def _floored(sizes: np.ndarray) -> np.ndarray:
    """As in `entry_error`: small ones are compared with a part of the largest."""
    return np.maximum(sizes, SMALL * sizes.max() or 1.0)


def _starts(b: np.ndarray, count: int, seed: int = 1) -> np.ndarray:
    """States of the box, every other one a corner: (count, n)."""
    starts = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(b)))
    starts[::2] = np.sign(starts[::2])
    return starts * b


# Flights.


class _Loop:
    """z' = rates(z) and cost' = running(z), CasADi expressions of z (n,), integrated by LSODA.

    rest: where it comes to rest near z = 0, None for nowhere.
    """

    def __init__(self, z: ca.SX, rates: ca.SX, exact: Exact, time: float, b: np.ndarray) -> None:
        self._z = z
        self._rates = rates
        self._P = exact.P
        self._time = time
        self.rest = rest_point(z, rates, b)
        self._bound = self._slopes_of(0.0)

    def with_cost(self, running: Callable[[ca.SX], ca.SX]) -> _Loop:
        """The same loop with a cost; running(z) is 0 at rest."""
        self._bound = self._slopes_of(running(self._z))
        return self

    def _slopes_of(self, running: ca.SX | float) -> BoundFunction:
        slopes = ca.densify(ca.vertcat(self._rates, running))
        return BoundFunction(ca.Function("slopes", [self._z], [slopes]))

    def _slopes(self, y: np.ndarray, _: float) -> np.ndarray:
        self._bound.inputs[0][:] = y[:-1]
        self._bound()
        return self._bound.results[0]

    def returned(self, start: np.ndarray) -> tuple[np.ndarray, float] | None:
        """The end, less the rest point, and the cost; None where V* about the rest point has not
        come down to `RETURNED`."""
        from scipy.integrate import odeint

        if self.rest is None:
            return None
        tolerances = {"rtol": 1e-7, "atol": 1e-9 * np.abs(start).max(), "mxstep": STEPS}
        with (
            np.errstate(all="ignore"),
            warnings.catch_warnings(action="ignore"),
        ):  # of LSODA, where it gives up
            (_, end), outcome = odeint(
                self._slopes,
                np.append(start, 0.0),
                [0.0, self._time],
                full_output=True,
                **tolerances,
            )
        if outcome["message"] != "Integration successful." or not np.all(np.isfinite(end)):
            return None
        z = end[:-1] - self.rest
        begin = start - self.rest
        if z @ self._P @ z > RETURNED * (begin @ self._P @ begin):
            return None
        return z, float(end[-1])


def rest_point(z: ca.SX, rates: ca.SX, b: np.ndarray) -> np.ndarray | None:
    """z (n,) with rates(z) = 0 near 0, by Newton; None where there is none within
    `_FARTHEST_REST` boxes."""
    step = ca.Function("step", [z], [rates, ca.jacobian(rates, z)])
    point = np.zeros(len(b))
    for _ in range(_NEWTON_STEPS):
        rate, jacobian = (np.array(part) for part in step(point))
        if not (np.all(np.isfinite(rate)) and np.all(np.isfinite(jacobian))):
            return None
        try:
            change = np.linalg.solve(jacobian, rate.ravel())
        except np.linalg.LinAlgError:
            return None
        point = point - change
        if np.any(np.abs(point) > _FARTHEST_REST * b):
            return None
        if np.all(np.abs(change) <= 1e-12 * b):
            return point
    return None


def rest_check(rest: np.ndarray | None, b: np.ndarray, limit: float) -> Check:
    """Whether the loop comes to rest at trim."""
    if rest is None:
        return at_most("rest_point", math.inf, limit, "no rest point near trim", kind="cost")
    distance = float((np.abs(rest) / b).max())
    reason = f"rests off trim ({distance:.2g} boxes)"
    return at_most("rest_point", distance, limit, reason, kind="cost")


def fly(
    game: Game,
    critic: Critic,
    exact: Exact,
    b: np.ndarray,
    flights: int,
    plant: NonlinearPlant | None = None,
) -> Flown:
    """Fly a network whose linear loop is stable from the box |z_i| <= b_i."""
    z = critic.symbols
    u = critic.policy(z)
    time = DECAY / abs(spectrum(game.A - game.B @ exact.K).abscissa)
    losses = flown_losses(game, critic, exact, b, flights)
    linear = _Loop(z, ca.DM(game.A) @ z + ca.DM(game.B) @ u, exact, time, b)
    few = min(FEW, flights)
    reached = [_reach(linear, b, few)]
    if plant is not None:
        for policy in (u, -ca.DM(exact.K) @ z):
            nonlinear = _Loop(z, plant.closed(z, policy), exact, time, b)
            reached.append(_reach(nonlinear, b, few))
    return Flown(
        flights,
        float(losses.max()),
        float(losses.mean()),
        linear.rest,
        *reached,
    )


def flown_losses(
    game: Game, critic: Critic, exact: Exact, b: np.ndarray, flights: int
) -> np.ndarray:
    """Percent of V* that u(z) costs more than u* from each start in the box: (flights,); all inf
    where it does not return from one.

    Under d = L* z, the worst disturbance of the exact policies, J - V* = ∫ (u - u*)'R(u - u*) dt.
    What comes after the end is that of the linear loop. A policy that rests off trim is judged by
    its way to the rest point: its u - u* there is taken off.
    """
    from scipy.linalg import solve_continuous_lyapunov

    A = game.A + game.E @ exact.disturbance_gain
    linear = A - game.B @ critic.K
    if spectrum(linear).abscissa >= 0.0:
        return np.full(flights, math.inf)
    change = critic.K - exact.K
    after = solve_continuous_lyapunov(linear.T, -change.T @ game.R @ change)
    z = critic.symbols
    u = critic.policy(z)
    time = DECAY / abs(spectrum(game.A - game.B @ exact.K).abscissa)
    loop = _Loop(z, ca.DM(A) @ z + ca.DM(game.B) @ u, exact, time, b)
    if loop.rest is None:
        return np.full(flights, math.inf)
    at_rest = np.array(critic.policy(loop.rest)).ravel() + exact.K @ loop.rest

    def running(z: ca.SX) -> ca.SX:
        away = critic.policy(z) + ca.DM(exact.K) @ z - ca.DM(at_rest)
        return ca.bilin(ca.DM(game.R), away, away)

    loop.with_cost(running)
    losses = []
    for start in _starts(b, flights):
        end = loop.returned(start)
        if end is None:
            return np.full(flights, math.inf)
        cost = end[1] + end[0] @ after @ end[0]
        losses.append(max(100.0 * float(cost / (start @ exact.P @ start)), 0.0))
    return np.array(losses)


def _reach(loop: _Loop, b: np.ndarray, few: int) -> float:
    """The largest of 2^-k ... 2^k times the box, k = `DOUBLINGS`, such that a flight returns from
    so few starts in it and in each smaller one tried; 0 for none."""

    def returns(size: float) -> bool:
        return all(loop.returned(start) is not None for start in size * _starts(b, few))

    size = 1.0
    if returns(size):
        while size < 2.0**DOUBLINGS and returns(2.0 * size):
            size *= 2.0
        return size
    while size > 2.0**-DOUBLINGS:
        size /= 2.0
        if returns(size):
            return size
    return 0.0


# What is said of them.


def network_section(
    critic: Critic, b: np.ndarray, found: tuple[Found, ...], proof: Proof | None, flown: Flown
) -> Section:
    """What was read of a network, one value to compare with one's own, what was found and
    proved."""
    outputs = [name for name in ("V", "gradient", "policy") if name in critic.network]
    if "V" in outputs:
        outputs.remove("gradient")  # its derivative
    output = " and ".join(outputs)
    value = np.array(critic.network[outputs[0]](b)).ravel()
    constant = f", V(0) = {critic.constant:.4g}" if "V" in outputs else ""
    errors = "; ".join(
        f"{_NOUNS[item.name]} {item.error:.3g} at ({_row(item.at)})" for item in found
    )
    name = {"V": "V", "gradient": "dV/dz", "policy": "u"}[outputs[0]]
    lines = [
        f"Network of {output}, {critic.precision} weights, linearized exactly at the origin"
        f"{constant}",
        f"Read: {critic.origin}",
        f"{name}({_row(b)}) = {_row(value)}; compare it with your own",
        f"Largest errors in the box (searched, {STARTS} starts; not a bound): {errors}",
    ]
    if proof is not None:
        lines.append(
            f"Proved: no {proof.what} above {proof.error:.3g} {proof.where} ({proof.boxes} boxes)"
        )
    data = {
        "output": output,
        "precision": critic.precision,
        "value_at_origin": critic.constant,
        "origin": critic.origin,
        "starts": STARTS,
        "searched": [item._asdict() for item in found],
        "proved": None if proof is None else proof._asdict(),
        "at": b,
        "value_at": value,
        **flown._asdict(),
    }
    return Section((*lines, *_flown_lines(flown)), {"network": data})


def _row(numbers: np.ndarray) -> str:
    return ", ".join(f"{number:.4g}" for number in numbers)


def _flown_lines(flown: Flown) -> list[str]:
    if not flown.flights:
        return ["Not flown: the linear loop is not stable"]
    cost = "it does not return from all of them"
    if math.isfinite(flown.cost_lost_flown_percent):
        cost = (
            f"cost lost {flown.cost_lost_flown_percent:.3g} percent at most, "
            f"{flown.cost_lost_flown_mean_percent:.3g} on average"
        )
    lines = [f"Flown from {flown.flights} starts in the box (not a bound): {cost}"]
    reach = f"{flown.reach:g} times the box on the linear plant"
    if flown.reach_nonlinear is not None:
        reach += (
            f", {flown.reach_nonlinear:g} times on the nonlinear one within the limits of its "
            f"controls (the exact policy {flown.reach_nonlinear_exact:g})"
        )
    few = min(FEW, flown.flights)
    lines.append(f"Returns to rest from {reach} ({few} starts each, doubled up to {2**DOUBLINGS})")
    return lines
