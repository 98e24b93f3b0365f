"""The user's data in the form of a region's statement, for comparison with a certificate."""

from __future__ import annotations

from collections.abc import Mapping
from math import factorial, prod
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from hfa_prove.check.game import SAME_GAIN
from hfa_prove.commands.given import aircraft_option, at_one_value, names_aircraft
from hfa_prove.fields import Terms, rows_of
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.plant import SAME_TRIM, facts, limits_hold, model_limits
from hfa_prove.statements.region import RegionStatement
from hfa_prove.subject import Given, close_to, within
from hfa_support.errors import BadInputError, NoSolutionError, prefix_errors
from trim.linear.linear_model import LinearModel
from trim.point.linearize import linearize

if TYPE_CHECKING:
    from controller.critic.critic import Critic
    from hfa_aircraft.model import Model
    from hfa_prove.commands.request import CheckRequest, RegionRequest

#: Highest degree of a polynomial policy.
HIGHEST_POLICY = 5
#: Number of points at which the polynomials are compared with the policy.
_POINTS = 200
#: Largest difference there, over the sum of the sizes of the terms.
_SAME = 1e-9


def policy_terms(critic: Critic, inputs: tuple[str, ...]) -> Mapping[str, Terms]:
    """Return input -> terms of degree 2 and more of a critic's policy.

    Inputs without such terms are omitted.

    inputs: names of the inputs, in the order of the game

    Raises BadInputError unless the policy is a polynomial of degree at most `HIGHEST_POLICY` and 0
    at z = 0.
    """
    if critic.linear:
        return {}
    if critic.wide or not critic.policy.is_a("SXFunction"):
        raise BadInputError(
            "the policy is a network; give K, P, or the weights W of a polynomial critic"
        )
    z = critic.symbols
    u = critic.policy(z)
    policy = {}
    for index, name in enumerate(inputs):
        terms = _terms(u[index], z)
        _check_same(ca.Function("u", [z], [u[index]]), terms)
        curved = tuple(term for term in terms if sum(term[1]) > 1)
        if curved:
            policy[name] = curved
    return policy


def _terms(u: ca.SX, z: ca.SX) -> Terms:
    """Return the terms ∂^α u / α! z^α of the Taylor polynomial of an input u at z = 0.

    The polynomial has the degree `HIGHEST_POLICY`.
    """
    n = z.numel()
    slopes = {(0,) * n: u}
    found: dict[tuple[int, ...], ca.SX] = {}
    for _ in range(HIGHEST_POLICY + 1):
        found |= slopes
        higher = {}
        for powers, slope in slopes.items():
            first = max((i for i in range(n) if powers[i]), default=0)
            for i in range(first, n):
                next_slope = ca.gradient(slope, z[i])
                if not next_slope.is_zero():
                    higher[(*powers[:i], powers[i] + 1, *powers[i + 1 :])] = next_slope
        slopes = higher
    at_zero = ca.Function("slopes", [z], [ca.densify(ca.vertcat(*found.values()))])
    values = np.array(at_zero(np.zeros(n))).ravel()
    terms = []
    for powers, value in zip(found, values.tolist(), strict=True):
        if value != 0.0:
            terms.append((value / prod(factorial(power) for power in powers), powers))
    return tuple(terms)


def _check_same(u: ca.Function, terms: Terms) -> None:
    """Raise BadInputError unless the terms of a policy equal the policy at random points.

    The policy must also be 0 at z = 0.
    """
    n = u.numel_in(0)
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (_POINTS, n))
    total = np.zeros(_POINTS)
    sizes = np.zeros(_POINTS)
    for coefficient, powers in terms:
        values = coefficient * np.prod(points ** np.array(powers), axis=1)
        total += values
        sizes += np.abs(values)
    wanted = np.array(u(points.T)).ravel()
    if not np.all(np.abs(total - wanted) <= _SAME * sizes):
        raise BadInputError(
            f"the policy is not a polynomial of degree {HIGHEST_POLICY} or less; give K, P, or"
            " the weights W of a polynomial critic"
        )
    if any(not any(powers) for _, powers in terms):
        raise BadInputError("the policy is not 0 at the trim; remove the linear terms of V")


def loop_of(
    request: CheckRequest | RegionRequest,
) -> tuple[LinearModel, np.ndarray, np.ndarray | None, Mapping[str, Terms]]:
    """Return the parts of the loop that the options define.

    - the linear model at the trim
    - the gain K (m, n)
    - the matrix P of the value of the game or critic, or None without inputs or without a P
    - input -> nonlinear terms of the policy

    Raises NoSolutionError if no trim is found or the game has no solution. Raises BadInputError if
    --basis is given without --weights or the policy is not a polynomial.
    """
    if request.basis is not None and request.weights is None:
        raise BadInputError(
            "--basis applies only to W in --weights; add --weights, or remove --basis"
        )
    if not request.model.inputs:
        aircraft = request.flown_aircraft()
        linear = linearize(aircraft, request.operating_point(aircraft))
        return linear, np.zeros((0, len(linear.states))), None, {}
    named = request.game()
    assert named.linear is not None
    if request.weights is not None:
        from controller.critic.critic_file import critic_in
        from controller.critic.reading import Reading

        with prefix_errors(request.weights):
            critic = critic_in(request.weights, named.game, Reading(request.basis))
            policy = policy_terms(critic, named.linear.inputs)
        return named.linear, critic.K, critic.P, policy
    from controller.riccati.gare import unconfirmed_solution

    try:
        solution = unconfirmed_solution(named.game)
    except NoSolutionError as error:
        raise NoSolutionError(
            f"the game of the linear model has no solution ({error}), so there is no policy; give "
            "a stabilizing policy with --weights"
        ) from error
    return named.linear, solution.K, solution.P, {}


