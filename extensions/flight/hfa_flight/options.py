"""Command-line options of a flight: policy and scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa.options.argument_types import (
    among,
    each_of,
    input_file,
    linear_state,
    number,
    one_of,
    positive,
    span,
    whole,
)
from hfa.options.critic_files import ReadingOptions, critic_path, reading_of
from hfa.options.games import WeightOptions, given_weights, weighted_game
from hfa.options.option import is_given, option, options_of, refuse
from hfa.options.trims import TrimOptions
from hfa_aircraft.model import Model
from hfa_aircraft.signals import record
from hfa_aircraft.waveform import constant
from hfa_flight.air.actuators import ActuatorBank
from hfa_flight.air.gusts import Gust, OneMinusCosine
from hfa_flight.air.names import gust_speed
from hfa_flight.air.scenario import Scenario, Uncertainty
from hfa_flight.air.turbulence import FORM, FORM_OF_OWN, LEVELS, Turbulence, typed_turbulence
from hfa_flight.policies.laws import LAWS, PREDICTIVE
from hfa_flight.simulate.envelope import control_limits
from hfa_support.errors import BadInputError, warn
from hfa_support.files import MATRIX_FILES
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from controller.game.zero_sum import Game
    from hfa_flight.policies.policy import FunctionPolicy, GainPolicy, Policy

#: Name of the law without a policy, with which commands are steps of inputs; name of the game's
#: exact policy.
NONE = "none"
EXACT = "exact"
#: Default duration of a flight, s.
_DURATION = 20.0
#: Duration of a sample of a flight, s.
_SAMPLE = 0.01
#: Forms of values in the help of options.
_GUST = "LENGTH:PEAK[:BEGIN]"
_ACTUATORS = "LAG:RATE[:ORDER]"
#: Options of the game that the law solves.
_OF_THE_GAME = ("delta", "Q", "R")
#: Option that replaces the law -> options that have no effect with it.
_REPLACE_THE_LAW = {
    "controller": ("law", "set", "weights", *_OF_THE_GAME),
    "weights": ("law", "delta", "Q"),
    "deployment": ("law", "set", "weights", "controller", *_OF_THE_GAME, "delay", "command"),
}


def noted_linear_model(model: Model, point: OperatingPoint) -> LinearModel:
    """Return the linear model at a trim, and issue the notes on kinks as warnings."""
    linear = linearize(model, point)
    for note in linear.kinks:
        warn(note)
    return linear


def numbers(
    form: str, count: int, otherwise: tuple[float, ...] = ()
) -> Callable[[str], tuple[float, ...]]:
    """Return a function that converts a text such as "1:2:3" to a tuple of `count` numbers.

    The function raises BadInputError for a wrong number of parts, or for a part that is not a
    number.

    form: description of the text for error messages
    otherwise: default values of the last numbers. The text may omit these numbers
    """

    def convert(text: str) -> tuple[float, ...]:
        parts = text.split(":")
        least = count - len(otherwise)
        if not least <= len(parts) <= count:
            raise BadInputError(f"is {text!r}; give {form}")
        return (*(number(part) for part in parts), *otherwise[len(parts) - least :])

    return convert


def actuators_option() -> Any:
    """Return the option --actuators."""
    about = "add actuators with lag (s), rate limit (deg/s) and order 1 (default) or 2"
    kind = numbers(_ACTUATORS, 3, otherwise=(1.0,))
    return option(about, _ACTUATORS, kind, rare=True)


#: Default of --margin with --filter.
_FILTERED_MARGIN = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyOptions(TrimOptions, WeightOptions, ReadingOptions):
    """The policy: a law with its game, or a file with a gain, a critic or a controller."""

    N: None = None
    law: str | None = option(
        f"policy: {NONE}; {EXACT}, that of the game; or {' or '.join(LAWS)}, which plan on the "
        f"nonlinear model; default: {EXACT} for the HFA, {NONE} for another aircraft",
        "NAME",
        one_of(NONE, EXACT, *LAWS),
    )
    horizon: float | None = option(
        f"duration of a plan of --law {PREDICTIVE}, s; default from the linear model",
        "S",
        positive,
        rare=True,
    )
    margin: float | None = option(
        f"fraction of the distance to a limit by which --law {PREDICTIVE} narrows the envelope; "
        f"default 0.01, with --filter {_FILTERED_MARGIN:g}",
        "SHARE",
        number,
        rare=True,
    )
    keep_inside: bool = option(
        "change the command of a sample where a rate would leave its limits", rare=True
    )
    weights: Path | None = option(
        "file with a gain K, a critic (W or P) or a network; replaces --law", "FILE", critic_path
    )
    controller: Path | None = option(
        "gain table, as of `hfa solve --dihedral 5,10,15 -o FILE`; replaces --law",
        "FILE",
        input_file(*MATRIX_FILES),
        rare=True,
    )
    deployment: Path | None = option(
        "policy from a deployment file, sampled and held",
        "DEPLOYMENT.toml",
        input_file(".toml"),
        names="--policy",
    )


def flown_law(request: PolicyOptions, usual: str = "") -> str:
    """Return the law that --law names, or the default; "" if a file replaces it.

    usual: the default, or "" for that of the aircraft
    """
    if any(is_given(request, name) for name in _REPLACE_THE_LAW):
        return ""
    return request.law or usual or (EXACT if request.aircraft is None else NONE)


def require_policy(request: PolicyOptions, name: str) -> None:
    """Raise BadInputError, which names the option that requires a policy, without a policy."""
    if flown_law(request) == NONE:
        raise BadInputError(f"{name} requires a policy; {_remedy(request)}")


def _remedy(request: PolicyOptions) -> str:
    return f"remove --law {NONE}" if request.law else f"add --law {EXACT}"


def check_policy(request: PolicyOptions, prices: Sequence[str] = (), usual: str = "") -> None:
    """Raise BadInputError for an option that has no effect with the chosen policy.

    prices: weights of the flight's cost, which are not of the policy
    usual: the default law, or "" for that of the aircraft
    """
    options = options_of(type(request))
    for name, without_effect in _REPLACE_THE_LAW.items():
        if is_given(request, name):
            reason = f"has no effect with {options[name].names[-1]}; remove this option"
            idle = [each for each in without_effect if each not in prices and each in options]
            if name == "deployment" and "delay" in options and is_given(request, "delay"):
                raise BadInputError(
                    f"--delay has no effect with --policy; set delay in [timing] of "
                    f"{request.deployment}"
                )
            refuse(request, idle, reason)
    law = flown_law(request, usual)
    if law == NONE:
        of_game = [each for each in _OF_THE_GAME if each not in prices]
        instead = f"remove this option or --law {NONE}" if request.law else f"add --law {EXACT}"
        refuse(request, of_game, f"applies only to a law; {instead}")
    if law != PREDICTIVE:
        of_plans = ("horizon", "margin")
        refuse(request, of_plans, f"applies only to --law {PREDICTIVE}; remove this option")
    if request.weights is None:
        refuse(
            request,
            ("set",),
            "applies only to a network; remove this option, or give a network with --weights",
        )


def policy_of_law(
    law: str,
    game: Game,
    point: OperatingPoint,
    limits: Mapping[str, Any] | None = None,
    *,
    is_filtered: bool = False,
    **settings: float | None,
) -> Policy:
    """Return the policy of a law of a game, without a budget of time for a sample.

    game: game on the linear model at the trim `point`
    limits: state -> (lowest, highest), replacing the limits of the flight envelope
    is_filtered: whether a filter estimates the states, so that limits are narrowed by its errors
    settings: horizon and margin of the predictive policy, None for the default
    """
    from hfa_flight.plan.predictive import predictive
    from hfa_flight.plan.state_dependent import state_dependent

    if law == EXACT:
        return exact_policy(game)
    game.refuse_cross_weights(f"--law {law}")
    of_game = (point.model, point, game.Q, game.R)
    if law != PREDICTIVE:
        return state_dependent(*of_game, delta=game.delta, E=game.E, limits=limits)
    if is_filtered and settings.get("margin") is None:
        settings["margin"] = _FILTERED_MARGIN
    given: dict[str, Any] = {name: each for name, each in settings.items() if each is not None}
    return predictive(*of_game, delta=game.delta, budget=math.inf, limits=limits, **given)


def exact_policy(game: Game) -> GainPolicy:
    """Return the exact gain of a game as a policy."""
    from controller.riccati.gare import unconfirmed_solution
    from hfa_flight.policies.policy import GainPolicy

    return GainPolicy(EXACT, unconfirmed_solution(game).K)


def noted_game(weights: Mapping[str, Any], linear: LinearModel) -> Game:
    """Return the game of given weights, and issue the notes on the others as warnings."""
    named = weighted_game(weights, linear)
    for note in named.warnings:
        warn(note)
    return named.game


def behind_a_filter(policy: Policy, scenario: Scenario, point: OperatingPoint) -> Policy:
    """Return the policy behind the filter of the scenario's noise and turbulence.

    Raises BadInputError without noise.
    """
    from hfa_flight.policies.filter import filter
    from hfa_flight.policies.filtered_policy import own_sample_time

    noise = noise_of_filter(scenario.uncertainty.noise)
    dt = own_sample_time(policy, scenario.interval)
    return filter(point.linearize(), noise, scenario.uncertainty.turbulence, dt).policy(policy)


def policy_about(request: PolicyOptions, linear: LinearModel) -> GainPolicy | FunctionPolicy:
    """Return the policy about a trim that the options specify.

    The policy is read from a file or computed exactly. A nonlinear policy, such as a network, is
    saturated at the control limits of the model.
    """
    from controller.critic.critic_file import critic_in
    from hfa_flight.policies.policy import GainPolicy, function_policy

    path, weights = request.weights, given_weights(request)
    if path is None:
        return exact_policy(noted_game(weights, linear))
    game = weighted_game(weights, linear).game
    critic = critic_in(path, game, reading_of(request))
    if not critic.has_linear_policy:
        return function_policy(f"critic of {path}", critic.policy, linear.point)
    kind = "gain" if critic.slope_gain is None else "weights"
    return GainPolicy(f"{kind} of {path}", critic.K)


def turbulence_option() -> Any:
    """Return the option `--turbulence` as a dataclass field."""
    about = (
        f"turbulence of MIL-F-8785C at ALTITUDE: {', '.join(LEVELS)}; a wing SPAN adds p, q, r; "
        f"karman-LEVEL has spectra of von Karman; {FORM_OF_OWN} has intensity and scale; units of "
        "the model; random by --seed"
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


def noise_option(about: str) -> Any:
    """Return the option `--noise` as a dataclass field, name of a state -> text.

    about: help text
    """
    return option(about, "NAME=VALUE", named=True, rare=True)


def noise_of(texts: Mapping[str, str], model: Model) -> dict[str, float]:
    """Return state -> standard deviation of its sensor noise, from the texts of --noise."""
    return each_of("--noise", model, texts, _deviation)


def _deviation(model: Model, name: str, text: str) -> float:
    """Return the standard deviation that is typed for a state, at least 0, in the model's units."""
    value = linear_state(model, name, text)
    if value < 0.0:
        raise BadInputError(f"is {text}; give a number of at least 0")
    return value


