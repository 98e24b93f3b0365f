"""Environments of an aircraft for training policies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa_aircraft.model import Model
from hfa_flight.air.sensors import sensors_of
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.judge.assessment import trims_of
from hfa_flight.judge.flight_costs import usual_weights
from hfa_flight.learn.episode import SECONDS, Episode, usual_sample_time
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.given import diagonal_weights
from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError, imported, warn

if TYPE_CHECKING:
    import gymnasium


def environment(
    model: Model,
    deployment: Deployment | str | Path | None = None,
    points: Iterable[Any] | None = None,
    *,
    seconds: float = SECONDS,
    turbulence: Turbulence | None = None,
    vary: Mapping[str, tuple[float, float]] | None = None,
    sensors: Mapping[str, Any] | None = None,
    dt: float | None = None,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
) -> gymnasium.Env:
    """Return a gymnasium environment: an aircraft about its trims.

    model: the aircraft
    deployment: observations, actions, timing and cost, or the path of a deployment file. A policy
        is not required. Default: `Deployment.usual(model, dt, sensors)`
    points: operating points, one operating point, or values of the scheduling variable in the units
        of the model. One is drawn at each reset. Default: the model's default trim, of the flexible
        aircraft that at a dihedral angle of 15 deg
    seconds: duration after which an episode is truncated, s. An episode is terminated earlier if
        the aircraft leaves its limits
    turbulence: turbulence of MIL-F-8785C, drawn for each episode. Unsupported components cause a
        warning
    vary: parameter -> (lowest, highest). At each reset, a value between both is drawn. The trim
        values remain those of the unchanged aircraft
    sensors: what is measured, a state or an output -> `hfa.Sensor`, or the standard deviation of
        its noise. Observations have these errors, drawn for each episode; of other states they
        have none
    dt: sample time of the default deployment, s. Default: at most 0.02, and so short that the
        fastest pole of the aircraft and of its LQR loop moves by less than 1 in a sample
    Q, R: diagonal weights of the default deployment's cost, as for `hfa.game`. Default: those of
        the plant file, for the paper's aircraft the paper's, else 1/nominal²

    Each episode begins at a drawn state of a box about its trim: the box of `hfa.assess`, reduced
    so that flights without action stay within the limits for a second (`start_box`).

    The reward is the negative cost of the states and of the inputs commanded at the sample, also if
    these act later because of a delay. An episode that leaves the limits is charged, for each
    remaining sample, this cost and that of all states at their farther limits.

    Several episodes at once are `DummyVecEnv` of Stable-Baselines3 or `SyncVectorEnv` of Gymnasium.

    Raises BadInputError if gymnasium is missing, a name is unknown, an action has no box, `seconds`
    is invalid, or dt, Q or R is given together with a deployment. Raises TrimError if there is no
    trim.

    >>> import hfa
    >>> deployment = hfa.Deployment(
    ...     policy={},
    ...     observation={"speed": {"scale": 10.0}, "pitch": {}},
    ...     action={"elevator_center": {"box": [-1, 1], "map": "trim + 0.1 * a"}},
    ...     timing={"dt": 0.02},
    ... )
    >>> flights = hfa.environment(hfa.aircraft(), deployment)
    >>> observation, info = flights.reset(seed=1)
    >>> observation.shape, flights.action_space.shape
    ((2,), (1,))
    """
    imported("gymnasium", "an environment requires")
    from hfa_flight.learn.gymnasium_environment import AircraftEnvironment

    if points is None and model.about.trained_at is not None:
        points = [model.about.trained_at]
    trims = trims_of(model, points)
    measured = sensors_of(sensors or {}, model)
    if deployment is None:
        sample_time = usual_sample_time(model, trims) if dt is None else dt
        trained = Deployment.usual(model, sample_time, tuple(measured))
        if Q is not None or R is not None:
            weights = {name: _weights(name, model, given) for name, given in (("Q", Q), ("R", R))}
            trained = trained.changed(cost=weights)
    else:
        for entry, value in {"timing.dt": dt, "cost.Q": Q, "cost.R": R}.items():
            if value is not None:
                raise BadInputError(
                    f"{entry.partition('.')[2]} cannot be combined with a deployment; change "
                    f"{entry} of the deployment instead"
                )
        trained = Deployment.of(deployment)
    # The policy's file is read only for missing boxes: it need not exist before the training.
    if all("box" in entry for entry in trained.action.values()):
        trained = trained.changed(policy={})
    if turbulence is not None:
        for sentence in turbulence.air(trims[0], trained.dt, count=1, seed=0).left_out(model):
            warn(sentence)
    episode = Episode(Deployed(trained, model), trims, seconds, turbulence, vary, measured)
    return AircraftEnvironment(episode)


def _weights(matrix: str, model: Model, given: Any) -> dict[str, float]:
    """Return name -> weight in the cost, by default as `usual_weights`."""
    if isinstance(given, Mapping):
        return dict(given)
    if given is None:
        return usual_weights(matrix, model)
    return diagonal_weights(matrix, given, tuple(model.linear if matrix == "Q" else model.inputs))
