"""Critics compared with the nonlinear game, coefficient by coefficient."""

import re
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hfa
from hfa import Model, Signal
from hfa_support.reporting.text import percent
from verification.box import BoxFlights
from verification.nonlinear_game import DegreeError, NonlinearComparison

#: Number of flights of a verdict; the default takes longer.
QUICK = 3
#: Default limit of errors.
LIMIT = 1e-6
#: Deviation of the two states of `MIXED` from its trim.
Z = ca.SX.sym("z", 2)


def mixed(x, u, p, w):
    """Return a plant in mixed units that is not affine in its inputs."""
    rates = {
        "a": -ca.sin(x.a) + 1e-4 * x.b**2 + u.u + 0.3 * u.u * u.v,
        "b": 50.0 * x.a + 0.5 * x.b + 100.0 * u.v * ca.cos(x.a) + 10.0 * u.u**2,
    }
    return rates, {}


MIXED = Model(
    "mixed",
    {"a": Signal(), "b": Signal()},
    {"u": Signal(), "v": Signal()},
    mixed,
    trim={"a": 0.0, "b": 0.0},
)


@cache
def mixed_game(order):
    """Return the linear model of `MIXED` at its trim, its game, and the exact expansion of value and
    policy to an order.
    """
    linear = hfa.linearize(MIXED, hfa.trim(MIXED))
    game = hfa.game(linear, Q=[1.0, 2e-4], R=[0.5, 0.8], delta=5.0, E=[[0.3], [10.0]])
    return linear, game, hfa.expand(linear, hfa.solve(game), order)


def compared(critic, linear, game):
    """Return the comparison of a critic with the nonlinear game."""
    return hfa.verify(game, critic, flights=1, linear=linear, taylor=True).nonlinear


def test_the_exact_critic_passes_on_the_nonlinear_game():
    """The exact value of the nonlinear game has the verdict PASS if flights of the exact policy
    converge from the whole box, else NEAR.
    """
    linear, game, expansion = mixed_game(4)
    critic = hfa.from_weights(game, expansion.weights, basis="quartic")
    said = []
    verdict = hfa.verify(
        game, critic, flights=QUICK, linear=linear, progress=lambda *done: said.append(done[-1])
    )
    assert said[:2] == ["power series", "flights from the box"]
    is_whole = verdict.nonlinear.flown.part == 1.0
    assert (verdict.ok, verdict.grade) == (is_whole, "exact" if is_whole else "near")
    word = "PASS" if is_whole else "NEAR"
    assert verdict.headline.startswith(f"{word} on the nonlinear game in")
    assert verdict.nonlinear.flown.suboptimality < 1e-9
    assert verdict.nonlinear.radius.degree == 4


def judged(expansion, game, linear, change):
    """Return the verdict on the exact value with the exact policy plus `change`, and this policy.

    change: expression of `Z`
    """
    both = ca.Function("both", [Z], [ca.vertcat(expansion.V(Z), expansion.policy(Z) + change)])
    critic = replace(
        hfa.from_network(game, both, network="V+policy"),
        weights=expansion.weights,
        basis=expansion.basis,
        has_weights=True,
    )
    return hfa.verify(game, critic, flights=8, linear=linear), critic.policy


def test_a_policy_with_wrong_terms_of_degree_9_fails_by_its_flights():
    """The coefficients of a policy are compared to degree 3, so that wrong terms of degree 9 are
    found only by flights from the box: they diverge, or cost more than 5 % of the largest optimum. The cost is that of
    a simulation by DOP853. `judged` returns the verdict on the exact V with the exact policy plus a
    change, and this policy.
    """
    linear, game, expansion = mixed_game(4)
    a, b = hfa.verify(game, hfa.solve(game)).box.half_widths
    for size, diverges in ((-1.0, False), (1.0, True)):
        change = ca.vertcat(size * (Z[0] / a) ** 9, size * (Z[1] / b) ** 9)
        verdict, policy = judged(expansion, game, linear, change)
        flown = verdict.nonlinear.flown
        assert verdict.nonlinear.has_right_terms
        assert not verdict.ok
        assert (flown.diverged > 0) == diverges == np.isinf(flown.suboptimality)
        if not diverges:
            costs = [flight_cost(game, each, flown.worst) for each in (policy, expansion.policy)]
            box = np.array([a, b])
            largest = np.linalg.eigvalsh(expansion.solution.P * np.outer(box, box))[-1]
            optimum = largest * np.sum((flown.worst / box) ** 2)
            above = (costs[0] - costs[1]) / optimum
            assert flown.suboptimality == pytest.approx(above, rel=1e-2)
            assert flown.suboptimality > 0.05
            text = " ".join(str(verdict).split())
            assert (
                f"8 flights cost at most {percent(100.0 * flown.suboptimality, up=True)} of the largest"
                in text
            )


