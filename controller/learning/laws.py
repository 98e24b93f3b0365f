"""The learning laws by name, and the verb that runs one of them."""

from __future__ import annotations

from controller.critic.training_run import TrainingRun
from controller.game.zero_sum import Game
from controller.learning.law_names import DEFAULT_LAW, LAW_NAMES
from controller.learning.policy_iteration import policy_iteration
from controller.learning.published import published_law
from controller.learning.q_learning import learn_steps
from controller.learning.recording import Stack
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.progress import Progress

#: Name -> law.
LAWS = dict(zip(LAW_NAMES, (policy_iteration, published_law), strict=True))


def learn(
    game: Game,
    law: str = DEFAULT_LAW,
    seed: int = 0,
    *,
    pool: Stack | None = None,
    progress: Progress | None = None,
) -> TrainingRun:
    """Return the training run of a learning law on a game, with the learned value z'Pz and gain K.

    - "policy-iteration": from recorded samples (z, F = A z) to the exact solution, without A
    - "published": Eq. (46) of the paper with the gains of Theorem 1, as printed. Its weights
      overflow in the first steps on the aircraft of the paper

    A game in discrete time is learned by Q-learning from recorded steps (`learn_steps`).

    Use `controller.run` for a learning law that you define yourself. The result is not verified.
    `hfa.verify` verifies it with the matrix A of the game.

    game: the game
    law: name of the law
    seed: seed of the samples
    pool: recorded samples (z, F); by default states drawn with `seed`
    progress: called with (fraction done, 1, text), or None

    Raises BadInputError for an unknown law, for Q = 0, and for data that cannot determine the
    weights. Raises NoSolutionError if the law cannot finish: the game has no value at this delta,
    (A, B) is not stabilizable, or numbers overflow.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> hfa.learn(game, seed=1).K.round(4).tolist()
    [[3.0972]]
    """
    refuse_unknown("unknown law", law, LAWS)
    if game.is_discrete:
        if law != DEFAULT_LAW or pool is not None:
            raise BadInputError(
                "a game in discrete time is learned by Q-learning from its own samples; leave out"
                " law and pool"
            )
        return learn_steps(game, seed, progress)
    if not game.without_cross_weights.Q.any():
        weight = "Q - N R^-1 N'" if game.N.any() else "Q"
        raise BadInputError(
            f"{weight} is zero, but every learning law divides by z'Qz; give at least one state a "
            "weight"
        )
    return LAWS[law](game, pool, seed, progress)
