"""Environments of an aircraft for training policies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.judge.trims import trims_of
from hfa_flight.judge.weights import diagonal_weights, usual_weights
from hfa_flight.learn.episodes import SECONDS, Episodes
from hfa_flight.learn.start_boxes import sample_time
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError, missing_package, refuse_unless_whole, warn
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import shown_unit, shown_values
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    import gymnasium
    from stable_baselines3.common.vec_env import VecEnv


def environment(
    model: Model,
    deployment: Deployment | str | Path | None = None,
    points: Iterable[Any] | None = None,
    *,
    seconds: float = SECONDS,
    render_mode: str | None = None,
    turbulence: Turbulence | None = None,
    vary: Mapping[str, tuple[float, float]] | None = None,
    dt: float | None = None,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
) -> gymnasium.Env:
    """Return a gymnasium environment: an aircraft about its trims.

    model: the aircraft
    deployment: observations, actions, timing and cost, or the path of a deployment file. A policy
        is not required. Default: `Deployment.usual(model, dt)`
    points: operating points, one operating point, or values of the scheduling variable in the units
        of the model. One is drawn at each reset. Default: the model's default trim, of the flexible
        aircraft that at a dihedral angle of 15 deg
    seconds: duration after which an episode is truncated, s. An episode is terminated earlier if
        the aircraft leaves its limits
    render_mode: None or "rgb_array", the picture of the episode so far
    turbulence: turbulence of MIL-F-8785C, drawn for each episode. Unsupported components cause a
        warning
    vary: parameter -> (lowest, highest). At each reset, a value between both is drawn. The trim
        values remain those of the unchanged aircraft, as in `hfa.assess`
    dt: sample time of the default deployment, s. Default: at most 0.02, and so short that the
        fastest pole of the aircraft and of its LQR loop moves by less than 1 in a sample
    Q, R: diagonal weights of the default deployment's cost, as for `hfa.game`. Default: those of
        the plant file, for the paper's aircraft the paper's, else 1/nominal²

    Each episode begins at a drawn state of a box about its trim: the box of `hfa.assess`, reduced
    so that flights without action stay within the limits for a second (`start_box`).

    The reward is the negative cost of the states and of the inputs commanded at the sample, also if
    these act later because of a delay.

    Raises BadInputError if gymnasium is missing, a name is unknown, an action has no box, `seconds`
    or `render_mode` is invalid, or dt, Q or R is given together with a deployment. Raises TrimError
    if there is no trim.

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
    default = {"dt": dt, "Q": Q, "R": R}
    episodes = _episodes(model, deployment, points, 1, seconds, turbulence, vary, default)
    make = _made(
        "gymnasium", "gymnasium", "hfa_flight.learn.gymnasium_environment", "AircraftEnvironment"
    )
    made: gymnasium.Env = make(episodes, render_mode)
    return made


def vector_environment(
    model: Model,
    deployment: Deployment | str | Path | None = None,
    points: Iterable[Any] | None = None,
    *,
    count: int = 8,
    seconds: float = SECONDS,
    turbulence: Turbulence | None = None,
    vary: Mapping[str, tuple[float, float]] | None = None,
    dt: float | None = None,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
) -> VecEnv:
    """Return `count` compiled episodes at once, as a `VecEnv` of Stable-Baselines3.

    count: number of episodes

    The other arguments are those of `environment`.

    Raises BadInputError if Stable-Baselines3 is missing or `count` is not a positive integer, and
    the errors of `environment`.

    >>> import hfa
    >>> flights = hfa.vector_environment(model, deployment, count=16)  # doctest: +SKIP
    >>> PPO("MlpPolicy", flights).learn(100_000)  # doctest: +SKIP
    """
    default = {"dt": dt, "Q": Q, "R": R}
    episodes = _episodes(model, deployment, points, count, seconds, turbulence, vary, default)
    module = "hfa_flight.learn.vector_environment"
    make = _made("stable_baselines3", "stable-baselines3", module, "AircraftVectorEnvironment")
    made: VecEnv = make(episodes)
    return made


