"""Conversion of user input to the policy of a flight.

The input may be a gain, a critic, a solution, a network, a deployment file, a gain schedule, input
steps or a Python function.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.critic_file import (
    critic_file,
    critic_in,
    entries_in,
    gain_in,
    is_network,
    sample_time,
)
from controller.critic.network.declared import NOTHING
from controller.critic.network.network_file import refuse_normalizer
from controller.critic.reading import Reading
from controller.game.linear_game import names_of_linear
from controller.game.zero_sum import Game
from hfa_aircraft.model import Model
from hfa_aircraft.servos import positions_of_servos
from hfa_aircraft.signals import PlantNames
from hfa_flight.air.scenario import Scenario
from hfa_flight.air.signals import CommandSteps
from hfa_flight.policies.deployment.actor import gain_function
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.policy import flown_deployment
from hfa_flight.policies.laws import DEPLOYMENT, GAIN, NETWORK, TABLE
from hfa_flight.policies.policy import (
    GainPolicy,
    Policy,
    SampledPolicy,
    function_policy,
    open_loop,
)
from hfa_flight.policies.scheduled_gains import gain_at, refuse_unscheduled, scheduled_gains
from hfa_flight.schedule.gain_schedule import GainSchedule, load_gain_schedule
from hfa_support.errors import BadInputError, numbers_in, prefix_errors, refuse_unknown, shown
from hfa_support.matrices import shape_text
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint


def kind_of_file(path: Path) -> str:
    """Return the kind of the policy in a file."""
    if path.suffix.lower() == ".toml":
        return DEPLOYMENT
    if is_network(path):
        return NETWORK
    # A gain table has a matrix for each breakpoint, (G, m, n). Other arrays are a gain or a critic.
    return TABLE if np.ndim(entries_in(path).get("K", 0.0)) == 3 else GAIN


def sampled_policy(
    path: Path, model: Model, dt: float, points: Sequence[OperatingPoint]
) -> Deployment:
    """Return the deployment of a file with a policy u(x) of all inputs: a gain K, a table of gains,
    or a network.

    x are the deviations of all linear states from the trim, sampled every dt seconds, in the units
    of the model. The gain of a table is that of the scheduling variable of the sample. A cost with
    diagonal Q and R in the file is that of the deployment.

    points: trims, of which a table must contain all

    Raises BadInputError if K has another shape, other units that cannot be converted, or another
    sample time, if a network was trained behind a normalizer, or if the file contains neither.
    """
    kind = kind_of_file(path)
    entries = entries_in(path) if kind == GAIN else {}
    names = _names_of(model, entries)
    observation: dict[str, dict[str, Any]] = {name: {} for name in names.states}
    policy: Any = path.name
    if kind == TABLE:
        observation["scheduling variable"] = {"formula": model.schedule, "about": 0.0}
        refuse_unscheduled(model)
        schedule = load_gain_schedule(path, model)
        at = [point.values[model.schedule] for point in points]
        with prefix_errors(path):
            schedule.refuse_beyond(min(at), max(at))
        o = ca.SX.sym("o", len(observation))  # x, and the scheduling variable
        policy = ca.Function("table", [o], [-gain_at(schedule, o[-1]) @ o[:-1]])
    elif kind != NETWORK:
        policy = _sampled_gain(path, entries, names, dt)
    deployment = Deployment(
        policy={"file": policy},
        observation=observation,
        action={name: {} for name in names.inputs},
        timing={"dt": dt},
        cost=_cost_of_file(path, names),
        folder=path.parent,
        origin=str(path),
    )
    if kind == NETWORK:
        with prefix_errors(path):
            refuse_normalizer(deployment.actor.declared)
    return deployment


def _names_of(model: Model, entries: Mapping[str, Any]) -> PlantNames:
    """Return the names of a policy in a file, whose gain K may not see the positions of servos, the
    last states.
    """
    inputs, count = tuple(model.inputs), len(model.linear) - len(positions_of_servos(model))
    is_reduced = np.shape(entries.get("K", 0.0))[-1:] == (count,)
    states = model.linear[:count] if is_reduced else model.linear
    return PlantNames(states, inputs, model.units(states), model.units(inputs))


def _cost_of_file(path: Path, names: PlantNames) -> dict[str, Any] | None:
    """Return the cost of the game in a file in continuous time, if Q and R are diagonal."""
    game = critic_file(path).game(names)
    if "dt" in game or np.any(game.get("N", 0.0)) or not {"Q", "R"} <= game.keys():
        return None
    try:
        return {
            matrix: diagonal_weights(matrix, game[matrix], signals)
            for matrix, signals in (("Q", names.states), ("R", names.inputs))
        }
    except BadInputError:
        return None


def diagonal_weights(matrix: str, given: Any, names: Sequence[str]) -> dict[str, float]:
    """Return name -> weight of a diagonal matrix (k, k), or of its diagonal (k,).

    Raises BadInputError if the matrix is not diagonal.
    """
    weights = numbers_in(matrix, given)
    diagonal = np.diagonal(weights) if weights.ndim == 2 else weights
    # A matrix that is not diagonal has more nonzero entries than its diagonal.
    if diagonal.shape != (len(names),) or np.count_nonzero(weights) > np.count_nonzero(diagonal):
        raise BadInputError(
            f"{matrix} is not a diagonal matrix of {len(names)} weights; give one weight for each "
            f"of {', '.join(names)}"
        )
    return dict(zip(names, diagonal.tolist(), strict=True))


def _sampled_gain(
    path: Path, entries: Mapping[str, Any], names: PlantNames, dt: float
) -> ca.Function:
    """Return the policy -K x of the gain in the entries of a critic's file."""
    shape = len(names.inputs), len(names.states)
    wanted = (
        f"give a K of {shape_text(shape)} (inputs {', '.join(names.inputs)} by states "
        f"{', '.join(names.states)}), or a deployment file"
    )
    with prefix_errors(path):
        if "K" not in entries or "policy_weights" in entries:
            raise BadInputError(f"the file contains no linear policy u = -K x; {wanted}")
        K = gain_in(entries, names)
        if K.shape != shape:
            raise BadInputError(f"K is {shape_text(K.shape)}; {wanted}")
        designed = sample_time(entries)  # None: continuous time; True: an unknown sample time
        if designed not in (None, True) and not math.isclose(designed, dt, rel_tol=1e-6):
            raise BadInputError(
                f"K is a gain for dt = {designed:g} s; give --sample-time {designed:g}, or remove "
                "dt from the file"
            )
    return gain_function(K)


