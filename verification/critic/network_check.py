"""A neural network as a critic: exact at the origin, where it is linearized, and searched over a box of states.

V(z): P = ½ ∂²V/∂z², u = -½ R⁻¹B' ∂V/∂z. dV/dz: P = ½ ∂(dV/dz)/∂z, the same u. u(z): K = -∂u/∂z. All derivatives are
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
from hfa_support.reporting.checks import at_most
from verification.critic.candidate import Candidate, from_weights
from verification.critic.check_result import CriticCheck
from verification.critic.critic_check import LIMIT, check_critic
from verification.critic.critic_errors import SMALL, Box
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

    z: (n,) symbols, V: of them, F: ∂V/∂z (n,) or u (m,); all None of a polynomial, V where it is not known. constant:
    V(0), 0 where V is not known. precision: of the weights.
    """

    candidate: Candidate
    output: str
    precision: str
    constant: float = 0.0
    z: Any = None
    V: Any = None
    F: Any = None

    def policy(self, game: Game) -> Any:
        """u, (m,), of the symbols z."""
        return self.F if self.output == "policy" else ca.DM(-0.5 * game.R_inverse_B_transposed) @ self.F


class Found(NamedTuple):
    """The largest error that was found: relative, of `name`, at the state z (n,)."""

    name: str
    error: float
    at: np.ndarray