def noise_of_filter(noise: Mapping[str, float]) -> dict[str, float]:
    """Return the sensors of --filter, state -> standard deviation of its noise, those above 0.

    Raises BadInputError without a sensor.
    """
    sensors = {name: value for name, value in noise.items() if value}
    if not sensors:
        raise BadInputError(
            "--filter requires the noise of the sensors; add --noise STATE=VALUE for each "
            "measured state"
        )
    return sensors


def gust_option() -> Any:
    """Return the option `--gust` as a dataclass field."""
    about = "1-cosine updraft: length, peak speed (units of the model), begin (s, default 0)"
    return option(about, _GUST, numbers(_GUST, 3, otherwise=(0.0,)), rare=True)


def gust_at(
    typed: tuple[float, ...] | None, point: OperatingPoint, duration: float
) -> OneMinusCosine | None:
    """Return the gust of the option --gust at the speed of a trim, or None without the option.

    typed: length, peak and start of the gust, in the units of the model and s
    duration: s

    Raises BadInputError if the gust begins outside the duration, its length is not positive, or the
    model has no state or output `speed`.
    """
    if typed is None:
        return None
    length, peak, begin = typed
    if not 0 <= begin < duration:
        raise BadInputError(
            f"--gust begins at {begin:g} s, outside the flight; give BEGIN from 0 to less than "
            f"{duration:g} s"
        )
    return OneMinusCosine(length, peak, gust_speed(point), begin)


