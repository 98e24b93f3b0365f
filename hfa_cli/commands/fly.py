"""Fly a policy on the full seven-state nonlinear aircraft, beside what the linear model predicts.

Exit code 0 when the flight stays in its envelope, 1 when it leaves it (the report says which state left first). With
--to, a schedule of certified gains flies a slow change of dihedral. With --map, both sets of equations are flown
from many starts and to many dihedral commands.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa_cli import games, options
from hfa_cli.flights import (
    add_scenario,
    add_weights,
    envelope_changes,
    game_on,
    law_of,
    scenario_of,
    seed_of,
)
from hfa_cli.learning import law_settings, show_learning
from hfa_cli.output import Progress, check_target, say_notes
from hfa_cli.values import grid, number, quantity, whole
from hfa_model.support.data_files import save_data
from hfa_model.support.errors import BadInputError
from hfa_model.support.jsonable import jsonable
from hfa_model.support.text import Table
from trim.linear.linearize import LinearModel, linearize
from trim.point.condition import level_flight
from trim.point.solve import find_operating_point
from trim.point.trim_report import warnings

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from controller.flight.gain_plan import GainPlan
    from controller.flight.simulate import NonlinearFlight
    from hfa_model.support.checks import Check
    from trim.point.operating_point import OperatingPoint

_PICTURES = (".png", ".svg")
_MOST_POINTS = 1000
_RANGES = {
    "speeds": ("speed", "-4:8:0.25"),
    "dihedrals": ("dihedral", "-40:40:2.5"),
    "commands": ("dihedral", "-40:40:2.5"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa fly`."""
    options.add_condition(parser)
    options.add_aircraft(parser)
    add_weights(parser)
    parser.add_argument("--online", action="store_true", help="learn in flight; a baseline flies until certified")
    add_scenario(parser)
    parser.add_argument(
        "--check", action="store_true", help="also: slope 2 against the linear model, and an adaptive integrator"
    )
    parser.add_argument("--picture", metavar="FILE", help="draw the flight (.png or .svg)")
    change = parser.add_argument_group("a slow change of dihedral under a schedule")
    change.add_argument("--to", metavar="DEG", help="dihedral at the end")
    change.add_argument("--over", metavar="S", help="time of the change, default 60")
    change.add_argument("--points", metavar="N", help="grid points of the schedule, default 11")
    maps = parser.add_argument_group("the recoverable set, of both sets of equations")
    maps.add_argument("--map", metavar="FILE", help="draw it (.png or .svg)")
    for name, (quantity_name, text) in _RANGES.items():
        unit = "ft/s" if quantity_name == "speed" else "deg"
        maps.add_argument(f"--{name}", metavar="RANGE", help=f"off trim, {unit}; default {text}")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when the envelope was left or a check failed."""
    target = check_target(arguments.output)
    picture = check_target(arguments.picture, _PICTURES)
    law = law_of(arguments)
    for name in ("online", "set"):
        if law == "exact" and options.given(arguments, name):
            raise BadInputError(f"--{name} belongs to a learning law; with --law exact there is nothing to learn")
    if law == "exact" and arguments.seed is not None and arguments.turbulence is None:
        raise BadInputError("--seed belongs to a learning law or to --turbulence; here nothing is random")
    if arguments.map is not None:
        return _map(arguments, target)
    for name in _RANGES:
        _needs(arguments, name, "map")
    if arguments.to is not None:
        return _scheduled(arguments, target, picture)
    for name in ("over", "points"):
        _needs(arguments, name, "to")
    return _flight(arguments, target, picture)


def _flight(arguments: argparse.Namespace, target: Path | None, picture: Path | None) -> int:
    from controller.flight.envelope import flight_envelope
    from controller.flight.simulate import fly

    aircraft = options.aircraft_of(arguments)
    point = options.operating_point_of(arguments, aircraft)
    scenario = scenario_of(arguments, point)
    envelope = flight_envelope(aircraft.parameters, point, envelope_changes(arguments.envelope))
    plan = _plan(arguments, linearize(aircraft, point), scenario.tick)
    result = fly(aircraft, point, plan, scenario, envelope, progress=Progress("fly"))
    checks: tuple[Check, ...] = ()
    if arguments.check:
        from verification.flights.agreement import agreement_checks

        checks = agreement_checks(aircraft, plan, scenario, result)
    learning = "learning in flight" if plan.online else "frozen"
    return _deliver(arguments, target, picture, result, plan, checks, _title(arguments, f"law {plan.law}, {learning}"))


def _scheduled(arguments: argparse.Namespace, target: Path | None, picture: Path | None) -> int:
    from controller.flight.envelope import flight_envelope
    from verification.flights.flight_report import schedule_data, schedule_text
    from verification.flights.scheduling import LEAD, REST, certified_schedule, change_over, fly_schedule, grid_of

    for name in ("online", "check", "reference", "speed", "altitude", "alpha", "gamma", "limit"):
        if options.given(arguments, name):
            raise BadInputError(f"--{name} does not go with --to, which flies the paper's level trims")
    aircraft = options.aircraft_of(arguments)
    start, end = arguments.dihedral, quantity("dihedral", arguments.to)
    over = 60.0 if arguments.over is None else number(arguments.over, "--over")
    change = change_over(start, end, over)
    scenario = scenario_of(arguments, find_operating_point(aircraft, level_flight(start)), LEAD + over + REST)
    if scenario.duration < LEAD + over:
        raise BadInputError(
            f"--duration is {scenario.duration:g} s and the change of dihedral ends at {LEAD + over:g} s; fly longer"
        )
    certified = certified_schedule(
        aircraft,
        grid_of(change, whole("--points", arguments.points, 11, lowest=2)),
        law=arguments.law,
        seed=seed_of(arguments),
        game=games.weights_of(arguments),
        settings={} if arguments.law == "exact" else law_settings(arguments),
        progress=Progress("certify"),
    )
    envelope = flight_envelope(aircraft.parameters, certified.at(start).point, envelope_changes(arguments.envelope))
    result = fly_schedule(aircraft, certified, change, scenario, envelope, progress=Progress("fly"))
    title = _title(arguments, f"to {float(arguments.to):g} deg over {over:g} s, law {arguments.law}, scheduled")
    return _deliver(
        arguments,
        target,
        picture,
        result,
        None,
        (),
        title,
        more={"schedule": schedule_data(certified, arguments.law)},
        more_text=schedule_text(certified, arguments.law),
        points=[certified.at(start).point, certified.at(end).point],
    )


def _map(arguments: argparse.Namespace, target: Path | None) -> int:
    from controller.flight.envelope import flight_envelope
    from hfa_model.aircraft import Aircraft
    from hfa_model.support.figure import save
    from hfa_model.variants import VARIANTS
    from verification.flights.flight_figures import map_figure
    from verification.flights.map_report import map_data, map_table, map_text
    from verification.flights.recoverable import recoverable_map

    path = check_target(arguments.map, _PICTURES)
    assert path is not None
    scenario = ("duration", "step", "initial", "reference", "disturbance", "noise", "error", "actuators", "engine")
    for name in (*scenario, "gust", "turbulence", "online", "check", "to", "over", "points", "picture"):
        if options.given(arguments, name):
            raise BadInputError(f"--{name} does not go with --map, which flies from many starts and nothing else")
    if arguments.dynamics != options.DEFAULT_DYNAMICS:
        raise BadInputError("--dynamics does not go with --map, which flies both sets of equations")
    speeds, dihedrals, commands = (
        grid(variable, default if getattr(arguments, name) is None else getattr(arguments, name), _MOST_POINTS)
        for name, (variable, default) in _RANGES.items()
    )
    found = []
    for dynamics in VARIANTS:
        aircraft = Aircraft(options.parameters_of(arguments).values, dynamics)
        point = options.operating_point_of(arguments, aircraft)
        plan = _plan(arguments, linearize(aircraft, point), 1.0)
        envelope = flight_envelope(aircraft.parameters, point, envelope_changes(arguments.envelope))
        result = recoverable_map(
            aircraft,
            point,
            plan.gains[-1],
            envelope,
            speeds=speeds,
            dihedrals=dihedrals,
            commands=commands,
            progress=Progress(f"map, {dynamics}"),
        )
        found.append(result)
    maps = tuple(found)
    title = f"How far u = -K z holds, dihedral {math.degrees(arguments.dihedral):g} deg, law {arguments.law}"
    save(map_figure(maps, title), path)
    return _say(
        arguments,
        target,
        map_data(maps),
        lambda: map_text(maps, title),
        lambda: map_table(maps),
        [each.point for each in maps],
    )


def _plan(arguments: argparse.Namespace, model: LinearModel, tick: float) -> GainPlan:
    """The gain that flies: exact, or learned on the linear model and frozen, or learned in flight."""
    from controller.flight.gain_plan import GainPlan, frozen_plan, learned_value, online_plan
    from verification.riccati.gare import solve_game

    game = game_on(model, arguments)
    if arguments.law == "exact":
        return GainPlan("exact", solve_game(game).K[None])
    told = show_learning if sys.stderr.isatty() else None
    learned = learned_value(game, arguments.law, seed_of(arguments), told, **law_settings(arguments))
    return online_plan(game, arguments.law, learned, tick) if arguments.online else frozen_plan(arguments.law, learned)


def _deliver(
    arguments: argparse.Namespace,
    target: Path | None,
    picture: Path | None,
    result: NonlinearFlight,
    plan: GainPlan | None,
    checks: tuple[Check, ...],
    title: str,
    more: dict[str, Any] | None = None,
    more_text: str | None = None,
    points: Sequence[OperatingPoint] | None = None,
) -> int:
    from verification.flights.flight_report import flight_data, flight_table, flight_text, with_history

    if picture is not None:
        from hfa_model.support.figure import save
        from verification.flights.flight_figures import flight_figure

        save(flight_figure(result, title), picture)
    data = flight_data(result, plan, checks) | (more or {})
    text = flight_text(result, plan, checks, title)
    _say(
        arguments,
        target,
        data,
        lambda: text if more_text is None else f"{text}\n\n{more_text}",
        lambda: flight_table(result),
        [result.point] if points is None else points,
        # Files hold the whole flight; on a terminal it would drown the outcome.
        history=with_history({}, result),
    )
    return 0 if result.departure is None and all(check.ok for check in checks) else 1


def _say(
    arguments: argparse.Namespace,
    target: Path | None,
    data: dict[str, Any],
    text: Callable[[], str],
    table: Callable[[], Table],
    points: Sequence[OperatingPoint],
    history: dict[str, Any] | None = None,
) -> int:
    data = data | {"warnings": list(dict.fromkeys(warning for point in points for warning in warnings(point)))}
    if target is not None:
        save_data(target, data | (history or {}), table())
    print(json.dumps(jsonable(data), indent=2, allow_nan=False) if arguments.json else text())
    sys.stdout.flush()
    say_notes(data["warnings"])
    return 0


def _title(arguments: argparse.Namespace, rest: str) -> str:
    return f"Flight, {arguments.dynamics} dynamics, dihedral {math.degrees(arguments.dihedral):g} deg, {rest}"


def _needs(arguments: argparse.Namespace, name: str, other: str) -> None:
    if getattr(arguments, name) is not None:
        raise BadInputError(f"--{name} belongs to --{other}; give both")
