"""The commands `hfa solve`, `hfa learn` and `hfa verify` for a discrete-time plant."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from controller.game.discrete_game import DiscreteGame
from controller.game.zero_sum import Game
from hfa.options.output import ProgressLine, show
from hfa_support.errors import BadInputError, NoSolutionError, prefix_errors

if TYPE_CHECKING:
    from controller.critic.critic import Critic
    from hfa.commands.game import GameRequest, LearnRequest
    from hfa.commands.verify import VerifyRequest
    from hfa.options.games import NamedGame
    from verification.scope import Scope
    from verification.verdict import Verdict

#: Results that the commands write, as in `hfa.entry_points`.
RESULTS = (
    "controller.discrete.report:AnalysedDiscreteGame hfa.options.games:NamedGame",
    "verification.critic.discrete:DiscreteVerdict verification.verdict:Details"
    " hfa.options.games:Weights hfa.options.games:NamedGame",
)
#: Reason why an option is refused.
_CONTINUOUS = "applies only to continuous time; remove this option for a plant with time = discrete"


def question_of_time(game: Game) -> str:
    """Return the question whether discrete time was meant, as the end of an error message.

    Return "" if the game has no discrete-time solution either.

    game: game without a continuous-time solution
    """
    from controller.discrete.solution import solve_discrete

    with suppress(NoSolutionError):
        solve_discrete(DiscreteGame(game))
        return '; x⁺ = A x + B u has a solution: did you mean time = "discrete"?'
    return ""


def solve(request: GameRequest, named: NamedGame) -> int:
    """Run `hfa solve` for a discrete-time plant and return the exit code."""
    from controller.discrete.report import analyse_discrete, discrete_report

    request.refuse(("draws",), _CONTINUOUS)
    analysed = analyse_discrete(named.discrete, ProgressLine("solve"))
    report = discrete_report(analysed)
    show(report.with_data(**named.as_data()), request, notes=named.warnings)
    return 0


def learn(request: LearnRequest, named: NamedGame) -> int:
    """Run `hfa learn` for a discrete-time plant, by Q-learning, and return the exit code."""
    from controller.critic.critic import from_parts
    from controller.learning.q_learning import learn_steps
    from hfa.commands.game import show_learned
    from verification.critic.discrete import check_discrete

    problem: DiscreteGame = named.discrete
    request.refuse(("law", "set"), _CONTINUOUS)
    run, H = learn_steps(problem, request.seed, progress=ProgressLine("learn"))
    critic = from_parts(problem.step, {"P": run.P, "K": run.K})
    verdict = check_discrete(problem, critic, more={"H": H})
    return show_learned(request, named, run, verdict, H)


def verify(request: VerifyRequest, named: NamedGame, paths: list[Path]) -> int:
    """Run `hfa verify` for a discrete-time plant on one critic and return the exit code.

    paths: one path, of a file with W, P, K, L or H or of a network

    Raises BadInputError unless exactly one path is given.
    """
    from controller.discrete.critic_file import critic_of_steps
    from hfa.commands.verify import about
    from verification.critic.discrete import check_discrete
    from verification.scope import Scope

    if len(paths) != 1:
        raise BadInputError(
            "a discrete-time plant requires exactly one critic; give --weights FILE once"
        )
    request.refuse(("discount", "dt", "region", "flights", "draws", "picture"), _CONTINUOUS)
    (path,) = paths
    problem: DiscreteGame = named.discrete
    critic, more = critic_of_steps(path, problem, request.reading())
    scope = Scope(progress=ProgressLine("prove"))
    with prefix_errors(path):
        verdict = check_discrete(problem, critic, limit=request.limit_error, more=more, scope=scope)
    cost = request.limit_cost
    lines = about(named, verdict, cost)
    report = verdict.report(limit_cost=cost, about=lines, source=str(path))
    report = report.with_data(**named.as_data(), **named.weights.as_data())
    show(report, request, notes=named.warnings)
    return 0 if verdict.holds(cost) else 1


def verify_discounted(
    path: Path, critic: Critic, request: VerifyRequest, game: Game, scope: Scope
) -> Verdict:
    """Return the verdict on a critic for a continuous-time game that is sampled and discounted.

    path: file of the critic, for messages

    Raises BadInputError if the file contains a history of critics.
    """
    from verification.critic.discrete import check_discounted

    assert request.discount is not None
    if critic.time is not None:
        raise BadInputError(
            f"{path}: the file contains a history, but --discount requires one critic; give a "
            "file with a single critic"
        )
    scope = replace(scope, progress=ProgressLine("prove"))
    return check_discounted(
        game, critic, request.discount, request.dt, limit=request.limit_error, scope=scope
    )
