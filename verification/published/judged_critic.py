"""A critic learned on one linear model and held against its exact game solution, in one call."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from controller.game.basis import basis
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import published_game
from controller.laws.learn import learn
from hfa_model.support.report import Report, Reported
from hfa_model.support.text import angle_text
from trim.linear.linearize import LinearModel
from verification.critic.candidate import from_weights
from verification.critic.check_figure import check_figure
from verification.critic.check_report import check_report
from verification.critic.critic_check import ORDINARY_DEVIATIONS, CriticCheck, check_critic

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class JudgedCritic(Reported):
    """The model, the run of the default law on the paper's game, and the verdict."""

    model: LinearModel
    run: LearningResult
    check: CriticCheck

    def report(self) -> Report:
        """The table of checks and the entries of P and K."""
        model, point = self.model, self.model.point
        origin = f"the model at dihedral {angle_text(point.states.dihedral)}, {point.dynamics} dynamics"
        return check_report(self.check, model.states, model.inputs, origin)


def judged_critic(model: LinearModel) -> JudgedCritic:
    """Learn with the default law and settings, then check."""
    game = published_game(model.A, model.B)
    run = learn(game)
    functions = basis(run.basis, len(model.A))
    candidate = from_weights(game, run.weights[-1], functions)
    time = run.settings["predefined_time"]
    check = check_critic(game, candidate, functions, box=np.array(ORDINARY_DEVIATIONS), run=run, predefined_time=time)
    return JudgedCritic(model, run, check)


def critic_picture(critic: JudgedCritic) -> Figure:
    """Heat maps of P and the errors over time."""
    functions = basis(critic.run.basis, len(critic.model.A))
    return check_figure(
        critic.check,
        critic.model.states,
        critic.model.inputs,
        functions,
        critic.run,
        critic.run.settings["predefined_time"],
    )
