"""Policies of the laws `predictive` and `state-dependent`, and of `--keep-inside`, for commands."""

from __future__ import annotations

from controller.game.zero_sum import Game
from hfa_flight.policies.laws import LawSettings
from hfa_flight.problem import FlightProblem
from hfa_optimal.keep_inside import kept_inside as kept_inside
from hfa_optimal.predictive import MARGIN, RATES, Predictive, policy_of
from hfa_optimal.state_dependent import StateDependent, state_dependent_of


def predictive_law(problem: FlightProblem, game: Game, settings: LawSettings) -> Predictive:
    """Return the predictive policy whose plans end with P of a game."""
    margin = MARGIN if settings.margin is None else settings.margin
    estimate = settings.estimate or RATES
    return policy_of(problem, game, None, settings.horizon, margin, estimate)


def state_dependent_law(
    problem: FlightProblem, game: Game, settings: LawSettings
) -> StateDependent:
    """Return the policy of the state-dependent game."""
    return state_dependent_of(problem, game)
