"""Command-line options of a flight: policy and scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa.options.argument_types import (
    among,
    each_of,
    input_file,
    number,
    positive,
    seconds,
    whole,
)
from hfa.options.games import (
    ReadingOptions,
    TimingOptions,
    WeightOptions,
    critic_path,
    given_weights,
    reading_of,
    weighted_game,
)
from hfa.options.parser import is_given, option, options_of, refuse
from hfa.options.trims import TrimOptions
from hfa_aircraft.model import Model
from hfa_aircraft.waveform import constant
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.gusts import Gust, OneMinusCosine, gust_speed
from hfa_flight.air.scenario import Scenario, Uncertainty
from hfa_flight.air.sensors import Sensor, measurable
from hfa_flight.air.turbulence import FORM, FORM_OF_OWN, LEVELS, Turbulence, typed_turbulence
from hfa_flight.policies.laws import DEPLOYMENT, GAIN, LAWS, NETWORK, PREDICTIVE, TABLE
from hfa_support.errors import BadInputError, choice_of, shortened, warn
from hfa_support.files import Number, checked, read_toml
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from controller.game.zero_sum import Game
    from hfa_flight.air.signals import CommandSteps
    from hfa_flight.policies.filtered_policy import FilteredPolicy
    from hfa_flight.policies.policy import Policy
    from trim.point.condition import TrimCondition

#: Word of --policy without a policy, with which commands are steps of inputs; word of the game's
#: exact policy.
NONE = "none"
EXACT = "exact"
#: Default duration of a flight, s.
_DURATION = 20.0
#: Duration of a sample of a flight, and longest interval of its rows, s; most ticks in a sample.
_SAMPLE = 0.01
_LONGEST_STEP = 0.001
_MOST_TICKS = 1000
#: Form of the value of --gust, in its help and in messages.
_GUST = "LENGTH:PEAK[:BEGIN]"
#: Options, as fields of the request: of the game, of a policy that plans, of a critic or network.
_OF_THE_GAME = ("delta", "Q", "R", "sizes")
_OF_PLANS = ("horizon", "margin")
_OF_FILES = ("basis", "network", "set")
#: Kind of policy -> options that it does not use.
_UNUSED: Mapping[str, tuple[str, ...]] = {
    NONE: (*_OF_THE_GAME, *_OF_FILES),
    EXACT: ("command", *_OF_FILES),
    **dict.fromkeys(LAWS, ("command", "reference", *_OF_FILES)),
    GAIN: ("command", "delta", "Q", "network", "set"),
    NETWORK: ("command", "delta", "Q"),
    TABLE: ("reference", "keep_inside", "filter", *_OF_THE_GAME, *_OF_FILES),
    DEPLOYMENT: ("command", "reference", *_OF_THE_GAME, *_OF_FILES),
}


def noted_linear_model(model: Model, point: OperatingPoint) -> LinearModel:
    """Return the linear model at a trim, and issue the notes on nonsmooth points as warnings."""
    linear = linearize(model, point)
    for note in linear.nonsmooth_points:
        warn(note)
    return linear


def policy_option(about: str, *words: str, **more: Any) -> Any:
    """Return the option --policy, whose value is one of some words, or the path of a file.

    about: help text
    more: further fields of the option
    """
    return option(about, "WHAT", partial(_word_or_file, words), **more)


def _word_or_file(words: tuple[str, ...], text: str) -> str | Path:
    """Return a typed text that is one of some words, or else the path of a policy's file."""
    if text in words:
        return text
    if not Path(text).suffix:
        raise BadInputError(f"is {shortened(text)!r}; {choice_of(text, words)}, or give a file")
    return critic_path(text)


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyOptions(TrimOptions, WeightOptions, ReadingOptions):
    """The policy: a word, with the game of which it is the solution, or a file."""

    N: None = None  # no option --N: the game of a flight has no cross weights
    policy: str | Path | None = policy_option(
        f"{NONE}; {EXACT}, that of the game; {' or '.join(LAWS)}, which plan on the nonlinear "
        "model; or a FILE: a gain, a gain table of `hfa solve`, a critic, a network or a "
        f"deployment; default: {EXACT} for the HFA, {NONE} for another aircraft",
        NONE,
        EXACT,
        *LAWS,
    )
    horizon: float | None = option(
        f"duration of a plan of --policy {PREDICTIVE}, s; default from the linear model",
        "S",
        positive,
        rare=True,
    )
    margin: float | None = option(
        f"fraction of the distance to a limit by which --policy {PREDICTIVE} narrows the envelope; "
        "default 0.01",
        "SHARE",
        number,
        rare=True,
    )
    keep_inside: bool = option(
        "change the command of a sample where a rate would leave its limits", rare=True
    )

    @property
    def flown(self) -> str | Path:
        """The policy of --policy; by default the exact one for the HFA, and none for another
        aircraft.
        """
        return self.policy or (EXACT if self.aircraft is None else NONE)

    @cached_property
    def kind(self) -> str:
        """The kind of the policy `flown`: its word, or what its file contains."""
        from hfa_flight.policies.given import kind_of_file

        return self.flown if isinstance(self.flown, str) else kind_of_file(self.flown)


