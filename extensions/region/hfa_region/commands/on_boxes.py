"""`hfa prove region` on boxes, for a network, a deployment file or a polynomial policy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from controller.critic.critic import symbols_for
from hfa_boxes.check.statement import Gain
from hfa_boxes.commands.region import ProvedPolicy, SearchSettings, check, prove
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_proof.commands.given import at_one_value
from hfa_support.errors import BadInputError, NoSolutionError, prefix_errors
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from controller.game.zero_sum import Game
    from hfa_proof.commands.check import CheckRequest
    from hfa_region.check.statement import SaturatedLoop
    from hfa_region.commands.region import RegionRequest

#: Options of sums of squares alone.
_OF_SQUARES = ("disturbance", "picture")
#: Options of a network or critic.
_OF_NETWORKS = ("weights", "basis", "network", "set")
#: Numbers of states for which boxes prove larger sets than sums of squares, as measured on the
#: GTM.
_STATES = (3, 4)
#: Default degree of V for a network.
_DEGREE = 2


def better_on_boxes(request: RegionRequest, loop: SaturatedLoop) -> str:
    """Return the reason to prove the region of a policy on boxes instead of by sums of squares.

    Return "" if sums of squares are to be used.
    """
    from hfa_region.check.loop import Equilibrium

    if request.disturbance or request.picture is not None:
        return ""
    try:
        Equilibrium(loop)
    except BadInputError:
        return "the equations have kinks, tables or functions without a series"
    except (NoSolutionError, ZeroDivisionError):
        return ""
    is_limited = any(name in loop.limits for name in loop.states)
    if len(loop.states) in _STATES and not is_limited:
        return "of three or four states without limits boxes prove larger sets"
    return ""


def prove_gain_on_boxes(
    request: RegionRequest, linear: LinearModel, gain: Gain, P: np.ndarray | None, reason: str
) -> int:
    """Prove the region of a polynomial policy on boxes and return exit code 0.

    linear: linear model at the trim
    gain: coefficients of the policy
    P: matrix of the value of the game or critic, (n, n), or None
    reason: reason to use boxes, as returned by `better_on_boxes`

    Raises BadInputError if an option applies only to sums of squares. Raises NoSolutionError if no
    region is proved.
    """
    request.refuse(_OF_SQUARES, "applies only to --prover squares; remove this option")
    words = "gain of the game" if request.weights is None else str(request.weights)
    policy = ProvedPolicy.of_gain(gain, linear.inputs, words, P)
    settings = SearchSettings(request.seconds, request.degree, request.resume, reason)
    return prove(request, linear, policy, settings)


def prove_on_boxes(request: RegionRequest) -> int:
    """Prove the region of a network or a deployment file on boxes and return exit code 0.

    Raises BadInputError if an option applies only to sums of squares. Raises NoSolutionError if the
    game has no solution or no region is proved.
    """
    from controller.riccati.gare import unconfirmed_solution

    request.refuse(_OF_SQUARES, "cannot be combined with a network or --policy; remove this option")
    if request.prover == "squares":
        raise BadInputError(
            "--prover squares supports only gains and polynomials; use --prover boxes"
        )
    linear, policy, game = _policy_of(request)
    known = [("P of the game", unconfirmed_solution(game).P), *policy.known]
    tried = ProvedPolicy(policy.function, policy.words, known, policy.not_covered)
    degree = request.degree if "degree" in request.typed else _DEGREE
    return prove(request, linear, tried, SearchSettings(request.seconds, degree, request.resume))


def checked_on_boxes(request: CheckRequest | RegionRequest, certificate: Path) -> int:
    """Verify a certificate on boxes for a network or a deployment file and return exit code 0.

    certificate: path of the certificate

    Raises NoSolutionError if the statement is not proved or differs from the user's data.
    """
    linear, policy, _ = _policy_of(at_one_value(request))
    return check(request, certificate, linear, policy, request.model if request.own else None)


def checked_gain_on_boxes(request: CheckRequest | RegionRequest, certificate: Path) -> int:
    """Verify a certificate on boxes for a polynomial policy and return exit code 0.

    certificate: path of the certificate

    Raises NoSolutionError if the statement is not proved or differs from the user's data.
    """
    from hfa.options.output import ProgressLine, show
    from hfa_boxes.check.checker import check_certificate
    from hfa_boxes.fields import FIELDS
    from hfa_boxes.report import checked_report
    from hfa_proof.subject import compare
    from hfa_region.commands.given import given_on_boxes

    own = request.model if request.own else None
    verified = check_certificate(certificate, None, ProgressLine("check"), own)
    given = given_on_boxes(verified.statement, request)
    not_given = compare(verified.statement.content(), FIELDS, given)
    show(checked_report(verified, "the gain K", not_given=not_given), request)
    return 0


def _policy_of(request: CheckRequest | RegionRequest) -> tuple[LinearModel, ProvedPolicy, Game]:
    """Return the linear model at the trim, the policy in the given file, and the game.

    The file is a critic or a deployment file.

    Raises BadInputError if an option does not apply to a deployment file.
    """
    from controller.critic.critic_file import critic_in

    if request.policy is not None:
        request.refuse(_OF_NETWORKS, "cannot be combined with --policy; remove one of the two")
    named = request.game()
    assert named.linear is not None
    if request.policy is not None:
        return named.linear, deployment_policy(request.policy, named.linear), named.game
    assert request.weights is not None
    with prefix_errors(request.weights):
        critic = critic_in(request.weights, named.game, request.reading())
    known = [] if critic.P is None else [("P of the critic", critic.P)]
    return named.linear, ProvedPolicy(critic.policy, critic.origin, known), named.game


def deployment_policy(path: Path, linear: LinearModel) -> ProvedPolicy:
    """Return the policy of a deployment file, applied in continuous time.

    path: deployment file
    linear: linear model at the trim
    """
    deployment = Deployment.load(path)
    timing = f"sampling ({deployment.dt:g} s), delay ({deployment.delay:g} s)"
    return ProvedPolicy(
        continuous(Deployed(deployment, linear.point.model)),
        f"{path}, applied continuously",
        not_covered=f"{timing}, actuators, disturbances",
    )


def continuous(deployed: Deployed) -> ca.Function:
    """Return a deployed policy as a function (z, trim) -> deviations of all inputs from the trim.

    z are the deviations of the moving states. trim contains the values of all states, inputs and
    parameters. The inputs are not saturated.

    Raises BadInputError if the policy uses several samples, or if an observation or an action
    depends on an input.
    """
    model = deployed.model
    n, m = len(model.states), len(model.inputs)
    _refuse_inputs_taken(deployed)
    kind = type(symbols_for([deployed.stages], 1))
    z = kind.sym("z", len(model.linear))
    trim = kind.sym("trim", n + m + len(model.parameters))
    names = tuple(model.states)
    moving = ca.DM(n, len(model.linear))
    for column, name in enumerate(model.linear):
        moving[names.index(name), column] = 1.0
    X = trim[:n] + ca.sparsify(moving) @ z
    U = trim[n : n + m]
    a = deployed.stages(deployed.observe(X, U, trim))[2]
    commanded = deployed.unlimited_inputs(a, X, U, trim)
    return ca.Function("continuous", [z, trim], [ca.densify(commanded - U)])


def _refuse_inputs_taken(deployed: Deployed) -> None:
    """Raise BadInputError if a deployed policy uses several samples or depends on an input.

    The policy itself sets the inputs. Therefore no observation or action may depend on an input.
    """
    if deployed.past:
        raise BadInputError(
            "timing.history: a proof does not support a policy of several samples; give a policy "
            "of the present sample only"
        )
    entries = {
        "observation": (deployed.observe, 1, tuple(deployed.deployment.observation)),
        "action": (deployed.unlimited_inputs, 2, tuple(deployed.model.inputs)),
    }
    for table, (function, argument, names) in entries.items():
        taken = function.jac_sparsity(0, argument).get_triplet()[0]
        for row in sorted(taken):
            raise BadInputError(
                f"{deployed.deployment.origin}: {table}.{names[row]} depends on an input that "
                "the policy sets, which a proof does not support; use `hfa assess` instead"
            )