def flight_cost(game, policy, start):
    """Return the cost of a flight of `MIXED` from a state (a, b), by DOP853."""

    def rate(_, w):
        a, b, _ = w
        u, v = np.array(policy([a, b])).ravel()
        cost = game.Q[0, 0] * a**2 + game.Q[1, 1] * b**2 + game.R[0, 0] * u**2
        return [
            -np.sin(a) + 1e-4 * b**2 + u + 0.3 * u * v,
            50.0 * a + 0.5 * b + 100.0 * v * np.cos(a) + 10.0 * u**2,
            cost + game.R[1, 1] * v**2,
        ]

    solved = solve_ivp(rate, (0.0, 20.0), [*start, 0.0], method="DOP853", rtol=1e-6, atol=1e-9)
    return float(solved.y[2, -1])


def test_one_wrong_coefficient_is_found():
    """A critic with one wrong coefficient fails, and this is named as the worst one.

    Its relative error is 1 %, unless the coefficient contributes less than 1e-5 of the
    largest one of its degree to V where V2 <= 1: then it is relative to this fraction.
    """
    linear, game, expansion = mixed_game(4)
    exponents = expansion.basis.exponents
    reach = np.prod(np.sqrt(np.diag(np.linalg.inv(expansion.solution.P))) ** exponents, axis=1)
    parts = np.abs(expansion.weights) * reach  # of V, at most, where V2 <= 1
    for index in (0, 4, 8):  # of degree 2, 3 and 4
        degree = exponents[index].sum()
        least = 1e-5 * parts[exponents.sum(axis=1) == degree].max()
        error = 0.01 * parts[index] / max(parts[index], least)
        weights = expansion.weights.copy()
        weights[index] *= 1.01
        critic = hfa.from_weights(game, weights, basis="quartic")
        found = compared(critic, linear, game)
        assert not found.ok
        wrong = max(found.errors, key=lambda each: each.error)
        assert wrong.learned == weights[index]
        assert wrong.exact == pytest.approx(expansion.weights[index], rel=1e-9)
        assert (wrong.degree, wrong.error) == (degree, pytest.approx(error, rel=1e-6))
        share = float(found.sentence.rpartition("off by ")[2].removesuffix(" %)"))
        assert share == pytest.approx(100.0 * wrong.error, rel=0.05)


def test_missing_coefficients_are_found():
    """A critic of degree 4 without cubic terms, and with only one quartic term, is wrong in degrees 3
    and 4, and has no radius in which flights confirm its value.
    """
    linear, game, expansion = mixed_game(4)
    exact = expansion.weights  # three of degree 2, four of degree 3, and then that of x1⁴
    critic = hfa.from_weights(game, [*exact[:3], exact[7]], basis="x1**2, x1*x2, x2**2, x1**4")
    found = compared(critic, linear, game)
    assert {each.degree for each in found.errors if each.error > LIMIT} == {3, 4}
    worst = max(found.errors, key=lambda each: each.error)
    assert found.sentence.startswith(f"V wrong in degree 3, 4 (worst: {worst.worst}, off by")
    assert found.radius is None


def test_a_network_is_compared_on_request():
    """The Taylor coefficients of a network are compared only with taylor=True, which is refused
    without an aircraft and for a quadratic value.
    """
    linear, game, expansion = mixed_game(4)
    network = hfa.from_network(game, ca.Function("policy", [Z], [expansion.policy(Z)]))
    plain = hfa.verify(game, network, flights=QUICK, linear=linear)
    assert plain.nonlinear is None
    asked = hfa.verify(game, network, flights=QUICK, linear=linear, taylor=True)
    assert asked.nonlinear.ok
    for critic, model in ((network, None), (hfa.solve(game), linear)):
        with pytest.raises(hfa.BadInputError, match="taylor requires"):
            hfa.verify(game, critic, linear=model, taylor=True)


def test_taylor_coefficients_of_a_policy_are_compared_to_degree_3():
    """A policy is right with an added term of degree 9, and wrong with one
    of degree 3, which is then the worst.
    """
    linear, game, expansion = mixed_game(4)
    for change, is_right in ((0.0, True), (1e-3 * Z[0] ** 2 * Z[1], False), (Z[1] ** 9, True)):
        u = expansion.policy(Z) + ca.vertcat(0.0, change)
        critic = hfa.from_network(game, ca.Function("policy", [Z], [u]), network="policy")
        found = compared(critic, linear, game)
        assert found.has_right_terms == is_right
        worst = max(found.errors, key=lambda each: each.error).worst
        assert is_right or worst.startswith("v: ")