def require_policy(request: PolicyOptions, name: str) -> None:
    """Raise BadInputError, which names the option that requires a policy, without a policy."""
    if request.kind == NONE:
        raise BadInputError(f"{name} requires a policy; give --policy {EXACT}")


def check_policy(request: PolicyOptions, weights: Sequence[str] = ()) -> None:
    """Raise BadInputError for an option that has no effect with the chosen policy.

    weights: options that weigh the cost of the flight, and so have an effect with any policy
    """
    kind, options = request.kind, options_of(type(request))  # those of this command
    if kind == DEPLOYMENT and "delay" in options and is_given(request, "delay"):
        raise BadInputError(
            f"--delay cannot be combined with a deployment; set delay in [timing] of "
            f"{request.flown}"
        )
    unused = [name for name in _UNUSED[kind] if name in options and name not in weights]
    whose = kind if isinstance(request.flown, Path) else f"--policy {kind}"
    if kind == NONE and request.policy is None:  # no --policy, rather than --policy none
        refuse(request, unused, f"requires a policy; give --policy {EXACT}")
    refuse(request, unused, f"cannot be combined with {whose}; remove one of the two")
    if kind != PREDICTIVE:
        refuse(request, _OF_PLANS, f"applies only to --policy {PREDICTIVE}; remove this option")


def policy_of_word(
    word: str,
    game: Game,
    point: OperatingPoint,
    limits: Mapping[str, Any],
    **settings: float | None,
) -> Policy:
    """Return the policy that a word of --policy names, without a budget of time for a sample.

    game: game on the linear model at the trim `point`
    limits: state -> (lowest, highest), replacing the limits of the flight envelope
    settings: horizon and margin of the predictive policy, None for the default
    """
    from controller.riccati.gare import solve
    from hfa_flight.policies.policy import GainPolicy

    if word == EXACT:
        return GainPolicy(EXACT, solve(game).K)
    from hfa_flight.plan.predictive import predictive
    from hfa_flight.plan.state_dependent import state_dependent

    game.refuse_cross_weights(f"--policy {word}")
    of_game = (point.model, point, game.Q, game.R)
    if word != PREDICTIVE:
        return state_dependent(*of_game, delta=game.delta, E=game.E, limits=limits)
    given: dict[str, Any] = {name: value for name, value in settings.items() if value is not None}
    return predictive(*of_game, delta=game.delta, budget=math.inf, limits=limits, **given)


def noted_game(weights: Mapping[str, Any], linear: LinearModel, of_flights: bool = False) -> Game:
    """Return the game of a linear model with some weights that are given (`weighted_game`).

    For the others, the game has default values, and each is named in a warning.
    """
    named = weighted_game(weights, linear, of_flights=of_flights)
    for note in named.warnings:
        warn(note)
    return named.game


def behind_a_filter(
    policy: Policy,
    point: OperatingPoint,
    sensors: Mapping[str, Sensor],
    air: Turbulence | None,
    dt: float,
    fade: float | None = None,
) -> FilteredPolicy:
    """Return the policy behind the filter of sensors in turbulence, with its own sample time or dt.

    fade: that of `hfa.filter(...).policy`
    """
    from hfa_flight.policies.filter import filter
    from hfa_flight.policies.filtered_policy import own_sample_time

    dt = own_sample_time(policy, dt)
    return filter(point.linearize(), sensors, air, dt).policy(policy, fade=fade)


def policy_of_options(
    request: PolicyOptions,
    linear: LinearModel,
    condition: Callable[[float], TrimCondition] | None = None,
    commands: CommandSteps | None = None,
) -> Policy:
    """Return the policy about a trim that the options specify, from a file or computed exactly.

    condition: function from the scheduling variable to the trim condition of a gain table
    commands: steps that a gain table follows
    """
    from controller.critic.critic_file import critic_file
    from controller.game.held_game import held
    from controller.game.linear_game import names_of_linear
    from controller.riccati.gare import solve
    from hfa_flight.policies.given import policy_of_file
    from hfa_flight.policies.policy import GainPolicy

    path, weights = request.flown, given_weights(request, linear.model)
    if not isinstance(path, Path):
        rate = getattr(request, "rate", None)  # of a command that samples
        return GainPolicy(EXACT, solve(held(noted_game(weights, linear), rate)).K)
    game = None
    if request.kind in (GAIN, NETWORK):  # whose policy may depend on the cost
        file = critic_file(path)
        known = {*weights, *file.game(names_of_linear(linear)), *linear.model.about.weights}
        if {"Q", "R"} <= known or "sizes" in known:
            game = weighted_game(weights, linear, critic=file).game
    return policy_of_file(path, linear.point, game, reading_of(request), condition, commands)


