"""`hfa verify` judges by numbers of the judge's own; of the learner's code it uses what is judged, and no yardstick."""

from __future__ import annotations

from import_graph import imports_of, project_sources

from verification import section5_configuration
from verification.critic.critic_errors import ORDINARY_DEVIATIONS

#: Values, bases and files: what a critic is made of.
JUDGED = {f"controller.game.{name}" for name in ("basis", "critic_file", "history", "learning_result")}


def test_the_command_takes_no_yardstick_from_the_learner() -> None:
    used = imports_of("hfa_cli.commands.verify", project_sources())
    assert {name for name in used if name.startswith("controller")} <= JUDGED


def test_the_box_of_the_judge_is_that_of_section_5() -> None:
    assert tuple(ORDINARY_DEVIATIONS) == section5_configuration().critic.box
