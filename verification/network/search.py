"""Errors of a critic that is a nonlinear function of the state, over a box of states.

A search returns a lower bound on the largest error.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import FUNCTIONS, Critic
from controller.riccati.gare import Solution
from controller.riccati.suboptimality import Suboptimality
from hfa_support.native.bound import RowFunction
from hfa_support.reporting.report import Check, at_most, below
from hfa_support.reporting.text import percent
from verification.box import starts_in
from verification.critic_errors import error_check, floored, is_gain_right
from verification.network.loops import (
    DOUBLINGS,
    FEW,
    FlightResults,
    equilibrium_check,
    equilibrium_of,
    fly,
)
from verification.network.proof import proof_of
from verification.verdict import NEAR, Proof, Section

if TYPE_CHECKING:
    from verification.box import NonlinearPlant


#: Number of random states in the box, half of them corners.
STATES = 4000
#: Smallest number of states that are no corners and have the extreme value of a clipped input.
CLIPPED = 3


class Finding(NamedTuple):
    """What a policy that is not linear does in the box.

    says: sentence
    other_error: largest error of u without the finding, relative to the largest exact input in the
        box
    bent: likewise, the largest difference from -K z with the K of the policy
    """

    says: str
    other_error: float = 0.0
    bent: float = 0.0


def finding_of_policy(
    critic: Critic, exact: Solution, box: np.ndarray, limit: float
) -> Finding | None:
    """Return what is found of a policy: a bias, clipped inputs, inputs that never move, or that the
    policy is squashed. None if nothing is found.

    box: half-widths of the box of states, (n,)
    limit: largest error that passes
    """
    states = np.random.default_rng(2).uniform(-1.0, 1.0, (STATES, len(box)))
    states[1::2] = np.sign(states[1::2])  # corners
    states *= box
    u = critic.u(states)
    bias = critic.u(np.zeros(len(box)))
    sizes = np.maximum(np.abs(exact.K) @ box, np.finfo(float).tiny)  # of the largest exact u
    # The exact u is -K z. The bias is a finding of its own, and subtracted.
    errors, bends = (np.abs(u - bias + states @ K.T) / sizes for K in (exact.K, critic.K))
    if np.all(u == u[0]):
        return Finding("the policy never moves an input: u is the same in the whole box")
    other_error = bent = 0.0
    clips, unmoved = [], []  # sentences on clipped inputs, names of constant ones
    for name, unit, values, error, bend in zip(
        exact.names.inputs, exact.names.input_units, u.T, errors.T, bends.T, strict=True
    ):
        inside = values[::2]  # at the states that are no corners
        if inside.min() == inside.max():
            unmoved.append(name)
            continue
        levels = _clip_levels(inside)
        is_clipped = np.isin(values, levels)
        other_error = max(other_error, float(error[~is_clipped].max(initial=0.0)))
        bent = max(bent, float(bend[~is_clipped].max(initial=0.0)))
        if levels:
            at = " and ".join(f"{level:.4g}" for level in levels) + _unit_text(unit)
            share = percent(100.0 * float(is_clipped[::2].mean()))
            clips.append(f"{name} is clipped at {at} in {share}")
    facts = [bias_text(critic, exact)] if np.any(np.abs(bias) > limit * sizes) else []
    if unmoved:
        facts.append(f"{' and '.join(unmoved)} {'is' if len(unmoved) == 1 else 'are'} never moved")
    if clips:
        facts.append(f"{', '.join(clips)} of the box")
    if not facts:
        return _squashed(critic, exact, box, limit)
    says = "; ".join(facts)
    if other_error <= limit:
        says = f"{says}; otherwise the policy is exact"
    return Finding(says, other_error, bent)


def _clip_levels(values: np.ndarray) -> list[float]:
    """Return the limits of a clipped input: extreme values that at least `CLIPPED` states share.

    values: values of the input at random states, (N,)
    """
    extremes = (values.min() + 0.0, values.max() + 0.0)  # + 0.0 turns -0 into 0
    return [level for level in extremes if np.sum(values == level) >= CLIPPED]


def _squashed(critic: Critic, exact: Solution, box: np.ndarray, limit: float) -> Finding | None:
    """Return the finding that inputs stay below the exact ones where these are largest, with right
    slopes at the origin; or None.
    """
    if not is_gain_right(critic.K, exact, limit):
        return None
    corners = -box * np.where(exact.K < 0.0, -1.0, 1.0)  # row i has the largest exact u_i
    texts = [
        f"{name} is {reached:.4g}{_unit_text(unit)}, where the exact one is {size:.4g}"
        for name, unit, reached, size in zip(
            exact.names.inputs,
            exact.names.input_units,
            np.diag(critic.u(corners)),
            np.abs(exact.K) @ box,
            strict=True,
        )
        if 0.0 <= reached < (1.0 - limit) * size
    ]
    if not texts:
        return None
    return Finding(f"K is right, but {', '.join(texts)}, as by a squash (tanh)")


def bias_text(critic: Critic, exact: Solution) -> str:
    """Return a sentence on the inputs at the origin, which are not 0."""
    u = critic.u(np.zeros(critic.K.shape[1]))
    units = exact.names.input_units
    values = [f"{value:.4g}{_unit_text(unit)}" for value, unit in zip(u, units, strict=True)]
    return f"u at the origin is {', '.join(values)}, not 0: a bias"


def _unit_text(unit: str) -> str:
    """Return a unit as it follows a number, or "" for none."""
    return "" if unit in ("", "1") else f" {unit}"


#: Number of states at which the errors are computed. Half of them are corners of the box.
SEARCHED = 5000
_NOUNS = {"value": "V", "gradient": "a slope of V", "policy": "the policy"}


class LargestError(NamedTuple):
    """Largest relative error that the search found.

    name: "value", "gradient" or "policy".
    error: relative error.
    at: state z, (n,), with this error.
    """

    name: str
    error: float
    at: np.ndarray


class Findings(NamedTuple):
    """Findings on a critic that is not quadratic.

    checks: checks of the errors of a network at the origin and in the box, of the equilibrium, and
        of the cost if it is proved or the critic was simulated.
    proof: what is proved.
    flown: results of simulations, none if a cost within `NEAR` is proved.
    section: section of the report.
    states: number of states at which errors were computed, or 0 for a polynomial, whose errors are
        bounded without a search.
    """

    checks: list[Check]
    proof: Proof
    flown: FlightResults
    section: Section
    states: int


def findings_of(
    exact: Solution,
    critic: Critic,
    suboptimality: Suboptimality,
    b: np.ndarray,
    limit: float,
    flights: int,
    seconds: float,
    plant: NonlinearPlant | None,
) -> Findings:
    """Return what is proved of a critic, its errors over the box |z_i| <= b_i, and, if nothing is
    proved, the results of its simulations.

    suboptimality: cost of the policy u = -K z above the optimum
    limit: largest relative error that passes
    flights: number of initial conditions of simulations
    seconds: largest duration of the proof
    plant: nonlinear plant in continuous time, or None
    """
    at_origin, largest = search(exact, critic, b)
    # The errors of a polynomial are bounded, and its bounds are checked instead.
    checks = search_checks(critic, exact, at_origin, largest, limit) if critic.network else []
    proof, equilibrium = Proof(why="the critic is not finite"), None
    if critic.is_finite:
        equilibrium = equilibrium_of(exact, critic, b)
        if equilibrium is not None and not np.any(critic.u(np.zeros(len(b)))):
            equilibrium = np.zeros(len(b))
        checks.append(equilibrium_check(equilibrium, exact.P, b, limit))
        if seconds > 0.0:
            policy = critic.on_vectors or critic.policy
            proof = proof_of(exact, policy, equilibrium, b, NEAR / 100.0, seconds)
        else:
            proof = Proof(why="no time")
    flown = FlightResults()
    if not proof.excess <= NEAR / 100.0:
        flown = fly(exact, critic, suboptimality, b, flights, equilibrium, proof.violators, plant)
    if equilibrium is not None:
        z_and_u = np.append(equilibrium, critic.u(equilibrium))
        cost = float(z_and_u @ exact.game.weights @ z_and_u)
        flown = flown._replace(rest_point=equilibrium, equilibrium_cost=cost)
    is_discrete = exact.game.is_discrete
    if math.isfinite(proof.excess):
        above = 100.0 * proof.excess
        checks.append(below("cost_above_optimum_proved_percent", above, math.inf, "", kind="cost"))
    if flown.flights:
        why = "not all flights from the box converge"
        if flown.undecided_at is not None:
            clock = f"{flown.undecided_at:.3g} {'steps' if is_discrete else 's'}"
            why = f"a flight from the box is not decided within {clock}"
        costs = flown.cost_above_optimum_flown_percent
        # Every finite cost passes: only flights that do not converge have none.
        checks.append(below("cost_above_optimum_flown_percent", costs, math.inf, why, kind="cost"))
    section = nonlinear_section(
        critic, exact, b, largest, proof, flown, "step" if is_discrete else "second"
    )
    return Findings(checks, proof, flown, section, SEARCHED if critic.network else 0)


def search_checks(
    critic: Critic,
    exact: Solution,
    at_origin: float,
    largest: tuple[LargestError, ...],
    limit: float,
) -> list[Check]:
    """Return the checks of the errors that `search` found.

    limit: largest relative error that passes
    """
    says = f"the slope of V at the origin is off by {at_origin:.2g}"
    if critic.gradient is None:  # of a policy alone, u is off at the origin
        says = bias_text(critic, exact)
    checks = [at_most("origin_error", at_origin, limit, says, kind="error")]
    for found in largest:
        what = f"{_NOUNS[found.name]} in the box"
        checks.append(error_check(f"searched_{found.name}_error", found.error, limit, what))
    return checks


def errors_of(exact: Solution, critic: Critic, b: np.ndarray, z: ca.SX) -> tuple[list[str], ca.SX]:
    """Return the kind of each error of a critic, and the errors as expressions of the symbols z.

    The kinds are "value", "gradient" and "policy", as far as the critic has them. Errors of V are
    relative to b'|P| b, an upper bound on the exact V in the box. Other errors are relative to the
    largest exact dV/dz_i or u_i in the box, bounded below (`floored`). The constant of V is
    subtracted, because no policy depends on it.
    """
    P, K = exact.P, exact.K
    weights = np.sqrt(np.diag(exact.suboptimality_weight))
    # The floor compares sqrt(weight) u of the inputs, so that it does not depend on their units.
    sizes_of_u = floored(weights * (np.abs(K) @ b)) / weights
    table = (
        ("value", critic.value, ca.bilin(ca.DM(P), z, z), np.atleast_1d(b @ np.abs(P) @ b)),
        ("gradient", critic.gradient, 2.0 * ca.DM(P) @ z, floored(2.0 * np.abs(P) @ b)),
        ("policy", critic.policy, -ca.DM(K) @ z, sizes_of_u),
    )
    kinds, errors = [], []
    for kind, function, exact_value, sizes in table:
        if function is not None:
            constant = critic.constant if kind == "value" else 0.0
            kinds += [kind] * len(sizes)
            errors.append((function(z) - constant - exact_value) / ca.DM(sizes))
    return kinds, ca.vertcat(*errors)


def search(
    exact: Solution, critic: Critic, box: np.ndarray
) -> tuple[float, tuple[LargestError, ...]]:
    """Return the largest error at the origin, and those at `SEARCHED` states of the box."""
    z = critic.symbols
    kinds, errors = errors_of(exact, critic, box, z)
    errors_at = RowFunction(ca.Function("errors_at", [z], [ca.densify(errors)], {"cse": True}))
    states = np.vstack([starts_in(box, SEARCHED, seed=0), np.zeros((1, len(box)))])
    (found,) = errors_at(states)
    sizes = np.where(np.isfinite(found), np.abs(found), math.inf)
    largest: dict[str, LargestError] = {}
    for name, of_error in zip(kinds, sizes[:-1].T, strict=True):
        worst = int(np.argmax(of_error))
        if name not in largest or of_error[worst] > largest[name].error:
            largest[name] = LargestError(name, float(of_error[worst]), states[worst])
    return float(sizes[-1].max()), tuple(largest.values())


def nonlinear_section(
    critic: Critic,
    exact: Solution,
    b: np.ndarray,
    largest: tuple[LargestError, ...],
    proof: Proof,
    flown: FlightResults,
    period: str,
) -> Section:
    """Return the section of the report on a critic that is not quadratic.

    largest: largest errors found in the box
    proof: what is proved
    flown: results of the simulations
    period: unit of the time of a cost, "second" or "step"
    """
    functions = critic.network
    if not functions:
        assert critic.value is not None  # of weights that are not quadratic
        functions = {"V": critic.value}
    outputs = [name for name in FUNCTIONS if name in functions]
    if "gradient" in outputs and "V" in outputs:
        outputs.remove("gradient")  # its derivative
    if critic.implies_policy:  # computed from V or its gradient
        outputs.remove("policy")
    output = " and ".join(outputs)
    value = np.array(functions[outputs[0]](b)).ravel()
    constant = f", V(0) = {critic.constant:.4g}" if "V" in outputs else ""
    kind = f"Network of {output}" if critic.weights is None else "Polynomial V"
    errors = "; ".join(
        f"{_NOUNS[error.name]} {error.error:.3g} at ({_row(error.at)})" for error in largest
    )
    name = {"V": "V", "gradient": "dV/dz", "policy": "u"}[outputs[0]]
    lines = [
        f"{kind}, {critic.precision} weights, linearized exactly at the origin{constant}",
        f"Read: {critic.origin}",
        f"{name}({_row(b)}) = {_row(value)}; compare with your critic",
        f"Largest errors at {SEARCHED} states of the box (not a bound): {errors}",
        _proof_line(proof),
    ]
    data = {
        "output": output,
        "precision": critic.precision,
        "value_at_origin": critic.constant,
        "origin": critic.origin,
        "starts": SEARCHED,
        "searched": [error._asdict() for error in largest],
        "at": b,
        "value_at": value,
        **{name: found for name, found in flown._asdict().items() if name != "worst"},
        "why_not_proved": proof.why,
        "share_proved": proof.share,
        "boxes": proof.boxes,
    }
    bound = 100.0 * proof.excess
    at_top: dict[str, Any] = {
        "proved": math.isfinite(bound),
        "bound_percent": bound,
        "graded": {"cost_above_optimum_worst_percent": bound},
    }
    if flown.worst is not None:
        data["worst_flight"] = flown.worst.what
        at_top["counterexample"] = flown.worst.start
        lines.append(f"Worst flight from {_initial(exact, flown.worst.start)}")
    if flown.equilibrium_cost > 0.0:
        lines.append(f"The steady-state error costs {flown.equilibrium_cost:.2g} per {period}")
    return Section((*lines, *_flight_lines(flown)), {"network": data} | at_top)


def _initial(exact: Solution, state: np.ndarray) -> str:
    """Return a state as the options of `hfa fly`, in degrees for radians."""
    names = exact.names
    return " ".join(
        f"--initial {name}={math.degrees(value) if unit.startswith('rad') else value:.10g}"
        for name, unit, value in zip(names.states, names.state_units, state, strict=True)
        if value
    )


def _proof_line(proof: Proof) -> str:
    """Return the line of the report on what is proved."""
    if math.isfinite(proof.excess):
        above = percent(100.0 * proof.excess, 3, up=True)
        return f"Proved: stable, at most {above} above the optimum ({proof.boxes} boxes)"
    if proof.boxes:
        share = percent(100.0 * proof.share, 3)
        return f"Not proved: {proof.why}; the error is bounded in {share} of the tube of flights"
    return f"Not proved: {proof.why}"


def _row(numbers: np.ndarray) -> str:
    """Return numbers as text with four digits, separated by commas."""
    return ", ".join(f"{number:.4g}" for number in numbers)


def _flight_lines(flown: FlightResults) -> list[str]:
    """Return the lines of the report on the cost and the reach of the flights."""
    if not flown.flights:
        return []
    cost = "not all of them converge"
    if flown.undecided_at is not None:
        cost = "not decided"
    if math.isfinite(flown.cost_above_optimum_flown_percent):
        cost = (
            f"cost at most {percent(flown.cost_above_optimum_flown_percent, 3, up=True)} above the "
            f"optimum, {percent(flown.cost_above_optimum_flown_mean_percent, 3)} on average"
        )
    lines = [
        f"Simulated in the linear game from {flown.flights} initial conditions in the box (not a "
        f"bound): {cost}"
    ]
    if flown.reach_nonlinear is not None:
        few = min(FEW, flown.flights)
        lines.append(
            f"Converges from {flown.reach_nonlinear:g} times the box on the nonlinear plant within "
            f"the control limits (exact policy: {flown.reach_nonlinear_exact:g}; {few} initial "
            f"conditions each, factors up to {2**DOUBLINGS})"
        )
    return lines