def policy_of_file(
    path: Path,
    point: OperatingPoint,
    game: Game | None = None,
    reading: Reading | None = None,
    condition: Callable[[float], TrimCondition] | None = None,
    commands: CommandSteps | None = None,
) -> Policy:
    """Return the policy in a file, about a trim.

    A policy that is not linear, such as a network, is saturated at the control limits of the model.

    game: the game whose cost gives the policy of a value; None if the file contains a policy
    reading: how a critic or network is read, None for the defaults
    condition: function from the scheduling variable to the trim condition of a gain table, None for
        the usual one
    commands: steps of the scheduling variable that a gain table follows

    Raises BadInputError if the file contains no policy of this aircraft.
    """
    kind = kind_of_file(path)
    if kind == DEPLOYMENT:
        return flown_deployment(path, point)
    if kind == TABLE:
        schedule = load_gain_schedule(path, point.model)
        at = condition or usual_condition(point.model).at
        return scheduled_gains(f"gains of {path}", schedule, point, at, commands)
    entries: Mapping[str, Any] = {} if kind == NETWORK else entries_in(path)
    dt = sample_time(entries)
    is_sampled = isinstance(dt, float) and "policy_weights" not in entries
    if "K" in entries and (is_sampled or positions_of_servos(point.model)):
        with prefix_errors(path):
            K = gain_in(entries, _names_of(point.model, entries))
        return GainPolicy(f"gain of {path}", K, dt=dt or None)
    critic = critic_in(path, game or _without_cost(point.linearize()), reading)
    if game is None and critic.slope_gain is not None:  # u = -½ R⁻¹B' ∂V/∂z
        raise BadInputError(
            f"{path}: the policy of this value depends on the cost; give hfa.read_critic(FILE, "
            "game) in place of the file"
        )
    if not critic.has_linear_policy:
        # Without a game, notes of a critic's file compare it with the arbitrary cost.
        declared = critic.declared if game or kind == NETWORK else NOTHING
        return function_policy(f"critic of {path}", critic.policy, point, declared)
    content = "gain" if critic.slope_gain is None else "weights"
    return GainPolicy(f"{content} of {path}", critic.K)


def _without_cost(linear: LinearModel) -> Game:
    """Return the game on a linear model with an arbitrary cost, for policies that have none."""
    n, m = np.shape(linear.B)
    return Game(linear.A, linear.B, Q=np.ones(n), R=np.ones(m), names=names_of_linear(linear))


_FORMS = (
    "give a gain K, a critic, a solution, hfa.expand(...), hfa.track(...), a Deployment, a "
    "gain schedule, a file that contains one of these, input steps {name: [(time, value), "
    "...]} or a function of (t, X)"
)


def policy_and_scenario(
    given: Any, point: OperatingPoint, scenario: Scenario
) -> tuple[Policy, Scenario]:
    """Return the policy of a flight and the scenario.

    If `given` is a deployment, the scenario is changed to the sampling of the deployment, and if it
    is the result of `hfa.track`, to its reference. Otherwise, the scenario is unchanged.

    given: policy in any form that `hfa.fly` accepts
    point: the trim

    Raises BadInputError if `given` has no accepted form.
    """
    if isinstance(given, (str, Path)):
        given = policy_of_file(Path(given), point)
    if isinstance(given, Policy):
        return given.in_scenario(scenario)
    if given is None or isinstance(given, Mapping):
        return open_loop(command_steps(given or {}), tuple(point.model.inputs)), scenario
    return _policy_of_object(given, point, scenario)


