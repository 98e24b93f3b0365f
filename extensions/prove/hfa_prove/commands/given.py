"""The user's data in the form of a statement, for comparison with a certificate."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa.options.request import Request
from hfa.options.trim import OF_THE_TRIM, called_at
from hfa_aircraft.names import UNNAMED, PlantNames
from hfa_prove.commands.options import family_of, loop_of_file
from hfa_prove.statements.flight import Flight
from hfa_prove.statements.game import GameStatement
from hfa_prove.statements.schedule import (
    ScheduleStatement,
    UncertainActuators,
)
from hfa_prove.subject import Given
from hfa_support.errors import BadInputError, NoSolutionError, prefix_errors

if TYPE_CHECKING:
    from hfa_prove.commands.request import CheckRequest, CostRequest, RegionRequest
    from hfa_prove.search.loops import Intervals
    from hfa_prove.statements.cost import CostStatement
    from hfa_prove.statements.value import ValueStatement

#: Options that name an aircraft.
_OF_THE_AIRCRAFT = (
    "aircraft.source",
    "aircraft.dynamics",
    "aircraft.parameters",
    *(f"trim.{name}" for name in OF_THE_TRIM),
)


def names_aircraft(request: Request) -> bool:
    """Return whether an option that defines the aircraft or its trim is given."""
    return any(name in request.typed for name in _OF_THE_AIRCRAFT)


def aircraft_option(request: Request) -> str:
    """Return the first given option that defines the aircraft or its trim, for messages.

    If there is no such option, return the option of the scheduling value.
    """
    named = [name for name in _OF_THE_AIRCRAFT if name in request.typed]
    return request.typed[named[0]] if named else f"--{called_at(request.model)}"


def at_one_value(request: CheckRequest | RegionRequest) -> Any:
    """Return the request with its one scheduling value in the unit of the model.

    The scheduling values of a `CheckRequest` are a tuple as typed. Other requests are returned
    unchanged.

    Raises BadInputError if several values are given.
    """
    if not isinstance(request.trim.at, tuple):
        return request
    if len(request.trim.at) != 1:
        raise BadInputError(f"--{called_at(request.model)} is an interval; give one value")
    (typed,) = request.trim.at
    in_degrees = request.model.schedule_unit == "deg"
    at = math.radians(typed) if in_degrees else typed
    return replace(request, trim=replace(request.trim, at=at))


def given_for(
    statement: ScheduleStatement | GameStatement, request: CheckRequest
) -> dict[str, Given]:
    """Return path of an entry of the statement -> the value that the user's options give.

    statement: the proved statement
    request: options of the command

    Raises BadInputError if an option does not apply to the statement. Raises NoSolutionError if the
    critic has no K and the statement does not determine K from the critic's P or W.
    """
    flight = getattr(statement, "flight", getattr(statement, "plant", None))
    if not isinstance(flight, Flight):
        assert isinstance(statement, GameStatement)  # the only kind without a flight
        return _given_plant(statement, request)
    if request.game.plant is not None:
        raise BadInputError(
            "--model is a linear plant, but the certificate is about an aircraft; remove --model"
        )
    of_game = isinstance(statement, GameStatement)
    given = _given_flight(flight, request, "plant" if of_game else "flight")
    given |= _given_weights(flight, request)
    if isinstance(statement, GameStatement):
        return given | _given_critic(statement, request)
    if request.weights is None:
        request.refuse(
            ("design",),
            "requires a controller; add --weights FILE with the controller, or remove this option",
        )
        return given
    return given | _given_controller(statement, request)


def _given_flight(flight: Flight, request: CheckRequest, name: str) -> dict[str, Given]:
    """Return the entries on the aircraft and its trims from the options.

    The entries are the scheduling values, and the model with its parameters, imposed values and
    limits.

    name: entry of the statement that contains the aircraft
    """
    given = {}
    if request.trim.at:
        option = f"--{called_at(request.model)}"
        given[f"{name}.range"] = Given([request.trim.at[0], request.trim.at[-1]], option)
    if not names_aircraft(request):
        return given
    own = family_of(request.aircraft, request.trim).flight(flight.low, flight.high)
    option = aircraft_option(request)
    content = own.content()
    of_options = ("model", "parameters", "imposed", "limits")
    return given | {f"{name}.{each}": Given(content[each], option) for each in of_options}


def _given_weights(flight: Flight, request: CheckRequest) -> dict[str, Given]:
    """Return the entries Q, R and delta from the options.

    If one of them and an aircraft are given, the entry E of the default game is also returned.
    """
    given = {
        f"weights.{name}": Given(value, f"--{name}")
        for name, value in request.game.weights.changed.items()
    }
    if names_aircraft(request) and given:
        n = len(flight.model.linear)
        m = len(flight.model.inputs)
        from controller.hfa_game import usual_game

        usual = usual_game(flight.model, np.eye(n), np.ones((n, m)))
        given["weights.E"] = Given(usual.E, aircraft_option(request))
    return given


def given_bound(statement: CostStatement, request: CheckRequest | CostRequest) -> dict[str, Given]:
    """Return path of an entry of a bound of the cost -> the value that the user's options give.

    Raises BadInputError or NoSolutionError if the options do not define a trim.
    """
    from hfa_flight.problem import flight_problem
    from hfa_prove.problem import given_of

    weights = request.game.weights.changed
    given = {name: Given(value, f"--{name}") for name, value in weights.items()}
    limits = getattr(request, "limits", None)
    problem = flight_problem(request.trim.aircraft, request.trim.point(), limits=limits)
    return given | given_of(problem, aircraft_option(request), {})


def given_value(statement: ValueStatement, request: CheckRequest) -> dict[str, Given]:
    """Return path of an entry of a value -> the value that the user's options give.

    Raises BadInputError if the file of --weights contains no value.
    """
    from controller.critic.critic_file import entries_in
    from hfa_prove.problem import given_plant, plant_at

    given = {
        f"weights.{name}": Given(value, f"--{name}")
        for name, value in request.game.weights.changed.items()
    }
    if request.trim.at or names_aircraft(request):
        own = plant_at(at_one_value(request).trim.point())
        given |= given_plant(own, aircraft_option(request), "plant.")
    given["plant.limits"] = Given({}, "a value, which has no limits,")
    if request.weights is not None:
        option_named = f"--weights {request.weights}"
        entries = entries_in(request.weights)
        for entry, stated in (("V", "W"), ("u", "policy_weights")):
            if stated not in entries:
                raise BadInputError(
                    f"{request.weights} contains no {stated}; give a file written by `hfa solve "
                    "--order`"
                )
            given[entry] = Given(entries[stated], option_named)
    return given


def _given_plant(statement: GameStatement, request: CheckRequest) -> dict[str, Given]:
    """Return the entries on the plant, its weights and the critic from the options.

    Raises BadInputError if an option defines an aircraft.
    """
    request.refuse(
        (*_OF_THE_AIRCRAFT, "trim.at"),
        "gives an aircraft, but the certificate is about a plant; remove this option",
    )
    given = {
        f"weights.{name}": Given(value, f"--{name}")
        for name, value in request.game.weights.changed.items()
    }
    if request.game.plant is not None:
        game = request.game.game(request.aircraft, request.trim).game
        game.refuse_cross_weights("a certificate of hfa prove")
        option = f"--model {request.game.plant}"
        given |= {"plant.A": Given(game.A, option), "plant.B": Given(game.B, option)}
        weights = {name: getattr(game, name) for name in ("Q", "R", "E", "delta")}
        given |= {f"weights.{name}": Given(value, option) for name, value in weights.items()}
    return given | _given_critic(statement, request)


def _given_critic(statement: GameStatement, request: CheckRequest) -> dict[str, Given]:
    """Return the entries K, P and W of the critic file that is given, or {} if no file is given.

    Raises BadInputError if an option does not apply to a critic.
    Raises NoSolutionError if the file has no K and the statement does not claim that K is the gain
    of the critic's P or W.
    """
    if request.weights is None:
        request.refuse(
            ("reading.basis",),
            "applies only to W in --weights; add --weights FILE, or remove this option",
        )
        return {}
    option = f"--weights {request.weights}"
    names = UNNAMED
    if isinstance(statement.plant, Flight):
        model = statement.plant.model
        names = PlantNames(model.linear, tuple(model.inputs), model.units(model.linear))
    states = len(statement.weights.Q)
    from controller.critic.critic_file import entries_in, single_parts
    from controller.game.basis import basis
    from hfa_prove.check.game import matrix_of_weights

    entries = entries_in(request.weights)
    with prefix_errors(request.weights):
        parts = single_parts(entries, names, basis(request.reading.basis or "quadratic", states))
    if "W" in parts:
        if "P" in statement.critic and "P" not in parts:
            parts["P"] = matrix_of_weights(parts["W"], states)
        parts["W"] = parts["W"][:, None]
    given = {f"critic.{name}": Given(value, option) for name, value in parts.items()}
    if "K" not in parts:
        if not statement.gain_of_value:
            raise NoSolutionError(
                f"{request.weights} contains no K, and the certificate's K is not the gain of the "
                "certificate's P or W; give a file with K"
            )
        given["critic.K"] = Given(statement.critic["K"], option)
    return given


def _given_controller(statement: ScheduleStatement, request: CheckRequest) -> dict[str, Given]:
    """Return the entries on the controller and the actuators from the options.

    The options are --weights and --design.

    Raises BadInputError if either the given loop or the statement has no actuators, but not both.
    """
    assert request.weights is not None  # the caller found it
    option = f"--weights {request.weights}"
    model = statement.flight.model
    loop = loop_of_file(request.weights, request.design, model, _stated_intervals(statement))
    if loop.actuators is None and statement.actuators is not None:
        raise BadInputError(
            f"{option} gives no actuators, but the certificate has actuators; add --design"
        )
    if loop.actuators is not None and statement.actuators is None:
        raise BadInputError(
            "--design gives actuators, but the certificate has no actuators; remove --design"
        )
    own = replace(statement, controller=loop.controller, actuators=loop.actuators)
    return {
        path: Given(value, option)
        for path, _, value in own.entries()
        if path.startswith(("controller.", "actuators."))
    }


def _stated_intervals(statement: ScheduleStatement) -> Intervals | None:
    """Return the intervals of the statement's uncertain actuators, or None if there are none."""
    actuators = statement.actuators
    if not isinstance(actuators, UncertainActuators):
        return None
    from hfa_prove.search.loops import Intervals

    return Intervals(actuators.bandwidth, actuators.effectiveness, actuators.delay)
