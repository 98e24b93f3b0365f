"""A neural network as a critic: exact at the origin, where it is linearized, and searched over a box of states.

V(x): P = ½ ∂²V/∂x², u = -½ R⁻¹B' ∂V/∂x. dV/dx: P = ½ ∂(dV/dx)/∂x, the same u. u(x): K = -∂u/∂x. All derivatives are
CasADi's. Over the box, errors are looked for: what a search finds is a lower bound of the largest error.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.game.basis import Basis
from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from controller.riccati.gare import GameSolution
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.jsonable import finite_or_none
from hfa_support.reporting.checks import Check, at_most
from verification.critic.candidate import Candidate, from_weights
from verification.critic.check_result import CriticCheck
from verification.critic.critic_check import LIMIT, check_critic
from verification.critic.critic_errors import SMALL, Box, entry_error
from verification.critic.network_file import Network

#: What a network may compute.
OUTPUTS = ("V", "gradient", "policy")
#: States from which the search starts, half of them corners of the box, and from how many of them it climbs.
STARTS, CLIMBS = 1000, 4
#: Flights, each until the exact loop has decayed to exp(-`DECAY`), in so many steps at most.
FLIGHTS, DECAY, STEPS = 40, 10.0, 5000
#: Checks of `check_critic` that bound a polynomial over the box; of a network they would bound its linearization.
_OF_POLYNOMIALS = ("value_rel_error", "gradient_rel_error", "policy_rel_error", "disturbance_rel_error")
_SAID = {"value": "V", "gradient": "a slope of V", "policy": "the policy"}


@dataclass(frozen=True, eq=False)
class NetworkCritic:
    """candidate: the linearization at the origin, or all of a polynomial. output: one of `OUTPUTS`.

    evaluate: z (n, N) -> V (1, N) or nothing, and F (k, N), which is ∂V/∂z or u. pull: z (n, N), w (k, N) -> (∂F/∂z)'w;
    both None of a polynomial. constant: V(0), 0 where V is not known.
    """

    candidate: Candidate
    output: str
    precision: str
    constant: float
    evaluate: Callable[..., Any] | None = None
    pull: Callable[..., Any] | None = None


class Found(NamedTuple):
    """The largest error that was found: relative, of `name`, at the state z (n,)."""

    name: str
    error: float
    at: np.ndarray


class NetworkSearch(NamedTuple):
    """What is known of a network beside its linearization. found: () of a polynomial, whose errors are bounded.

    lost: percent, the largest of `flown_loss`, 0 where it was not flown.
    """

    critic: NetworkCritic
    found: tuple[Found, ...]
    lost: float = 0.0

    @property
    def said(self) -> tuple[str, ...]:
        """For a report."""
        critic = self.critic
        if critic.evaluate is None:
            return (f"Polynomial with {critic.precision} weights and the constant V(0) = {critic.constant:.4g}",)
        constant = f", V(0) = {critic.constant:.4g}" if critic.output == "V" else ""
        lines = [
            f"{_SAID[each.name]} {each.error:.3g} at ({', '.join(f'{z:.3g}' for z in each.at)})" for each in self.found
        ]
        about = f"Network of {critic.output}, {critic.precision} weights, linearized exactly at the origin{constant}"
        flown = [f"Cost lost in the box, flown from {FLIGHTS} starts (not a bound): {self.lost:.3g} percent"] * (
            self.lost > 0.0
        )
        return (
            about,
            f"Largest errors in the box (searched, {STARTS} starts; not a bound): {'; '.join(lines)}",
            *flown,
        )

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        found = [
            {"name": each.name, "error": finite_or_none(each.error), "at": each.at.tolist()} for each in self.found
        ]
        critic = self.critic
        return {
            "output": critic.output,
            "precision": critic.precision,
            "value_at_origin": finite_or_none(critic.constant),
            "starts": STARTS if self.found else 0,
            "searched": found,
            "cost_lost_flown_percent": finite_or_none(self.lost),
        }


def network_critic(
    game: Game, network: Network, functions: Basis, output: str | None = None, scale: np.ndarray | None = None
) -> NetworkCritic:
    """The critic that a network is. output: one of `OUTPUTS`, by default what its number of outputs says.

    scale: (n,), the network takes state i times scale[i]. BadInputError where the outputs do not fit or are ambiguous.
    """
    n, m = game.B.shape
    scale = np.ones(n) if scale is None else np.asarray(scale, dtype=float)
    if scale.shape != (n,) or not np.all(np.isfinite(scale) & (scale != 0.0)):
        raise BadInputError(f"--scale needs {n} numbers other than 0, one for each state")
    if network.function is None:
        (weight, bias), *_ = network.layers
        if len(weight) != 1 or output not in (None, "V"):
            raise BadInputError(
                f"a layer on the basis has {len(weight)} outputs; V has 1, and nothing else is read of it"
            )
        candidate = from_weights(game, weight[0] * functions.scaling(scale), functions)
        return NetworkCritic(candidate, "V", network.precision, float(bias[0]))
    output = _output(network.function.size1_out(0), n, m, output)
    z = ca.SX.sym("z", n)
    y = network.function(ca.DM(scale) * z)
    F = ca.gradient(y, z) if output == "V" else y
    w = ca.SX.sym("w", F.size1())
    evaluate = ca.Function("evaluate", [z], [y if output == "V" else ca.SX(0, 1), F])
    pull = ca.Function("pull", [z, w], [ca.jtimes(F, z, w, True)])
    slopes = np.array(pull(np.zeros((n, F.size1())), np.eye(F.size1()))).T
    constant = float(evaluate(np.zeros(n))[0]) if output == "V" else 0.0
    P = None if output == "policy" else slopes / 2.0
    K = -slopes if P is None else game.gain(P)
    return NetworkCritic(Candidate(K, P, functions), output, network.precision, constant, evaluate, pull)


def _output(count: int, n: int, m: int, asked: str | None) -> str:
    counts = dict(zip(OUTPUTS, (1, n, m), strict=True))
    fitting = [name for name, size in counts.items() if size == count]
    if asked is not None:
        refuse_unknown("unknown output", asked, OUTPUTS)
    if asked not in (None, *fitting) or not fitting:
        said = ", ".join(f"{name} has {size}" for name, size in counts.items())
        raise BadInputError(f"the network has {count} outputs; on this plant {said}")
    if asked is None and len(fitting) > 1:
        raise BadInputError(f"{count} outputs may be {' or '.join(fitting)}; say which by --network-output")
    return asked or fitting[0]


def check_network(
    game: Game,
    critic: NetworkCritic,
    *,
    box: Box,
    limit: float = LIMIT,
    fly: bool = False,
    at_dihedral: Callable[[float], Game] | None = None,
) -> CriticCheck:
    """`check_critic` of the linearization; F at the origin, and the largest errors of V, dV/dx and u that are found.

    Each error over the box relative to the largest of the exact V, dV/dx_i or u_i there. A polynomial is checked as a
    critic is whose weights are given. V is compared but for its constant, on which no policy depends.
    """
    check = check_critic(game, critic.candidate, limit=limit, box=box, at_dihedral=at_dihedral)
    if critic.evaluate is None:
        return replace(check, network=NetworkSearch(critic, ()))
    found = search(game, critic, check.exact, box.half_widths)
    F = np.array(critic.evaluate(np.zeros(len(game.A)))[1]).ravel()
    u_scale, b = np.sqrt(np.diag(game.R)), box.half_widths
    if critic.output == "policy":
        origin = entry_error(u_scale * F, u_scale * (np.abs(check.exact.K) @ b))
    else:
        origin = entry_error(F, 2.0 * np.abs(check.exact.P) @ b)
    what = "u" if critic.output == "policy" else "dV/dx"
    checks: list[Check] = [
        at_most(
            "origin_error", origin, limit, f"{what} is not 0 at the origin, but {origin:.2g} of its largest in the box"
        ),
        *(
            at_most(
                f"searched_{each.name}_error",
                each.error,
                limit,
                f"{_SAID[each.name]} is off by {each.error:.2g} in the box",
            )
            for each in found
        ),
    ]
    lost = flown_loss(game, critic, check.exact, b) if fly and math.isfinite(check.flight.worst) else 0.0
    kept = [each for each in check.checks if each.name not in _OF_POLYNOMIALS]
    return replace(check, checks=(*kept, *checks), network=NetworkSearch(critic, found, lost))


class _Target(NamedTuple):
    """(weights'F(z) - exact'z) / size, exact: (n,); without weights (V - z'exact z) / size, exact: (n, n)."""

    name: str
    weights: np.ndarray | None
    exact: np.ndarray
    size: float

    def errors(self, z: np.ndarray, V: np.ndarray, F: np.ndarray) -> np.ndarray:
        """(N,), at the columns of z (n, N)."""
        with np.errstate(all="ignore"):  # what is not finite fails
            if self.weights is None:
                return np.asarray((V - np.sum(z * (self.exact @ z), axis=0)) / self.size)
            return np.asarray((self.weights @ F - self.exact @ z) / self.size)


def search(game: Game, critic: NetworkCritic, exact: GameSolution, b: np.ndarray) -> tuple[Found, ...]:
    """The largest errors that are found over the box |z_i| <= b_i: of V, of any dV/dx_i, of any input.

    Of `STARTS` states the `CLIMBS` worst of each error are where L-BFGS-B starts to climb within the box.
    """
    from scipy.optimize import minimize

    starts = np.random.default_rng(0).uniform(-1.0, 1.0, (len(b), STARTS))
    starts[:, ::2] = np.sign(starts[:, ::2])
    values, found = _values(critic, b[:, None] * starts), dict[str, Found]()
    for target in _targets(game, critic, exact, b):
        errors = target.errors(b[:, None] * starts, *values)
        sizes = np.where(np.isfinite(errors), np.abs(errors), math.inf)
        order = np.argsort(-sizes, kind="stable")[:CLIMBS]
        largest, at = float(sizes[order[0]]), starts[:, order[0]]
        for place in order if math.isfinite(largest) else ():
            end = minimize(
                _descent,
                starts[:, place],
                (critic, target, b, math.copysign(1.0, errors[place])),
                method="L-BFGS-B",
                jac=True,
                bounds=[(-1.0, 1.0)] * len(b),
                options={"maxiter": 50},
            )
            if not math.isfinite(end.fun):
                largest = math.inf
            elif -end.fun > largest:
                largest, at = float(-end.fun), end.x
        if target.name not in found or largest > found[target.name].error:
            found[target.name] = Found(target.name, largest, b * at)
    return tuple(found.values())


def flown_loss(game: Game, critic: NetworkCritic, exact: GameSolution, b: np.ndarray) -> float:
    """Percent of V* that u(z) costs more than u*, the largest over `FLIGHTS` starts in the box; inf for no return.

    Under d = L* z, the worst disturbance of the exact policies, J - V* = ∫ (u - u*)'R(u - u*) dt. What is left of V*
    at the end counts.
    """
    from scipy.integrate import odeint

    A, P, n = game.A + game.E @ exact.disturbance_gain, exact.P, len(b)
    policy = np.eye(len(exact.K)) if critic.output == "policy" else -0.5 * game.R_inverse_B_transposed
    time = DECAY / abs(spectrum(A - game.B @ exact.K).abscissa)

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        z = y[:n]
        u = policy @ _values(critic, z[:, None])[1].ravel()
        away = u + exact.K @ z
        return np.append(A @ z + game.B @ u, away @ game.R @ away)

    starts = np.random.default_rng(1).uniform(-1.0, 1.0, (FLIGHTS, n))
    starts[::2] = np.sign(starts[::2])
    worst = 0.0
    for start in starts * b:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of LSODA, where it gives up: that is no return
            (_, end), about = odeint(
                slope, np.append(start, 0.0), [0.0, time], tfirst=True, rtol=1e-7, mxstep=STEPS, full_output=True
            )
            lost = 100.0 * float((end[n] + end[:n] @ P @ end[:n]) / (start @ P @ start))
        if about["message"] != "Integration successful." or not math.isfinite(lost):
            return math.inf
        worst = max(worst, lost)
    return worst


def _values(critic: NetworkCritic, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """V - V(0), (N,), empty where it is not known, and F (k, N) at the columns of z (n, N)."""
    assert critic.evaluate is not None
    V, F = (np.array(each) for each in critic.evaluate(z))
    return V.ravel() - critic.constant, F


def _descent(
    y: np.ndarray, critic: NetworkCritic, target: _Target, b: np.ndarray, sign: float
) -> tuple[float, np.ndarray]:
    """-sign error and its slope, at z = b y."""
    assert critic.pull is not None
    z = (b * y)[:, None]
    V, F = _values(critic, z)
    if target.weights is None:
        slope = F - 2.0 * target.exact @ z
    else:
        slope = np.array(critic.pull(z, target.weights)) - target.exact[:, None]
    return -sign * float(target.errors(z, V, F)[0]), -sign * slope.ravel() * b / target.size


def _targets(game: Game, critic: NetworkCritic, exact: GameSolution, b: np.ndarray) -> list[_Target]:
    found = []
    if critic.output == "policy":
        policy = np.eye(len(exact.K))
    else:
        policy = -0.5 * game.R_inverse_B_transposed
        if critic.output == "V":
            found.append(_Target("value", None, exact.P, float(b @ np.abs(exact.P) @ b)))
        sizes = _floored(2.0 * np.abs(exact.P) @ b)
        found += [_Target("gradient", *each) for each in zip(np.eye(len(b)), 2.0 * exact.P, sizes, strict=True)]
    scale = np.sqrt(np.diag(game.R))
    sizes = _floored(scale * (np.abs(exact.K) @ b)) / scale
    return found + [_Target("policy", *each) for each in zip(policy, -exact.K, sizes, strict=True)]


def _floored(sizes: np.ndarray) -> np.ndarray:
    """As in `entry_error`: what is small beside the others is compared with a part of the largest."""
    return np.maximum(sizes, SMALL * sizes.max() or 1.0)