def turbulence_option(about: str = "") -> Any:
    """Return an option of turbulence as a dataclass field, by default `--turbulence`."""
    about = about or (
        f"of MIL-F-8785C at ALTITUDE: {', '.join(LEVELS)}, or karman-LEVEL; or {FORM_OF_OWN}; "
        "a wing SPAN adds p, q, r; by --seed"
    )
    return option(about, FORM, typed_turbulence, rare=True)


def at_held_altitude(typed: Turbulence | None, hold: Mapping[str, Any]) -> Turbulence | None:
    """Return the typed turbulence, or None if none was typed.

    A level without an altitude receives the altitude of --hold.

    hold: values of --hold by name
    """
    if typed is None or typed.level not in LEVELS or typed.altitude is not None:
        return typed
    return replace(typed, altitude=hold.get("altitude"))


#: Word of --sensors for the table of the aircraft.
AIRCRAFT = "aircraft"


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorOptions:
    """The sensors of a flight and of its filter."""

    sensors: Path | str | None = option(
        f"table of sensors: [NAME] with noise, bias and every, as typed here; {AIRCRAFT}: that of "
        "the aircraft",
        f"FILE.toml|{AIRCRAFT}",
        lambda text: text if text == AIRCRAFT else input_file(".toml")(text),
        rare=True,
    )
    noise: Mapping[str, str] = option(
        "standard deviation of a sensor, a state or an output (airspeed, ...), degrees for angles; "
        "repeatable",
        "NAME=VALUE",
        named=True,
        rare=True,
    )
    bias: Mapping[str, str] = option(
        "size of the bias of a sensor, with a random sign in each flight, which --filter "
        "estimates; repeatable",
        "NAME=VALUE",
        named=True,
        rare=True,
    )


def sensors_of_options(request: SensorOptions, model: Model) -> dict[str, Sensor]:
    """Return the sensors of --sensors, --noise and --bias, in the model's units.

    Raises BadInputError for a bias without noise.
    """
    of_aircraft = model.about.sensors
    tables: Mapping[str, Any] = {}
    if isinstance(request.sensors, Path):
        tables = read_toml(request.sensors)
    elif request.sensors is not None:
        if not of_aircraft:
            raise BadInputError(
                f"--sensors {AIRCRAFT}: {model.title} declares none; give --sensors FILE.toml"
            )
        warn(f"sensors of {model.title}, {model.about.sensors_source}")
        tables = of_aircraft
    return _sensors(model, str(request.sensors), tables, noise=request.noise, bias=request.bias)


def declared_sensors(model: Model) -> dict[str, Sensor]:
    """Return the sensors that an aircraft declares (`About.sensors`), in the model's units.

    >>> import hfa
    >>> import hfa_flight
    >>> hfa_flight.declared_sensors(hfa.aircraft())["airspeed"]
    Sensor(noise=0.3, bias=2.0, every=0.0)
    """
    return _sensors(model, "About.sensors", model.about.sensors)


def _sensors(model: Model, where: str, table: Any, **given: Mapping[str, str]) -> dict[str, Sensor]:
    """Return the sensors of a table, with other values of single entries.

    where: the table, for messages
    given: entry -> sensor -> text in place of that of the table
    """
    tables = checked(where, table, {str: {"noise*": None, "bias": None, "every": None}})
    sizes = {}
    for entry in ("noise", "bias", "every"):
        of_file = {name: str(table[entry]) for name, table in tables.items() if entry in table}
        kind = _deviation if entry != "every" else lambda model, name, text: seconds(text)
        sizes[entry] = each_of(f"{entry} of", model, {**of_file, **given.get(entry, {})}, kind)
    for name in sizes["bias"]:
        if name not in sizes["noise"]:
            raise BadInputError(f"--bias {name}: no such sensor is given; add --noise {name}=VALUE")
    return {
        name: Sensor(noise, sizes["bias"].get(name, 0.0), sizes["every"].get(name, 0.0))
        for name, noise in sizes["noise"].items()
    }


def _deviation(model: Model, name: str, text: str) -> float:
    """Return the typed size of an error of a sensor, at least 0, in the model's units."""
    return among(measurable(model), in_gusts(model), name, text, Number(0.0))


def _gust(text: str) -> tuple[float, float, float]:
    """Return length, peak and begin of a typed gust."""
    parts = text.split(":")
    if len(parts) not in (2, 3):
        raise BadInputError(f"is {text!r}; give {_GUST}")
    length, peak, *begin = map(number, parts)
    return length, peak, *(begin or (0.0,))