def _state(model: Model, name: str, text: str) -> float:
    return among(tuple(model.states), model, name, text)


def _disturbed(model: Model, name: str, text: str) -> float:
    return among((*model.linear, *model.disturbances), model, name, text)


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenarioOptions:
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
    actuators: tuple[float, ...] | None = actuators_option()
    delay: float = option(
        "delay of every command of the policy, s; default 0",
        "S",
        number,
        default=0.0,
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
    noise: Mapping[str, str] = noise_option(
        "standard deviation of the sensor noise of a state, degrees for angles, white from sample "
        "to sample; repeatable"
    )
    gust: tuple[float, ...] | None = gust_option()
    envelope: Mapping[str, str] = option(
        "limits of a state that replace its default envelope, degrees for angles (alpha is "
        "relative to the air); repeatable",
        "NAME=LOW:HIGH",
        named=True,
        rare=True,
    )


def scenario_of(
    request: ScenarioOptions, point: OperatingPoint, hold: Mapping[str, Any], *, drawn: bool
) -> Scenario:
    """Return the scenario that the options specify for a trim.

    A sample has 10 ms. The tick is the longest whole number of ms that divides it and the delay.

    hold: values of --hold, whose altitude is the one of the turbulence
    drawn: whether the scenario is of several flights, with random errors of parameters

    Raises BadInputError if the delay is out of range, or if both --gust and --turbulence are
    given.
    """
    duration = _DURATION if request.duration is None else request.duration
    delay = request.delay
    model = point.model
    initial = each_of("--initial", model, request.initial, _state)
    disturbed = each_of("--disturbance", model, request.disturbance, _disturbed)
    noise = noise_of(request.noise, model)
    if delay and not 0.0 < delay < duration:
        raise BadInputError(
            f"--delay is {delay:g} s; give a delay from 0 to less than {duration:g} s"
        )
    names = model.linear
    common = Scenario(
        duration=duration,
        tick=math.gcd(10, round(1000.0 * delay)) / 1000.0,
        sample=_SAMPLE,
        initial=np.array([initial.get(name, 0.0) for name in model.states]),
        disturbance=constant(np.array([disturbed.get(name, 0.0) for name in names])),
        actuators=actuators_of(model, request.actuators),
        delay=delay,
        air={
            name: constant(np.array([value]))
            for name, value in disturbed.items()
            if name not in names
        },
    )
    if request.gust is not None and request.turbulence is not None:
        raise BadInputError("--gust and --turbulence cannot be combined; remove one of the two")
    gust: Gust | None = gust_at(request.gust, point, common.duration)
    turbulence = at_held_altitude(request.turbulence, hold)
    factors = each_of("--error", model, request.error, lambda *words: number(words[-1]))
    errors = {} if drawn else factors
    uncertainty = Uncertainty(factors if drawn else {}, noise, turbulence)
    return replace(common, errors=errors, uncertainty=uncertainty, gust=gust).on(model)


def envelope_of(request: ScenarioOptions, model: Model) -> dict[str, tuple[float, float]]:
    """Return state -> limits that replace its default envelope."""
    return each_of("--envelope", model, request.envelope, span)


def actuators_of(model: Model, typed: tuple[float, ...] | None) -> ActuatorBank | None:
    """Return the actuators that --actuators specifies, or None without --actuators.

    The rate limit applies to the surfaces. These are the inputs in rad or deg.

    typed: lag in s, rate limit in deg/s, order

    Raises BadInputError if a number is out of range.
    """
    if typed is None:
        return None
    lag, degrees_per_second, order = typed
    if degrees_per_second <= 0:
        raise BadInputError(
            f"the rate limit of --actuators is {degrees_per_second:g} deg/s; give a positive "
            "rate limit"
        )
    rates = {"rad": math.radians(degrees_per_second), "deg": degrees_per_second}
    inputs = model.inputs
    values: Any = record(tuple(inputs))
    limits = control_limits(model)
    lowest = values(*limits.lowest.tolist())
    highest = values(*limits.highest.tolist())
    fastest = values(*(rates.get(signal.unit, math.inf) for signal in inputs.values()))
    lags = values(*[lag] * len(inputs))
    return ActuatorBank(lags, lowest, highest, fastest, order=int(order))
