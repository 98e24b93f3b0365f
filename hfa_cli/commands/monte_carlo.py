"""Fly many members of one flight, each with its own parameter errors, sensor noise and turbulence.

Member k is decided by --seed and k alone: any number of workers gives the same bits. The members go to a Zarr store
(-o FILE.zarr), which can be continued after an interruption (--resume). Exit code 0 when at least one member stays in
its envelope.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from controller.flight.critic_policy import CriticPolicy
from controller.flight.signals import Signal
from controller.game.zero_sum import Game
from hfa_cli import options
from hfa_cli.flights import (
    LAWS,
    add_weights,
    envelope_changes,
    game_on,
    initial_of,
    law_of,
    numbers,
    seed_of,
    signal_of,
)
from hfa_cli.learning import law_settings
from hfa_cli.output import Progress, check_target, say_notes
from hfa_cli.values import number, quantity, split_assignments, whole
from hfa_model.support.errors import BadInputError
from hfa_model.support.jsonable import jsonable
from trim.linear.linearize import LinearModel, linearize
from trim.point.trim_report import warnings

if TYPE_CHECKING:
    from controller.monte_carlo.monte_carlo_plan import FlownLaw, MonteCarlo, Uncertainty

#: Eq. (46) as printed, and as `verification/experiments/section5.toml` helps it to stay bounded; both learn in flight.
_CRITICS = ("published", "published-helped")
_DEFAULT_MEMBERS = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa monte-carlo`."""
    options.add_condition(parser)
    options.add_aircraft(parser)
    add_weights(parser, (*LAWS, *_CRITICS))
    parser.add_argument("--gain", metavar="FILE", help="fly the gain K in this file (.json .npz .mat) instead of a law")
    parser.add_argument("--members", metavar="N", help=f"default {_DEFAULT_MEMBERS}")
    parser.add_argument("--plant", default="nonlinear", metavar="KIND", help="nonlinear (default) or linear")
    drawn = parser.add_argument_group("what differs from member to member; off by default")
    drawn.add_argument(
        "--error", action="append", metavar="NAME=DEVIATION", help="relative standard deviation of a parameter"
    )
    drawn.add_argument(
        "--noise", action="append", metavar="NAME=DEVIATION", help="standard deviation of a sensor, degrees for angles"
    )
    drawn.add_argument("--turbulence", metavar="SIGMA:SCALE", help="Dryden turbulence, ft/s and ft")
    form = "NAME=CONSTANT[:AMPLITUDE:RAD/S]"
    flight = parser.add_argument_group("the flight")
    flight.add_argument("--duration", metavar="S", help="default 20")
    flight.add_argument("--step", metavar="S", help="fixed step of the integration, default 0.001")
    flight.add_argument("--initial", action="append", metavar="NAME=VALUE", help="a state off trim; or `paper`")
    flight.add_argument("--reference", action="append", metavar=form, help="what a state shall follow; or `paper`")
    flight.add_argument("--disturbance", action="append", metavar=form, help="added to a rate; or `paper`")
    flight.add_argument(
        "--envelope", action="append", metavar="NAME=LOW:HIGH", help="other limits of a state, absolute; repeatable"
    )
    parser.add_argument("--workers", metavar="N", help="processes; default 1")
    parser.add_argument("--scheduler", metavar="URL", help="Dask scheduler, tcp://host:port")
    parser.add_argument("--resume", action="store_true", help="continue an interrupted run of the same options")
    parser.add_argument("--json", action="store_true", help="print JSON (radians, feet, pounds) instead of text")
    parser.add_argument("-o", "--output", metavar="FILE", help="keep every member in this store (.zarr)")


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when every member left its envelope."""
    from controller.monte_carlo.monte_carlo_report import monte_carlo_data, monte_carlo_text
    from controller.monte_carlo.stored_members import stream_monte_carlo

    target = check_target(arguments.output, (".zarr",))
    if arguments.resume and target is None:
        raise BadInputError("--resume needs the store to continue; add -o FILE.zarr")
    options.one_place(arguments)
    workers = whole("--workers", arguments.workers, 1, lowest=1)
    plan = _plan(arguments)
    with tempfile.TemporaryDirectory() as folder:
        store = stream_monte_carlo(
            plan,
            Path(folder) / "members.zarr" if target is None else target,
            count=workers,
            scheduler=arguments.scheduler,
            resume=arguments.resume,
            progress=Progress("fly"),
        )
        data = monte_carlo_data(plan, store) | {"store": arguments.output, "warnings": warnings(plan.point)}
    where = "members not kept" if target is None else f"members in {target}"
    print(json.dumps(jsonable(data), indent=2, allow_nan=False) if arguments.json else monte_carlo_text(data, where))
    say_notes(data["warnings"])
    return 0 if data["held"] else 1


def _plan(arguments: argparse.Namespace) -> MonteCarlo:
    from controller.flight.envelope import flight_envelope
    from controller.monte_carlo.monte_carlo_plan import Course, MonteCarlo

    members = whole("--members", arguments.members, _DEFAULT_MEMBERS, lowest=1)
    uncertainty, seed = _uncertainty(arguments), seed_of(arguments)
    aircraft = options.aircraft_of(arguments)
    point = options.operating_point_of(arguments, aircraft)
    envelope = flight_envelope(aircraft.parameters, point, envelope_changes(arguments.envelope))
    times = {name: getattr(arguments, name) for name in ("duration", "step")}
    course = Course(
        lowest=np.array(envelope.lowest),
        highest=np.array(envelope.highest),
        initial=initial_of(arguments.initial),
        reference=signal_of("--reference", arguments.reference),
        disturbance=signal_of("--disturbance", arguments.disturbance),
        **{name: number(text, f"--{name}") for name, text in times.items() if text is not None},
    )
    law = _law(arguments, linearize(aircraft, point), course.reference)
    return MonteCarlo(
        members=members,
        seed=seed,
        parameters=aircraft.parameters,
        dynamics=arguments.dynamics,
        point=point,
        plant=arguments.plant,
        law=law,
        course=course,
        uncertainty=uncertainty,
    )


def _uncertainty(arguments: argparse.Namespace) -> Uncertainty:
    from controller.monte_carlo.monte_carlo_plan import Uncertainty

    errors = {name: number(text, name) for name, text in split_assignments(arguments.error).items()}
    noise = {name: quantity(name, text) for name, text in split_assignments(arguments.noise).items()}
    if arguments.turbulence is None:
        return Uncertainty(errors, noise)
    intensity, scale = numbers("--turbulence", arguments.turbulence, "SIGMA:SCALE", (2,))
    return Uncertainty(errors, noise, (intensity, scale))


def _law(arguments: argparse.Namespace, model: LinearModel, reference: Signal) -> FlownLaw:
    """The gain or the critic that the options name, designed for the nominal model."""
    from controller.monte_carlo.monte_carlo_plan import gain_law

    law = law_of(arguments, (*LAWS, *_CRITICS))
    if arguments.gain is not None:
        if law != "certified" or arguments.set:
            raise BadInputError("--gain takes the place of a law; leave out --law and --set")
        for name in ("delta", "Q", "R"):
            if options.given(arguments, name):
                raise BadInputError(f"--{name} belongs to the game of a law; leave it out with --gain")
        return gain_law(f"gain of {arguments.gain}", _stored_gain(arguments.gain))
    if arguments.set and law not in ("certified", "irl"):
        raise BadInputError(f"--set belongs to a law that learns before the flight; law {law!r} does not")
    game = game_on(model, arguments)
    if law in _CRITICS:
        return _critic(law, model, game, reference)
    if law == "exact":
        from verification.riccati.gare import solve_game

        return gain_law(law, solve_game(game).K)
    from controller.flight.gain_plan import learned_value

    return gain_law(law, learned_value(game, law, seed_of(arguments), **law_settings(arguments)).K)


def _critic(law: str, model: LinearModel, game: Game, reference: Signal) -> FlownLaw:
    from controller.monte_carlo.monte_carlo_plan import critic_law
    from verification.experiments import flown_laws as laws
    from verification.experiments.configuration import section5_configuration
    from verification.experiments.setting import PaperCase, Setting

    name = laws.MODIFIED if law == "published-helped" else laws.PRINTED
    configuration = section5_configuration()
    case = PaperCase(math.degrees(model.point.states.dihedral), game, model.input_offsets)
    flown = laws.pilot(
        Setting(configuration, "regenerated", ()), case, name, configuration.predefined_time("5.1"), False, reference
    )
    assert isinstance(flown.policy, CriticPolicy)
    return critic_law(law, flown.policy)


def _stored_gain(path: str) -> np.ndarray:
    from controller.game.model_file import load_critic

    K = load_critic(path).K
    if K is None:
        raise BadInputError(f"{path}: there is no K; --gain flies a gain, so give a file that holds one")
    return K
