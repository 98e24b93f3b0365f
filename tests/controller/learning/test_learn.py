"""`hfa.learn`: exact solutions from samples, the paper's law, refusals, and equal seeds."""

from dataclasses import replace

import numpy as np
import pytest
from game_samples import game_models

import controller
import hfa
from controller.learning.published import PublishedLaw
from hfa import BadInputError, Game, NoSolutionError, learn, verify
from verification import relative_error

STABLE = Game(
    A=[[-0.2, 1.0], [-2.0, -0.3]],
    B=[[0.0], [1.0]],
    E=[[1.0], [0.5]],
    Q=np.diag([2.0, 1.0]),
    R=[[0.5]],
    delta=3.0,
)
SAMPLED = replace(STABLE, N=[[0.1], [0.1]]).sampled(0.3, discount=0.97)
#: Game of the linear model that the paper prints for the dihedral 5 deg.
PAPER = game_models()["published-5"]


@pytest.mark.parametrize(
    "game",
    [
        *game_models().values(),
        STABLE,
        replace(STABLE, N=[[0.1], [0.1]]),  # with cross weights
        STABLE.with_delta(np.inf),
        SAMPLED,
    ],
)
def test_the_learned_solution_is_the_exact_one(game):
    """P and K that `learn` finds from samples agree with those of `solve` within a relative 1e-9, and
    `verify` accepts the run.
    """
    run = learn(game, seed=4)
    exact = hfa.solve(game)
    assert (run.outcome, run.basis) == ("settled", "quadratic")
    assert relative_error(run.P, exact.P) < 1e-9
    assert relative_error(run.K, exact.K) < 1e-9
    if game.is_discrete:
        assert relative_error(run.H, exact.H) < 1e-9
    assert verify(game, run).ok


def test_the_refusal_names_the_smallest_delta():
    """For a delta 10 % below the smallest one, the refusal states the smallest one within 0.01 %."""
    smallest = hfa.solve(STABLE).delta_min
    with pytest.raises(NoSolutionError) as refused:
        learn(STABLE.with_delta(0.9 * smallest))
    with pytest.raises(NoSolutionError, match="choose a larger delta"):
        learn(SAMPLED.with_delta(0.9 * hfa.solve(SAMPLED).delta_min))
    end = float(str(refused.value).partition("exist at delta = ")[2].partition(";")[0])
    assert end == pytest.approx(smallest, rel=1e-4)


#: Case -> (call, words of the message).
REFUSED = {
    "law": (lambda: learn(PAPER, "sarsa"), "choose from policy-iteration"),
    "no cost": (lambda: learn(replace(STABLE, Q=np.zeros((2, 2)))), "Q is zero"),
    "law of steps": (lambda: learn(SAMPLED, "published"), "learned by Q-learning; leave out law"),
    "singular R": (lambda: learn(replace(SAMPLED, R=[[0.0]], N=None)), "R is singular"),
    "unstable": (
        lambda: learn(Game([[0.5]], [[0.0]], Q=[[1.0]], R=[[1.0]])),
        r"cannot be lowered below 0\.5 1/s",
    ),
    "no delta": (
        lambda: learn(STABLE.with_delta(1e-9)),
        "the law finds no solution for delta = 1e",
    ),
    "no input": (lambda: learn(Game([[1.2]], [[0.0]], Q=[[1.0]], R=[[1.0]], dt=True)), "diverges"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_unusable_arguments_are_refused(case):
    """An unknown law, Q = 0, and an unstable plant that no input reaches are refused."""
    call, words = REFUSED[case]
    with pytest.raises((BadInputError, NoSolutionError), match=words):
        call()


# The law of the paper.


SCALAR = Game([[-1.0]], [[1.0]], E=[[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
#: W(0) of the paper.
FIRST = 100.0


def printed_law(game, states, drifts):
    """Return regressors, constants, α1 and α2 (Eq. 32-33 and 48-49), sample by sample.

    The paper has γ = 0.01, η = 0.8 and T = 5 s; θ is 0.9. With the least eigenvalue λ0 of the Gram
    matrix of n regressors, c1 = (2 γ λ0)^(1 - η / 2), and c2 = n^(-η / 2) (2 γ λ0)^(1 + η / 2).
    """
    n = len(game.A)
    S = game.B @ np.linalg.inv(game.R) @ game.B.T - game.E @ game.E.T / game.delta**2
    one = np.eye(n)
    regressors, constants = [], []
    for z, F in zip(states, drifts, strict=True):
        slopes = np.array([z[i] * one[j] + z[j] * one[i] for i in range(n) for j in range(i, n)])
        v = FIRST * slopes.sum(axis=0)
        sigma = slopes @ (F - 0.5 * S @ v)
        size = np.sqrt(1.0 + sigma @ sigma)
        regressors.append(sigma / size)
        constants.append((z @ game.Q @ z + 0.25 * v @ S @ v) / size)
    rows = np.array(regressors)
    least = np.linalg.eigvalsh(rows.T @ rows)[0]
    c1, c2 = (0.02 * least) ** 0.6, len(rows) ** -0.4 * (0.02 * least) ** 1.4
    alpha1, alpha2 = (np.pi / (0.9 * 5.0 * 0.8 * c) for c in (c1, c2))
    return rows, np.array(constants), alpha1, alpha2


def test_the_law_as_printed_overflows_on_the_aircraft_of_the_paper():
    """The paper's learning law, with its explicit steps, is refused for the paper's aircraft. The message
    has the step at which it overflows, and the limit of explicit steps for its gains.
    """
    with pytest.raises(NoSolutionError, match=r"overflows at step .* explicit step below"):
        learn(PAPER, "published")


def test_the_law_as_printed_is_eq_46():
    """The rate of the paper's law for the weight W of a scalar game is that of Eq. (46), with γ = 0.01,
    written sample by sample, and α1 and the largest step of explicit Euler are its own.

    The exponents are 1 - η = 0.2 and 1 + η = 1.8.
    """
    states = np.linspace(0.5, 1.5, 50)[:, None]
    rows, constants, alpha1, alpha2 = printed_law(SCALAR, states, -states)

    def rate(W):
        e = rows[:, 0] * W + constants
        size = (alpha1 + 1.0) * np.abs(e) ** 0.2 + (alpha2 + 1.0) * np.abs(e) ** 1.8
        return -0.01 * np.sum(rows[:, 0] * np.sign(e) * size)

    law = PublishedLaw(SCALAR, controller.basis("quadratic", 1), states)
    for W in (-20.0, 0.3, FIRST):
        assert law.rate(np.array([W])) == pytest.approx(rate(W), rel=1e-9)
    least = np.linalg.eigvalsh(rows.T @ rows)[0]
    assert law.gains[:3] == pytest.approx((least, alpha1, alpha2))
    slope = (rate(FIRST + 1e-3) - rate(FIRST - 1e-3)) / 2e-3
    assert law.gains.explicit_step_limit == pytest.approx(-2.0 / slope, rel=1e-6)