class NetworkSearch(NamedTuple):
    """What is known of a network beside its linearization. found: () of a polynomial, whose errors are bounded.

    lost: percent, the largest of `flown_loss`, 0 where it was not flown. The others as in `NetworkCritic`.
    """

    output: str
    precision: str
    constant: float
    found: tuple[Found, ...] = ()
    lost: float = 0.0

    @property
    def said(self) -> tuple[str, ...]:
        """For a report."""
        constant = f", V(0) = {self.constant:.4g}" if self.output == "V" else ""
        if not self.found:
            return (f"Polynomial, {self.precision} weights{constant}",)
        errors = [
            f"{_SAID[each.name]} {each.error:.3g} at ({', '.join(f'{z:.3g}' for z in each.at)})" for each in self.found
        ]
        flown = f"Cost lost in the box, flown from {FLIGHTS} starts (not a bound): {self.lost:.3g} percent"
        return (
            f"Network of {self.output}, {self.precision} weights, linearized exactly at the origin{constant}",
            f"Largest errors in the box (searched, {STARTS} starts; not a bound): {'; '.join(errors)}",
            *[flown] * (self.lost > 0.0),
        )

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        found = [
            {"name": each.name, "error": finite_or_none(each.error), "at": each.at.tolist()} for each in self.found
        ]
        return {
            "output": self.output,
            "precision": self.precision,
            "value_at_origin": finite_or_none(self.constant),
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
            raise BadInputError(f"a layer on the basis has {len(weight)} outputs; V has 1, and only V is read of it")
        candidate = from_weights(game, weight[0] * functions.scaling(scale), functions)
        return NetworkCritic(candidate, "V", network.precision, float(bias[0]))
    output = _output(network.function.size1_out(0), n, m, output)
    z = ca.SX.sym("z", n)
    y = network.function(ca.DM(scale) * z)
    V, F = (y, ca.gradient(y, z)) if output == "V" else (None, y)
    constant = 0.0 if V is None else float(ca.Function("V", [z], [V])(np.zeros(n)))
    w = ca.SX.sym("w", F.size1())
    slopes = ca.Function("slopes", [z, w], [ca.jtimes(F, z, w, True)])
    slope = np.array(slopes(np.zeros((n, F.size1())), np.eye(F.size1()))).T
    candidate = Candidate(-slope, None, functions)
    if output != "policy":
        candidate = Candidate(game.gain(slope / 2.0), slope / 2.0, functions)
    return NetworkCritic(candidate, output, network.precision, constant, z, V, F)


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
    """`check_critic` of the linearization; the errors at the origin, and the largest that `search` finds in the box.

    A polynomial is checked as a critic is whose weights are given. fly: also `flown_loss`.
    """
    check = check_critic(game, critic.candidate, limit=limit, box=box, at_dihedral=at_dihedral)
    facts = NetworkSearch(critic.output, critic.precision, critic.constant)
    if critic.z is None:
        return replace(check, network=facts)
    origin, found = search(game, critic, check.exact, box.half_widths)
    off = "u is" if critic.output == "policy" else "the slopes of V are"
    checks = [at_most("origin_error", origin, limit, f"{off} off by {origin:.2g} at the origin, where 0 is right")]
    for name, error, _ in found:
        checks.append(
            at_most(f"searched_{name}_error", error, limit, f"{_SAID[name]} is off by {error:.2g} in the box")
        )
    flown = fly and math.isfinite(check.flight.worst)
    lost = flown_loss(game, critic, check.exact, box.half_widths) if flown else 0.0
    kept = [each for each in check.checks if each.name not in _OF_POLYNOMIALS]
    return replace(check, checks=(*kept, *checks), network=facts._replace(found=found, lost=lost))


def search(game: Game, critic: NetworkCritic, exact: GameSolution, b: np.ndarray) -> tuple[float, tuple[Found, ...]]:
    """The largest error at the origin, and those found over the box |z_i| <= b_i: of V, of any dV/dz_i, of any input.

    Each relative to the largest of the exact V, dV/dz_i or u_i in the box; V but for its constant, on which no policy
    depends. Of `STARTS` states the `CLIMBS` worst of each error are where L-BFGS-B starts to climb.
    """
    names, errors = _errors(game, critic, exact, b)
    w = ca.SX.sym("w", len(names))
    values, slopes = (
        ca.Function("values", [critic.z], [errors]),
        ca.Function("slopes", [critic.z, w], [ca.jtimes(errors, critic.z, w, True)]),
    )
    starts = np.random.default_rng(0).uniform(-1.0, 1.0, (len(b), STARTS))
    starts[:, ::2] = np.sign(starts[:, ::2])
    found: dict[str, Found] = {}
    for name, sampled, unit in zip(names, np.array(values(b[:, None] * starts)), np.eye(len(names)), strict=True):
        sizes = np.where(np.isfinite(sampled), np.abs(sampled), math.inf)
        order = np.argsort(-sizes, kind="stable")[:CLIMBS]
        ends = [(float(sizes[order[0]]), starts[:, order[0]])]
        if math.isfinite(ends[0][0]):
            ends += [
                _climbed(values, slopes, b, np.copysign(unit, sampled[place]), starts[:, place]) for place in order
            ]
        error, at = max(ends, key=lambda end: end[0])
        if name not in found or error > found[name].error:
            found[name] = Found(name, error, b * at)
    at_origin = np.abs(np.array(values(np.zeros(len(b)))))
    return float(np.where(np.isfinite(at_origin), at_origin, math.inf).max()), tuple(found.values())


def _climbed(
    values: Any, slopes: Any, b: np.ndarray, weights: np.ndarray, start: np.ndarray
) -> tuple[float, np.ndarray]:
    """The largest weights'values(b y) on the way up from y = start, |y_i| <= 1, and y; inf where it is no number."""
    from scipy.optimize import minimize

    def descent(y: np.ndarray) -> tuple[float, np.ndarray]:
        return -float(weights @ np.array(values(b * y)).ravel()), -np.array(slopes(b * y, weights)).ravel() * b

    end = minimize(descent, start, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * len(b), options={"maxiter": 50})
    return (-float(end.fun) if math.isfinite(end.fun) else math.inf), end.x


def _errors(game: Game, critic: NetworkCritic, exact: GameSolution, b: np.ndarray) -> tuple[list[str], Any]:
    """Names of the relative errors, and the errors themselves, of the symbols z."""
    z, P = critic.z, ca.DM(exact.P)
    scale, parts = np.sqrt(np.diag(game.R)), []
    if critic.V is not None:
        parts.append(("value", critic.V - critic.constant - z.T @ P @ z, b[None] @ np.abs(exact.P) @ b))
    if critic.output != "policy":
        parts.append(("gradient", critic.F - 2.0 * P @ z, _floored(2.0 * np.abs(exact.P) @ b)))
    sizes = _floored(scale * (np.abs(exact.K) @ b)) / scale
    parts.append(("policy", critic.policy(game) + ca.DM(exact.K) @ z, sizes))
    names = [name for name, _, sizes in parts for _ in sizes]
    return names, ca.vertcat(*(error / ca.DM(sizes) for _, error, sizes in parts))


def _floored(sizes: np.ndarray) -> np.ndarray:
    """As in `entry_error`: what is small beside the others is compared with a part of the largest."""
    return np.maximum(sizes, SMALL * sizes.max() or 1.0)


def flown_loss(game: Game, critic: NetworkCritic, exact: GameSolution, b: np.ndarray) -> float:
    """Percent of V* that u(z) costs more than u*, the largest over `FLIGHTS` starts in the box; inf for no return.

    Under d = L* z, the worst disturbance of the exact policies, J - V* = ∫ (u - u*)'R(u - u*) dt. What is left of V*
    at the end counts.
    """
    from scipy.integrate import odeint

    A, P, n, u = game.A + game.E @ exact.disturbance_gain, exact.P, len(b), critic.policy(game)
    away = u + ca.DM(exact.K) @ critic.z
    slopes = ca.vertcat(ca.DM(A) @ critic.z + ca.DM(game.B) @ u, away.T @ ca.DM(game.R) @ away)
    function = ca.Function("slopes", [critic.z], [slopes])
    time = DECAY / abs(spectrum(A - game.B @ exact.K).abscissa)
    starts = np.random.default_rng(1).uniform(-1.0, 1.0, (FLIGHTS, n))
    starts[::2] = np.sign(starts[::2])
    worst, steps = 0.0, {"rtol": 1e-7, "mxstep": STEPS, "full_output": True}
    for start in starts * b:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of LSODA, where it gives up: that is no return
            (_, end), about = odeint(
                lambda y, _: np.array(function(y[:n])).ravel(), [*start, 0.0], [0.0, time], **steps
            )
            lost = 100.0 * float((end[n] + end[:n] @ P @ end[:n]) / (start @ P @ start))
        if about["message"] != "Integration successful." or not math.isfinite(lost):
            return math.inf
        worst = max(worst, lost)
    return worst
