"""Training run of a learner of the study."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from controller.critic.training_run import Excitation, TrainingRun
from controller.game.zero_sum import Game
from studies.section5.laws.bellman_equations import StackEquations


def training_run(
    law: str,
    game: Game,
    equations: StackEquations,
    history: Mapping[str, np.ndarray],
    excitation: Excitation,
    seed: int,
    diagnostics: dict[str, float],
) -> TrainingRun:
    """Return the training run of a learner, from its history.

    law: name of the learner
    equations: Bellman residuals of the recorded samples
    history: name -> values at the recorded ticks (`controller.run`)
    excitation: rank of the data
    seed: seed of the samples
    diagnostics: name -> further number
    """
    P = equations.basis.matrix(history["weights"][-1])
    return TrainingRun(
        law=law,
        basis=equations.basis.name,
        time=history["time"],
        weights=history["weights"],
        residual_norm=history["residual_norm"],
        settling_residual=history["settling_residual"],
        K=game.gain(P),
        excitation=excitation,
        seed=seed,
        diagnostics=diagnostics,
        names=game.names,
    )
