"""A critic learned on one linear model and compared with its exact game solution, in one call."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from controller.game.learning_result import LearningResult
from controller.game.zero_sum import published_game
from controller.laws.learn import learn
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import angle_text
from trim.linear.linear_model import LinearModel
from verification.critic.candidate import from_run
from verification.critic.check_result import CriticCheck, check_figure, check_report
from verification.critic.critic_check import check_critic

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
        return check_report(self.check, *self.names)

    @property
    def names(self) -> tuple[tuple[str, ...], tuple[str, ...], str, tuple[str, ...], tuple[str, ...]]:
        """States, inputs, what the model is called, units of states and inputs."""
        model, point = self.model, self.model.point
        origin = f"the model at dihedral {angle_text(point.states.dihedral)}, {point.dynamics} dynamics"
        return model.states, model.inputs, origin, model.state_units, model.input_units


def judged_critic(model: LinearModel) -> JudgedCritic:
    """Learn with the default law and settings, then check."""
    game = published_game(model.A, model.B)
    run = learn(game)
    candidate = from_run(game, run)
    return JudgedCritic(
        model, run, check_critic(game, candidate, run=run, predefined_time=run.settings["predefined_time"])
    )


def critic_picture(critic: JudgedCritic) -> Figure:
    """Heat maps of P and the errors over time."""
    time = critic.run.settings["predefined_time"]
    return check_figure(critic.check, *critic.names, run=critic.run, predefined_time=time)