#: Options that define a policy.
_OF_THE_POLICY = ("weights", "Q", "R", "delta", "basis")


def given_for(
    statement: RegionStatement, request: CheckRequest | RegionRequest
) -> dict[str, Given]:
    """Return path of an entry -> the user's value, for the region of a polynomial policy.

    statement: the statement
    request: options of the command

    Raises BadInputError or NoSolutionError if the options do not define a loop.
    """
    request = at_one_value(request)
    loop = statement.loop
    given: dict[str, Given] = {}
    if names_aircraft(request):
        given |= _given_aircraft(loop, request)
    if request.own or request.at is not None:
        given |= _given_trim(request)
    if any(name in request.typed for name in _OF_THE_POLICY):
        given |= _given_policy(request)
    elif not loop.inputs and "model" in given:
        option = given["model"].option
        given |= {"policy.K": Given([], option), "policy.terms": Given({}, option)}
    sizes = getattr(request, "disturbance", None)
    if sizes:
        given["disturbances"] = Given(dict(sizes), "--disturbance")
    return {f"loop.{path}": value for path, value in given.items()}


def given_by(loop: Loop, option: str) -> dict[str, Given]:
    """Return path of an entry -> the user's value, for every entry that describes a user's loop.

    option: the option that defined the loop, for messages
    """
    widths = {name: SAME_TRIM * signal.nominal for name, signal in loop.model.signals.items()}
    given = {}
    for path, declared, value in loop.entries("loop."):
        if declared.subject == "trim":
            given[path] = Given(value, option, within(widths))
        elif declared.subject:
            given[path] = Given(value, option)
    return given


def _given_aircraft(loop: Loop, request: CheckRequest | RegionRequest) -> dict[str, Given]:
    """Return the entries on the user's model, its parameters, and its limits at the stated trim.

    The limits are omitted if the model has other moving states than the statement.
    """
    model = request.flown_aircraft()
    option = aircraft_option(request)
    parameters = {name: signal.start for name, signal in model.parameters.items()}
    given = {"model": Given(facts(model), option), "parameters": Given(parameters, option)}
    if tuple(model.linear) != loop.states:
        return given  # another model, which the comparison of its name reports
    limits = model_limits(model, {**loop.trim, **loop.held}, parameters)
    given["limits"] = Given(limits, option, _not_wider(tuple(model.inputs)))
    return given


def _not_wider(inputs: tuple[str, ...]) -> Any:
    """Return a comparison of limits by `limits_hold`.

    The comparison has the arguments (limits in the certificate, user's limits). The limits agree if
    all stated limits are admissible.

    inputs: names of the inputs
    """

    def same(stated: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
        pairs = {name: _ends(pair) for name, pair in stated.items()}
        return limits_hold(pairs, own, inputs) is None

    return same


def _ends(pair: Any) -> tuple[float, float]:
    low, high = pair
    return (-np.inf if low is None else low, np.inf if high is None else high)


def _given_trim(request: CheckRequest | RegionRequest) -> dict[str, Given]:
    """Return the entries on the trim that the options define, to be compared within `SAME_TRIM`."""
    model: Model = request.flown_aircraft()
    point = request.operating_point(model)
    option = aircraft_option(request)
    values = {name: float(value) for name, value in point.states._asdict().items()}
    parts = {
        "trim": {name: values[name] for name in model.linear},
        "held": {name: values[name] for name in model.states if name not in model.linear},
        "inputs": {name: float(value) for name, value in point.inputs._asdict().items()},
    }
    widths = {name: SAME_TRIM * signal.nominal for name, signal in model.signals.items()}
    return {name: Given(part, option, within(widths)) for name, part in parts.items()}


def _given_policy(request: CheckRequest | RegionRequest) -> dict[str, Given]:
    """Return the entries `policy.K` and `policy.terms`, of the user's policy."""

    _, K, _, policy = loop_of(request)
    option = "the game" if request.weights is None else f"--weights {request.weights}"
    rows = {name: rows_of(terms) for name, terms in policy.items()}
    return {
        "policy.K": Given(K.tolist(), option, close_to(SAME_GAIN)),
        "policy.terms": Given(rows, option, _same_policy),
    }


def _same_policy(stated: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
    """Return whether two polynomial policies agree.

    For each input, the monomials must be equal and the coefficients must agree within `SAME_GAIN`.

    stated: policy in the certificate, input -> terms
    own: the user's policy, input -> terms
    """
    if set(stated) != set(own):
        return False
    for name, rows in own.items():
        found = {tuple(powers): coefficient for coefficient, powers in stated[name]}
        wanted = {tuple(powers): coefficient for coefficient, powers in rows}
        if set(found) != set(wanted):
            return False
        pairs = [[found[powers], wanted[powers]] for powers in wanted]
        first, second = np.array(pairs).T
        if not close_to(SAME_GAIN)(first, second):
            return False
    return True