def training_trims(model: Model, points: Iterable[Any] | None) -> tuple[OperatingPoint, ...]:
    """Return the trims of an environment, by default that at which the model is trained."""
    if points is None and model.about.trained_at is not None:
        points = [model.about.trained_at]
    return trims_of(model, points)


def _deployment(
    model: Model,
    trims: Sequence[OperatingPoint],
    given: Deployment | str | Path | None,
    default: Mapping[str, Any],
) -> Deployment:
    """Return the given deployment, or the default one of a model with given dt, Q and R."""
    dt, Q, R = default.values()
    if given is not None:
        for name, value in default.items():
            if value is not None:
                entry = "timing.dt" if name == "dt" else f"cost.{name}"
                raise BadInputError(
                    f"{name} cannot be combined with a deployment; change {entry} of the "
                    "deployment instead"
                )
        return Deployment.of(given)
    usual = Deployment.usual(model, sample_time(model, trims) if dt is None else dt)
    if Q is None and R is None:
        return usual
    cost = {"Q": _weights("Q", model, Q), "R": _weights("R", model, R)}
    return usual.changed(cost=cost)


def _weights(matrix: str, model: Model, given: Any) -> dict[str, float]:
    """Return name -> weight in the cost, by default as `usual_weights`."""
    if isinstance(given, Mapping):
        return dict(given)
    if given is None:
        return usual_weights(matrix, model)
    return diagonal_weights(matrix, given, tuple(model.linear if matrix == "Q" else model.inputs))


def _episodes(
    model: Model,
    given: Deployment | str | Path | None,
    points: Iterable[Any] | None,
    count: int,
    seconds: float,
    turbulence: Turbulence | None,
    vary: Mapping[str, tuple[float, float]] | None,
    default: Mapping[str, Any],
) -> Episodes:
    trims = training_trims(model, points)
    deployment = _deployment(model, trims, given, default)
    refuse_unless_whole("count", count, 1)
    if all("box" in entry for entry in deployment.action.values()):
        deployment = deployment.changed(policy={})  # its file may be what is trained here
    if turbulence is not None:
        for sentence in turbulence.air(trims[0], deployment.dt, 1, 0).left_out(model):
            warn(sentence)
    return Episodes(Deployed(deployment, model), trims, count, seconds, turbulence, vary)


def _made(library: str, package: str, module: str, name: str) -> Callable[..., Any]:
    """Return a class of this package whose module requires an optional library."""
    try:
        import_module(library)
    except ImportError:
        raise missing_package(f"an {name} requires", package) from None
    found: Callable[..., Any] = getattr(import_module(module), name)
    return found


def episode_picture(
    episodes: Episodes, owner: int, flown: list[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Return the picture of an episode as an array of pixels (height, width, 3).

    owner: index of the episode's trim. Its values are drawn as horizontal lines
    flown: X and U at each sample of the episode
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    deployed = episodes.deployed
    model = deployed.model
    names = (*model.linear, *deployed.commanded)
    known = [*model.states, *model.inputs]
    values = np.array([np.concatenate(pair) for pair in flown])
    times = deployed.deployment.dt * np.arange(len(values))
    trim = episodes.points[owner].values
    lines = -(-len(names) // 2)
    figure = new_figure(8.0, 1.6 * lines)
    panels = figure.subplots(lines, 2, sharex=True, squeeze=False).ravel()
    for name, axes in zip(names, panels, strict=False):
        unit = model.unit(name)
        axes.plot(times, shown_values(values[:, known.index(name)], unit))
        axes.axhline(float(shown_values(trim[name], unit)), color="gray", linewidth=0.8)
        axes.set_ylabel(f"{name}, {shown_unit(unit)}", fontsize=8)
        axes.grid(alpha=0.3)
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()