def _policy_of_object(
    given: Any, point: OperatingPoint, scenario: Scenario
) -> tuple[Policy, Scenario]:
    """Return `policy_and_scenario` of an object other than a policy, a file or input steps."""
    from controller.expansion.expansion import Expansion
    from controller.riccati.gare import Solution
    from controller.tracking import Tracking

    if isinstance(given, Critic) and not given.has_linear_policy:
        return function_policy(given.origin, given.policy, point, given.declared), scenario
    if isinstance(given, Tracking):
        policy = GainPolicy("tracking", given.K, given.inputs)
        return policy, scenario.following(given.exact.reference, policy.name)
    if isinstance(given, GainSchedule):
        condition = usual_condition(point.model).at
        return scheduled_gains("scheduled gains", given, point, condition).in_scenario(scenario)
    if isinstance(given, Solution):
        given.game.refuse_steps("hfa.fly")
    if hasattr(given, "K"):  # a solution, or a critic with a linear policy
        return GainPolicy(getattr(given, "origin", "exact"), given.K), scenario
    if isinstance(given, Expansion):
        given = given.policy
    if isinstance(given, ca.Function) and given.n_in() == 1:
        return function_policy(given.name(), given, point), scenario
    # A system of python-control, which has ninputs, is callable too.
    if callable(given) and not hasattr(given, "ninputs"):
        return _python_policy(given, point, scenario.interval).in_scenario(scenario)
    if isinstance(given, Deployment):
        return flown_deployment(given, point).in_scenario(scenario)
    try:
        return GainPolicy("gain", numbers_in("policy", given)), scenario
    except BadInputError as error:
        raise BadInputError(f"policy is {shown(given)}; {_FORMS}") from error


def command_steps(given: Mapping[str, Any]) -> CommandSteps:
    """Return commands of several inputs as one table of steps.

    The times are the union of the times of all inputs. Each input is 0 before its first step and
    constant between steps.

    given: name of an input -> pairs (time in s, value)

    Raises BadInputError unless the steps of each input are pairs with increasing times of at least
    0.
    """
    steps = {name: numbers_in(f"the steps of {name}", pairs) for name, pairs in given.items()}
    for name, pairs in steps.items():
        if pairs.ndim != 2 or pairs.shape[1] != 2:
            raise BadInputError(
                f"the steps of {name} are {shown(given[name])}; give pairs [(time, value), ...], "
                "time in s"
            )
        times = pairs[:, 0].tolist()
        if times[0] < 0.0 or any(later <= earlier for earlier, later in pairwise(times)):
            raise BadInputError(
                f"the times of {name} are {times}; give increasing times of at least 0 s"
            )
    all_times = sorted({time for pairs in steps.values() for time in pairs[:, 0].tolist()})
    values = np.zeros((len(all_times), len(steps)))
    for column, pairs in enumerate(steps.values()):
        for time, value in pairs.tolist():
            values[all_times.index(time) :, column] = value
    return CommandSteps(tuple(steps), np.array(all_times), values)


@dataclass(frozen=True, eq=False, repr=False)
class PythonPolicy(SampledPolicy):
    """Policy U = function(t, X) in absolute values, called at the beginning of each sample.

    function: (t in s, X by name) -> U, (m,), or U by name. Inputs without a value remain at trim
    """

    predicts = True

    function: Callable[[float, Any], Any]

    def __call__(self, t: float, X: Any) -> np.ndarray:
        """Return U, (m,). Raises BadInputError unless the function returns finite inputs."""
        returned = self.function(t, type(self.point.states)(*X.tolist()))
        inputs = self.point.inputs._asdict()
        if isinstance(returned, Mapping):
            for name in returned:
                refuse_unknown(f"the policy {self.name} returns the unknown input", name, inputs)
            returned = [*{**inputs, **returned}.values()]  # the others at trim, in order
        U = numbers_in(f"the result of the policy {self.name}", returned)
        if U.shape != (len(inputs),) or not np.isfinite(U).all():
            raise BadInputError(
                f"the policy {self.name} returns {shown(returned)}; give {len(inputs)} finite "
                f"numbers, or a mapping by name ({', '.join(inputs)})"
            )
        return U


def _python_policy(function: Callable[..., Any], point: OperatingPoint, dt: float) -> PythonPolicy:
    """Return the policy of a function of (t, X), named after the function."""
    name = getattr(function, "__name__", type(function).__name__)  # of an object, its class
    try:
        inspect.signature(function).bind(0.0, point.states)
    except (TypeError, ValueError):
        raise BadInputError(f"the policy {name} does not accept (t, X); {_FORMS}") from None
    return PythonPolicy(name, point, dt, function)
