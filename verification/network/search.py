"""Errors of a critic that is a nonlinear function of the state, over a box of states.

A search returns a lower bound on the largest error.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from controller.critic.critic import FUNCTIONS, Critic
from controller.riccati.gare import Solution
from hfa_support.matrices import quadratic_forms
from hfa_support.native.bound import RowFunction
from hfa_support.reporting.report import Check, at_most, below
from hfa_support.reporting.text import percent, shown_values
from verification.box import starts_in
from verification.critic_errors import equilibrium_check, error_check, floored
from verification.network.loops import FlightResults, equilibrium_of, fly
from verification.network.proof import proof_of
from verification.verdict import NEAR, Proof, Section, bias_text

#: Number of states at which the errors are computed. Every second one is a corner of the box.
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
    worst: np.ndarray,
    b: np.ndarray,
    limit: float,
    flights: int,
    seconds: float,
) -> Findings:
    """Return what is proved of a critic, its errors over the box |z_i| <= b_i, and, if nothing is
    proved, the results of its simulations.

    worst: initial state from which u = -K z costs most
    limit: largest relative error that passes
    flights: number of initial conditions of simulations
    seconds: largest duration of the proof
    """
    at_origin, largest = search(exact, critic, b)
    checks = []
    if critic.network:  # the errors of a polynomial are bounded, and its bounds are checked instead
        says = f"the slope of V at the origin is off by {at_origin:.2g}"
        if critic.gradient is None:  # of a policy alone, u is off at the origin
            says = bias_text(critic, exact)
        checks = [at_most("origin_error", at_origin, limit, says, kind="error")]
        for name, error, _ in largest:
            what = f"{_NOUNS[name]} in the box"
            checks.append(error_check(f"searched_{name}_error", error, limit, what))
    proof, flown = Proof(why="the critic is not finite"), FlightResults()
    equilibrium = None
    if critic.is_finite:
        trim = np.zeros(len(b))
        is_there = not np.any(critic.u(trim))
        equilibrium = trim if is_there else equilibrium_of(exact, critic, b, trim)
        checks.append(equilibrium_check(equilibrium, exact.P, b, limit))
        proof = Proof(why="no equilibrium near the trim is found")
        if equilibrium is not None:
            proof = proof_of(exact, critic.policy, equilibrium, b, NEAR / 100.0, seconds)
            if flights and not proof.excess <= NEAR / 100.0:
                flown = fly(exact, critic, worst, b, flights, equilibrium, proof.violators)
    if flown.flights:
        costs = flown.cost_above_optimum_flown_percent
        why = "not each flight from the box converges"
        if math.isnan(costs):
            why = "a flight from the box neither converges nor diverges"
        # Every finite cost passes: only flights that do not converge have none.
        checks.append(below("cost_above_optimum_flown_percent", costs, math.inf, why, kind="cost"))
    section = nonlinear_section(critic, exact, b, largest, proof, flown, equilibrium)
    return Findings(checks, proof, flown, section, SEARCHED if critic.network else 0)


def search(
    exact: Solution, critic: Critic, box: np.ndarray
) -> tuple[float, tuple[LargestError, ...]]:
    """Return the largest error at the origin, and those at `SEARCHED` states of the box.

    Errors of V are relative to b'|P| b, an upper bound on the exact V in the box. Other errors are
    relative to the largest exact dV/dz_i or u_i in the box, bounded below (`floored`). The constant
    of V is subtracted, because no policy depends on it.
    """
    P, K = exact.P, exact.K
    states = np.vstack([starts_in(box, SEARCHED, seed=0), np.zeros((1, len(box)))])
    weights = np.sqrt(np.diag(exact.suboptimality_weight))
    # The floor compares sqrt(weight) u of the inputs, so that it does not depend on their units.
    sizes_of_u = floored(weights * (np.abs(K) @ box)) / weights
    V = quadratic_forms(states, P)[:, None] + critic.constant
    at_origin, largest = 0.0, []
    for name, function, exact_values, sizes in (
        ("value", critic.value, V, box @ np.abs(P) @ box),
        ("gradient", critic.gradient, 2.0 * states @ P, floored(2.0 * np.abs(P) @ box)),
        ("policy", critic.policy, -states @ K.T, sizes_of_u),
    ):
        if function is not None:
            (values,) = RowFunction(function)(states)
            errors = np.abs((values.reshape(exact_values.shape) - exact_values) / sizes).max(axis=1)
            errors = np.where(np.isfinite(errors), errors, math.inf)
            worst = int(np.argmax(errors[:-1]))
            largest.append(LargestError(name, float(errors[worst]), states[worst]))
            at_origin = max(at_origin, float(errors[-1]))
    return at_origin, tuple(largest)


def nonlinear_section(
    critic: Critic,
    exact: Solution,
    b: np.ndarray,
    largest: tuple[LargestError, ...],
    proof: Proof,
    flown: FlightResults,
    equilibrium: np.ndarray | None,
) -> Section:
    """Return the section of the report on a critic that is not quadratic.

    largest: largest errors found in the box
    proof: what is proved
    flown: results of the simulations
    equilibrium: of the policy, or None
    """
    functions: Any = critic.network or {"V": critic.value}  # of weights that are not quadratic
    outputs = [name for name in FUNCTIONS if name in functions]
    if "gradient" in outputs and "V" in outputs:
        outputs.remove("gradient")  # its derivative
    output = " and ".join(outputs)
    value = np.array(functions[outputs[0]](b)).ravel()
    kind = f"Network of {output}" if critic.weights is None else "Polynomial V"
    errors = "; ".join(f"{_NOUNS[name]} {error:.3g} at ({_row(at)})" for name, error, at in largest)
    name = {"V": "V", "gradient": "dV/dz", "policy": "u"}[outputs[0]]
    proved = f"Not proved: {proof.left}"
    bound = 100.0 * proof.excess
    if proof.is_found:
        above = percent(bound, 3, up=True)
        proved = f"Proved: stable, at most {above} above the optimum ({proof.boxes} boxes)"
    lines = [
        f"{kind}, {critic.precision} weights, linearized exactly at the origin",
        f"Read: {critic.origin}",
        f"{name}({_row(b)}) = {_row(value)}; compare with your critic",
        f"Largest errors at {SEARCHED} states of the box (not a bound): {errors}",
        proved,
    ]
    data = {
        "origin": critic.origin,
        "searched": [error._asdict() for error in largest],
        "value_at": value,
        "flights": flown.flights,
        "cost_above_optimum_flown_percent": flown.cost_above_optimum_flown_percent,
        "why_not_proved": proof.why,
        "share_proved": proof.share,
        "boxes": proof.boxes,
    }
    at_top: dict[str, Any] = {
        "proved": proof.is_found,
        "bound_percent": bound,
        "graded": {"cost_above_optimum_worst_percent": bound},
    }
    if flown.worst is not None:
        data["worst_flight"] = flown.worst._asdict()
        if flown.cost_above_optimum_flown_percent > NEAR:
            at_top["counterexample"] = flown.worst.start
        names = exact.names
        # As the options of `hfa fly`, in degrees for radians.
        options = " ".join(
            f"--initial {name}={shown_values(value, unit):.10g}"
            for name, unit, value in zip(
                names.states, names.state_units, flown.worst.start, strict=True
            )
            if value
        )
        lines.append(f"Worst flight from {options}")
    if equilibrium is not None:
        z_and_u = np.append(equilibrium, critic.u(equilibrium))
        cost = float(z_and_u @ exact.game.weights @ z_and_u)
        data |= {"rest_point": equilibrium, "equilibrium_cost": cost}
        if cost > 0.0:
            period = "step" if exact.game.is_discrete else "second"
            lines.append(f"The steady-state error costs {cost:.2g} per {period}")
    return Section(tuple(lines), {"network": data} | at_top)


def _row(numbers: np.ndarray) -> str:
    """Return numbers as text with four digits, separated by commas."""
    return ", ".join(f"{number:.4g}" for number in numbers)