def gust_at(typed: tuple[float, ...], point: OperatingPoint, duration: float) -> OneMinusCosine:
    """Return the gust of the option --gust at the speed of a trim.

    typed: length, peak and start of the gust, in the units of the model and s
    duration: s

    Raises BadInputError if the gust begins outside the duration, its length is not positive, or the
    model has no state or output `speed`.
    """
    length, peak, begin = typed
    if not 0 <= begin < duration:
        raise BadInputError(
            f"--gust begins at {begin:g} s, outside the flight; give BEGIN from 0 to less than "
            f"{duration:g} s"
        )
    return OneMinusCosine(length, peak, gust_speed(point), begin)


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenarioOptions(SensorOptions, TimingOptions):
    """The scenario of a flight, except for commands.

    By default, nothing disturbs the flight.
    """

    duration: float | None = option("duration, s; default 20, or more if unstable", "S", number)
    initial: Mapping[str, str] = option(
        "initial deviation of a state from the trim, degrees for angles; repeatable",
        "NAME=VALUE",
        named=True,
    )
    disturbance: Mapping[str, str] = option(
        "constant added to the derivative of a state, or value of a disturbance of the model; "
        "repeatable",
        "NAME=VALUE",
        named=True,
        rare=True,
    )
    turbulence: Turbulence | None = turbulence_option()
    seed: int = option("seed of all random numbers; default 0", "N", whole(0), default=0, rare=True)
    error: Mapping[str, str] = option(
        "factor on a parameter of the simulated aircraft only; with --samples, relative "
        "standard deviation of the parameter; repeatable",
        "NAME=NUMBER",
        named=True,
        rare=True,
    )
    gust: tuple[float, ...] | None = option(
        "1-cosine updraft of a length and a peak from BEGIN on, s; units of the model",
        _GUST,
        _gust,
        rare=True,
    )
    envelope: Mapping[str, str] = option(
        "limits of a state or output, degrees for angles; speed and flow angles are relative to "
        "the air; repeatable",
        "NAME=LOW:HIGH",
        named=True,
        rare=True,
    )


def sample_of_options(request: TimingOptions) -> float:
    """Return the duration of a sample, s, that of --rate."""
    return _SAMPLE if request.rate is None else 1.0 / request.rate


def scenario_of(
    request: ScenarioOptions, point: OperatingPoint, hold: Mapping[str, Any], *, drawn: bool
) -> Scenario:
    """Return the scenario that the options specify for a trim.

    The tick divides a sample and the delay.

    hold: values of --hold, whose altitude is the one of the turbulence
    drawn: whether the scenario is of several flights, with random errors of parameters

    Raises BadInputError if the delay is out of range, or if both --gust and --turbulence are
    given.
    """
    duration = _DURATION if request.duration is None else request.duration
    delay = request.delay
    model = point.model
    initial = each_of("--initial", model, request.initial, partial(among, tuple(model.states)))
    names = (*model.linear, *model.disturbances)
    disturbed = each_of("--disturbance", model, request.disturbance, partial(among, names))
    sensors = sensors_of_options(request, model)
    if delay and not 0.0 < delay < duration:
        raise BadInputError(
            f"--delay is {delay:g} s; give a delay from 0 to less than {duration:g} s"
        )

    added = [disturbed.get(name, 0.0) for name in model.linear]
    # All but moving air and random quantities. The delay is p/q of a sample, whole ticks as it is.
    sample = sample_of_options(request)
    tick = sample / Fraction(delay / sample).limit_denominator(_MOST_TICKS).denominator
    timing = Scenario(duration).with_tick(tick, _LONGEST_STEP, sample)
    common = replace(
        timing,
        initial=np.array([initial.get(name, 0.0) for name in model.states]),
        # A constant is added to the rate of a state, or it is the value of a disturbance.
        disturbance=constant(np.array(added)) if any(added) else None,
        delay=delay,
        air={
            name: constant(np.array([value]))
            for name, value in disturbed.items()
            if name not in model.linear
        },
    )

    gust: Gust | None = None
    if request.gust is not None:
        gust = gust_at(request.gust, point, common.duration)
    if gust is not None and request.turbulence is not None:
        raise BadInputError("--gust and --turbulence cannot be combined; remove one of the two")
    turbulence = at_held_altitude(request.turbulence, hold)

    of_parameters = each_of("--error", model, request.error, lambda model, name, text: number(text))
    # Of several flights the values of --error are standard deviations, of a single one factors.
    errors = {} if drawn else of_parameters
    uncertainty = Uncertainty(of_parameters if drawn else {}, sensors, turbulence)
    return replace(common, errors=errors, uncertainty=uncertainty, gust=gust).on(model)