def test_the_error_of_a_policy_does_not_depend_on_the_units_of_an_input():
    """The error of a wrong coefficient of the input v is the same if v has a unit 1e7 times larger,
    so that its coefficients are small beside those of u.
    """
    errors = []
    for unit in (1.0, 1e7):

        def in_unit(x, u, p, w, unit=unit):
            return mixed(x, u._replace(v=unit * u.v), p, w)

        model = Model("mixed", MIXED.states, MIXED.inputs, in_unit, trim={"a": 0.0, "b": 0.0})
        linear = hfa.linearize(model, hfa.trim(model))
        game = hfa.game(linear, Q=[1.0, 2e-4], R=[0.5, 0.8 * unit**2])
        exact = hfa.expand(linear, hfa.solve(game), 4).policy(Z)
        wrong = ca.vertcat(exact[0], exact[1] + 1e-2 / unit * Z[0] ** 2)
        policy = hfa.from_network(game, ca.Function("policy", [Z], [wrong]), network="policy")
        found = compared(policy, linear, game)
        errors.append(max(found.errors, key=lambda each: each.error))
    assert errors[0].worst == errors[1].worst
    assert errors[1].error == pytest.approx(errors[0].error, rel=1e-5)


FLOWN = BoxFlights("box", 1.0, np.ones(2), 9.0, np.zeros(2), 8, suboptimality=0.02, resolved=True)


@pytest.mark.parametrize(
    ("flown", "where", "words", "within"),
    [
        (FLOWN, "box", "8 flights cost at most 2 % of the largest optimum", True),
        (replace(FLOWN, suboptimality=1e-12), "box", "at most 0 % of", True),
        (replace(FLOWN, suboptimality=0.05), "box", "at most 5 % of", True),
        (replace(FLOWN, suboptimality=0.06), "box", "at most 6 % of", False),
        (replace(FLOWN, part=0.25), "0.25 of the box", "at most 2 %", True),
        (replace(FLOWN, part=0.0), "box", "converges from no part", False),
        (replace(FLOWN, diverged=3, suboptimality=np.inf), "box", "3 of 8 flights diverge", False),
        (replace(FLOWN, undecided=2, suboptimality=np.nan), "box", "2 of 8 .* within 9 s", False),
        (replace(FLOWN, resolved=False), "box", "but are not resolved", False),
    ],
)
def test_what_flights_say(flown, where, words, within):
    """The part of the box, the first finding, and whether all converge, are resolved and cost at most 5 %
    more; a critic with right coefficients passes with them, in a part of the box "near".

    With a limit of the cost, the coefficients do not decide.
    """
    assert flown.where == where
    assert re.search(words, flown.sentence)
    assert flown.within(0.05) is within
    error = DegreeError("V", 2, 1e-9, "a**2", 1.0, 1.0)
    for each, is_right in ((error, True), (replace(error, error=1e-3), False)):
        compared = NonlinearComparison((each,), LIMIT, mixed_game(4)[2], flown)
        passes = "exact" if flown.part == 1.0 else "near"
        assert compared.grade() == (passes if within and is_right else "fail")
        assert compared.grade(5.0) == (passes if within else "fail")
        assert compared.ok is (compared.grade() == "exact")
        assert replace(compared, flown=None).grade() == ("exact" if is_right else "fail")
        lines = compared.part()
        assert flown.flights == 0 or any(flown.sentence in str(line) for line in lines[1:])
        assert ("z'Pz <=" in lines[0]) is is_right


def test_what_coefficients_say():
    """The wrong degrees of V, or of u, with the worst term and how it differs."""
    right = DegreeError("V", 2, 1e-9, "a**2", 1.0, 1.0)
    wrong = DegreeError("u", 3, 0.25, "u: a**3", 1.25, 1.0)
    for errors, words in (
        ((right, replace(right, degree=4)), "every coefficient of V to degree 4 within 1e-06"),
        (
            (right, wrong, replace(wrong, degree=1, error=0.1)),
            "u wrong in degree 3, 1 (worst: u: a**3, off by 25 %)",
        ),
        ((replace(wrong, exact=0.0),), "(worst: u: a**3, 1.25 in place of 0)"),
        ((replace(wrong, error=np.inf, learned=np.nan),), "(worst: u: a**3, not finite)"),
    ):
        assert words in NonlinearComparison(errors, LIMIT, mixed_game(4)[2]).sentence
