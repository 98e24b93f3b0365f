"""`hfa prove region` on boxes, for a network, a deployment file or a polynomial policy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from controller.critic.critic import symbols_for
from hfa.inherited import OutputOptions, print_report
from hfa.options.output import ProgressLine
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_prove.certificate import write_certificate
from hfa_prove.check import check_certificate
from hfa_prove.report_boxes import NOT_COVERED, found_report
from hfa_prove.search.region_boxes import BoxRegion, RegionSearch, flight_outcome
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.plant import model_limits
from hfa_prove.statements.region import RegionStatement
from hfa_support.errors import BadInputError, prefix_errors
from hfa_support.files import forget_read
from hfa_support.interruption import interruptible
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from controller.game.zero_sum import Game
    from hfa_prove.commands.request import CheckRequest, RegionRequest
    from hfa_prove.statements.loop import Gain, Loop


@dataclass(frozen=True, eq=False)
class ProvedPolicy:
    """A policy for which a region is to be proved.

    function: the policy, as in `Loop.policy`
    words: description of the policy
    known: pairs of a description and a matrix P, each of which gives a candidate V = z'P z
    not_covered: effects that the proof neglects, for the title
    gain: coefficients of the policy if it is a polynomial, otherwise None
    """

    function: ca.Function
    words: str
    known: Sequence[tuple[str, np.ndarray]] = ()
    not_covered: str = NOT_COVERED
    gain: Gain | None = None

    @classmethod
    def of_gain(
        cls, gain: Gain, inputs: tuple[str, ...], words: str, P: np.ndarray | None
    ) -> ProvedPolicy:
        """Return the policy with the given coefficients.

        inputs: names of the inputs, in order
        words: description of the policy
        P: matrix of the value function of the game or critic, (n, n), as a candidate for V, or None
        """
        known = [] if P is None else [("P of the game", P)]
        return cls(gain.function(inputs), words, known, gain=gain)


def loop_of(linear: LinearModel, policy: ProvedPolicy) -> Loop:
    """Return the closed loop of a policy about the trim of a linear model.

    The limits of the loop are those of the model at the trim (`model_limits`).
    """
    model = linear.point.model
    states = {name: float(value) for name, value in linear.point.states._asdict().items()}
    parameters = {name: signal.start for name, signal in model.parameters.items()}
    return Loop(
        model,
        parameters,
        {name: states[name] for name in model.linear},
        {name: float(value) for name, value in linear.point.inputs._asdict().items()},
        {name: value for name, value in states.items() if name not in model.linear},
        model_limits(model, states, parameters),
        policy.gain or scalars(policy.function),
    )


def scalars(policy: ca.Function) -> ca.Function:
    """Return an equal policy that is a CasADi function of scalar operations.

    Raises BadInputError if the policy is computed iteratively.
    """
    if not policy.is_a("MXFunction"):
        return policy
    try:
        return policy.expand()
    except RuntimeError as error:
        raise BadInputError(
            "the policy is computed iteratively from a network, which is not supported; give a "
            "network whose output is the policy"
        ) from error


@dataclass(frozen=True)
class SearchSettings:
    """Settings of a search for a region.

    seconds: limit of the processor time, s
    degree: highest degree of V
    resume: whether to continue an earlier run from the certificate in the output file
    reason: reason why the proof uses boxes instead of sums of squares, for the report, or "" if the
        user chose boxes
    """

    seconds: float
    degree: int
    resume: bool = False
    reason: str = ""


def prove(
    request: OutputOptions, linear: LinearModel, policy: ProvedPolicy, settings: SearchSettings
) -> int:
    """Prove a region of attraction as large as possible, print a report and return exit code 0.

    The certificate of each larger region is written to the output file of the request, if there is
    one.

    linear: linear model at the trim of the loop

    Raises NoSolutionError if no region is proved.
    """
    loop = loop_of(linear, policy)

    def save(region: BoxRegion) -> None:
        if request.output is not None:
            origin = request.provenance.to_dict()
            write_certificate(request.output, region.statement, region.witness.content(), origin)

    earlier = None
    if settings.resume:
        assert request.output is not None
        earlier = _earlier(request.output, loop)
    with interruptible(ProgressLine("region")) as progress:
        search = RegionSearch(
            loop,
            policy.known,
            seconds=settings.seconds,
            degree=settings.degree,
            progress=progress,
            save=save,
        )
        region = search.found(earlier)
    place = region.bound.place
    flight = None
    if place is not None and region.bound.rises:
        flight = flight_outcome(search.samples, place, region)
    print_report(
        found_report(region, policy.words, flight, policy.not_covered, settings.reason), request
    )
    return 0


def _earlier(path: Path, loop: Loop) -> RegionStatement:
    """Return the proved statement of the certificate that an earlier run wrote.

    path: file of the certificate

    Raises BadInputError if the statement concerns another loop or policy.
    """
    progress = ProgressLine("check")
    statement = check_certificate(path, progress, loop.model, loop.function).statement
    forget_read(path)
    if statement.piece.whole or not same_loop(statement.loop, loop):
        raise BadInputError(f"{path} is the certificate of another loop; give another path with -o")
    return statement


def same_loop(first: Loop, second: Loop) -> bool:
    """Return whether two loops have the same parameters, trim, inputs and policy."""
    one, other = first.content(), second.content()
    return all(one[name] == other[name] for name in ("parameters", "trim", "inputs", "policy"))


#: Options of sums of squares alone.
_OF_SQUARES = ("disturbance", "picture")
#: Options of a network or critic.
_OF_NETWORKS = ("weights", "basis", "network", "set")
#: Numbers of states for which boxes prove larger sets than sums of squares, as measured on the
#: GTM.
_STATES = (3, 4)
#: Default degree of V for a network.
_DEGREE = 2


def better_on_boxes(request: RegionRequest, loop: Loop) -> str:
    """Return the reason to prove the region of a policy on boxes instead of by sums of squares.

    Return "" if sums of squares are to be used.
    """
    from hfa_prove.check.equilibrium import open_rates

    if request.disturbance or request.picture is not None:
        return ""
    if open_rates(loop).has_kinks:
        return "the equations have kinks or tables"
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
    linear, policy, game = policy_of(request)
    known = [("P of the game", unconfirmed_solution(game).P), *policy.known]
    tried = ProvedPolicy(policy.function, policy.words, known, policy.not_covered)
    degree = request.degree if "degree" in request.typed else _DEGREE
    return prove(request, linear, tried, SearchSettings(request.seconds, degree, request.resume))


def policy_of(request: CheckRequest | RegionRequest) -> tuple[LinearModel, ProvedPolicy, Game]:
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
