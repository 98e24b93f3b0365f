"""The command `hfa fly`: one flight, or many flights with random differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from controller.discrete.critic_file import critic_of_steps
from hfa.inherited import (
    OneTrimOptions,
    OutputOptions,
    ReadingOptions,
    WorkersOptions,
    inherited_spread,
    show,
)
from hfa.options.argument_types import input_file, whole
from hfa.options.output import ProgressLine, output_option, picture_option
from hfa.options.part import option
from hfa.options.request import command
from hfa_flight.options import FlightOptions
from hfa_support.errors import BadInputError, warn
from hfa_support.files import MATRIX_FILES

_MOST_MEMBERS = 10_000_000
_MOST_STEPS = 1_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class FlyRequest(FlightOptions, OneTrimOptions, WorkersOptions, OutputOptions):
    """Options of `hfa fly`."""

    samples: int | None = option(
        "simulate N flights, each with its own random errors, noise and turbulence",
        "N",
        whole(1, _MOST_MEMBERS),
        rare=True,
    )
    draws: int | None = option(
        "simulate N aircraft whose uncertain parameters are drawn at random",
        "N",
        whole(1),
        rare=True,
    )
    output: Path | None = output_option(
        stores=(".zarr",), purpose=" (flights of --samples or --draws)"
    )
    picture: Path | None = picture_option("the flight, or the flights of --draws")
    steps: Path | None = option(
        "simulate the discrete-time plant in FILE from --initial for --duration steps; policy: "
        "optimum of the game, or --weights",
        "FILE",
        input_file(*MATRIX_FILES),
        names="--model",
        rare=True,
    )

    def origin(self) -> Mapping[str, Any]:
        """Return the provenance of the model: path of the discrete-time plant, or the aircraft."""
        return super().origin() if self.steps is None else {"model": str(self.steps)}


@command(FlyRequest)
def fly(request: FlyRequest) -> int:
    """Simulate a policy on the nonlinear aircraft, and compare the flight with the linear model.

    `--law none --command elevator=1:2,2:-2,3:0` simulates a doublet without a policy. With
    scheduled gains, a --command of the scheduling variable moves the reference along the trims.
    --samples N simulates N flights, with --error and --noise as standard deviations and turbulence
    determined by --seed and the number of the flight. --draws N simulates N aircraft with random
    parameters, from the nominal trim and with the nominal policy. --model FILE simulates a
    discrete-time plant. --Q and --R add the cost of the flight.

    Exit code 1 if a state leaves its envelope, an input exceeds its control limits, or an
    oscillation does not decay (--samples: in every flight; --draws: in any).
    """
    if request.steps is not None:
        return _fly_steps(request, request.steps)
    if request.members is not None:
        many = "--samples" if request.draws is None else "--draws"
        request.refuse(
            ("method", "frame"), f"applies only to a single flight; remove this option or {many}"
        )
        return _fly_members(request)
    from hfa_flight.flight import fly
    from hfa_flight.flight_report import flight_figure
    from hfa_flight.own_steps import refuse_method
    from hfa_flight.policies.scheduled_gains import ScheduledGainPolicy
    from trim.point.linearize import linearize

    request.refuse(
        ("workers", "resume"), "applies only to --samples or --draws; remove this option"
    )
    if request.output is not None and request.output.suffix == ".zarr":
        raise BadInputError(
            f"{request.output} is a store for the flights of --samples or --draws; add --samples N"
        )
    refuse_method(request.model, request.method, request.frame)
    planned = request.flight()
    if "duration" not in request.typed:
        planned = planned.lengthened()
    if request.at is None and request.model.extras.names_schedule:
        warn(f"no --{request.model.schedule} is given: the flight is {planned.point.at_scheduled}")
    # With scheduled gains, the linear model at the first trim does not apply to other trims.
    predict = not isinstance(planned.policy, ScheduledGainPolicy)
    result = fly(
        planned.model,
        planned.point,
        planned.policy,
        scenario=planned.scenario,
        envelope=planned.envelope,
        predict=predict,
        method=request.method,
        step=request.frame,
        progress=ProgressLine("simulate"),
    )
    if request.Q is not None or request.R is not None:
        game = request.game_on(linearize(planned.model, planned.point))
        result = replace(result, weights=(game.Q, game.R))
    report = result.report()
    show(
        report,
        request,
        figure=lambda: flight_figure(result, report.title),
        only_in_files=result.history().as_data(),
        notes=result.warnings,
    )
    return 0 if result.ok else 1


def _fly_steps(request: FlyRequest, path: Path) -> int:
    """Simulate the discrete-time plant of --model, print the report and return the exit code.

    The exit code is 1 if the spectral radius of the closed loop is at least 1.

    path: file of the plant
    """
    from controller.discrete.implied_policy import discrete_critic
    from controller.discrete.solution import solve_discrete
    from controller.game.game_file import stored_game
    from hfa_flight.step_flight import fly_steps

    used = {"steps", "initial", "duration", "weights", *ReadingOptions.declared()}
    others = request.typed - used - {*OutputOptions.declared()} | (request.typed & {"picture"})
    request.refuse(sorted(others), "applies only to an aircraft; remove this option or --model")
    stored = stored_game(path)
    problem = stored.discrete
    assert problem is not None
    if not request.initial:
        raise BadInputError("--model requires an initial state; add --initial NAME=VALUE")
    duration = request.duration
    assert duration is not None
    if not (duration == int(duration) and 1 <= duration <= _MOST_STEPS):
        raise BadInputError(
            f"--duration is {duration:g}; give a whole number of steps from 1 to {_MOST_STEPS}"
        )
    if request.weights is None:
        K = solve_discrete(problem).K
        policy = "the game's policy"
    else:
        critic, _ = critic_of_steps(request.weights, problem, request.reading())
        K = discrete_critic(problem, critic).K
        policy = f"the policy of {request.weights}"
    start = np.array([request.initial.get(name, 0.0) for name in request.model.states])
    flight = fly_steps(problem, K, policy, start, int(duration))
    flight = replace(flight, warnings=tuple(stored.notes))
    show(flight.report(), request, notes=stored.notes)
    return 0 if flight.decays else 1


def _fly_members(request: FlyRequest) -> int:
    """Simulate the flights of --samples or --draws, print the report and return the exit code.

    With --samples, the exit code is 0 if at least one flight stays within its limits. With --draws,
    it is 0 if all flights do.
    """
    from hfa_flight.samples.drawn_aircraft import drawn_figure, with_stability
    from hfa_flight.samples.monte_carlo import MonteCarlo
    from hfa_flight.samples.report import member_report
    from hfa_flight.samples.store import run_monte_carlo, stream_members

    members = request.members
    assert members is not None
    if request.draws is not None:
        request.refuse(
            ("samples",),
            "and --draws both set the number of flights; remove one of these options",
        )
    target = request.output
    if request.draws is None:
        request.refuse(
            ("picture",),
            "applies only to a single flight or --draws; remove this option or --samples",
        )
    if target is not None and target.suffix != ".zarr":
        raise BadInputError(
            f"{target}: the flights of --samples and --draws are written to a Zarr store; use -o "
            "FILE.zarr"
        )
    if request.resume and target is None:
        raise BadInputError("--resume requires a store; add -o FILE.zarr")
    spread = None if request.draws is None else inherited_spread(request)
    plan = MonteCarlo(members, request.seed, *request.flight(), spread=spread)
    progress = ProgressLine("simulate")
    if target is None:
        flown = run_monte_carlo(plan, request.workers, progress)
        report = member_report(plan, flown.__getitem__, "members not kept")
    else:
        dataset = stream_members(
            plan,
            target,
            workers=request.workers,
            resume=request.resume,
            provenance=request.provenance.to_dict(),
            progress=progress,
        )
        report = member_report(plan, lambda name: dataset[name].values, f"members in {target}")
    notes = list(dict.fromkeys(plan.point.warnings))
    report = report.with_data(store=None if target is None else str(target), warnings=notes)
    if spread is not None:
        report = with_stability(report, plan, request.trim_condition, ProgressLine("draws"))
    show(report, replace(request, output=None), figure=lambda: drawn_figure(plan), notes=notes)
    return 0 if report.data["within_limits"] >= plan.least_within else 1
