"""The learning laws by name, and the verb that runs one of them on data."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from controller.critic.training_run import TrainingRun
from controller.game.basis import basis
from controller.game.zero_sum import Game
from controller.learning.law_names import DEFAULT_LAW, LAW_NAMES
from controller.learning.plant_fit import PlantFit
from controller.learning.policy_iteration import policy_iteration
from controller.learning.published import published_law
from controller.learning.q_learning import learn_steps
from controller.learning.recorded import transitions_in
from controller.learning.recording import Samples, drawn
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from hfa_support.progress import Progress

#: Name -> law.
LAWS = dict(zip(LAW_NAMES, (policy_iteration, published_law), strict=True))


def learn(
    game: Game,
    law: str = DEFAULT_LAW,
    seed: int = 0,
    *,
    data: Any = None,
    progress: Progress | None = None,
) -> TrainingRun:
    """Return the training run of a learning law on data, with the learned value z'Pz and gain K.

    - "policy-iteration": of the linear fit of the data to its exact solution
    - "published": Eq. (46) of the paper with the gains of Theorem 1, as printed. Its weights
      overflow in the first steps on the aircraft of the paper

    A game in discrete time is learned by Q-learning.

    A law learns from random states, with their rates or next states in the plant: that of the
    game or, with `data`, their linear fit with a constant. A and B of the game are then not used
    (zeros serve), but that samples slower than a mode of A are refused, and E only if the data have
    no disturbances; the run has what the data can tell, and 95 % bands.

    The result is not verified. `hfa.verify` verifies it with the matrices of the game, as it does
    weights of a law of your own (examples/my_own_law.py).

    game: the game
    law: name of the law
    seed: seed of the random states, inputs and disturbances
    data: file, mapping or frame of recorded transitions, or a list of them, one for each episode:
        "x" (N, n) or (episodes, N, n), "u" (N, m), and "x_next" (states after each step) or
        "x_rate", or neither for successive samples; optionally "d" (N, k), "time" or "dt" (s),
        "episode" or flags of last rows ("terminals", ...), names and units ("states", "inputs",
        "state_units", "input_units"); or a column for each signal, such as "alpha [deg]" and
        "alpha_next [deg]"
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
    if game.is_discrete and law != DEFAULT_LAW:
        raise BadInputError("a game in discrete time is learned by Q-learning; leave out law")
    if not game.is_discrete and not game.without_cross_weights.Q.any():
        weight = "Q - N R^-1 N'" if game.N.any() else "Q"
        raise BadInputError(
            f"{weight} is zero, but every learning law divides by z'Qz; give at least one state a "
            "weight"
        )
    if data is None:
        return _learned(game, law, seed, progress)
    fit = PlantFit(game, transitions_in(data, game))
    fit.refuse_without_effect()
    summary = fit.summary()
    try:
        run = _learned(fit.game, law, seed, progress)
    except NoSolutionError as error:
        raise NoSolutionError(f"{error} (learned from {summary.text()})") from error
    if not fit.shows_noise:
        return replace(run, data=summary)
    bands = fit.bands(run.P)
    return replace(run, data=summary, P_band=bands.P, K_band=bands.K)


def _learned(game: Game, law: str, seed: int, progress: Progress | None) -> TrainingRun:
    """Return the training run of a law on states that are drawn for a game."""
    n = len(game.A)
    psi = basis("paper" if law == "published" and n == 6 else "quadratic", n)  # "paper": 6 states
    if game.is_discrete:
        law, learned = "Q-learning", learn_steps(game, seed, progress)
    else:
        # In the input u + F z, the game has the same value, and no cross weights.
        samples = Samples(game.without_cross_weights, psi, drawn(game, seed)[:, :n])
        learned = LAWS[law](samples, progress)
    return TrainingRun(
        law=law,
        basis=psi.name,
        W=learned.weights,
        residual_norm=learned.residual,
        K=game.gain(psi.matrix(learned.weights)),
        seed=seed,
        diagnostics=dict(learned.diagnostics),
        names=game.names,
        H=learned.H,
    )
