"""The command `hfa optimize`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import (
    input_file,
    linear_state,
    one_of,
    quantity,
    whole,
)
from hfa.options.critics import critic_path
from hfa.options.game import GameWeights
from hfa.options.output import Output, ProgressLine, picture_option
from hfa.options.part import OfModel, option, part
from hfa.options.request import Request, command
from hfa.options.trim import Trim, limits_option
from hfa_flight.needs import ALL, SHARE, needed_share
from hfa_flight.policies.laws import LAWS, loaded
from hfa_support.errors import BadInputError, prefix_errors
from trim.point.linearize import linearize

if TYPE_CHECKING:
    from controller.game.zero_sum import Game
    from hfa_flight.plan.search import BestFlights
    from hfa_flight.simulate.simulation import CompiledLoop
    from trim.point.operating_point import OperatingPoint

_MOST_STARTS = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class OptimizeRequest(Request):
    """Arguments of `hfa optimize`."""

    aircraft: Aircraft = part(Aircraft, without=("units",))
    trim: Trim = part(Trim, without=("limit", "start"))
    cost: GameWeights = part(GameWeights, without=("N",))
    output: Output = part(
        Output,
        picture=picture_option("the best flight found, and the flights of the policies"),
    )
    seed: int = option("seed of all random numbers; default 0", "N", whole(0), default=0, rare=True)
    deviations: Mapping[str, float] = option(
        "initial deviations of states from the trim, degrees for angles",
        "NAME=VALUE,...",
        OfModel(linear_state),
        names="--start",
        named=True,
    )
    to: Mapping[str, float] = option(
        "value imposed at the final trim, in place of its value at the initial trim; repeatable",
        "NAME=VALUE",
        OfModel(quantity),
        named=True,
    )
    starts: int | None = option(
        "number of random initial conditions in the default box, for a table of flights",
        "N",
        whole(1, _MOST_STARTS),
    )
    need: Mapping[str, float] = option(
        "share of the initial conditions of --starts from which a flight is found and the "
        "policies of --law, --weights and --policy converge within limits, for exit code 0; "
        "default 1, all",
        f"{SHARE}=X",
        needed_share,
        named=True,
        rare=True,
    )
    law: str = option(
        f"compare with a law that plans on the nonlinear model: {' or '.join(LAWS)}",
        "NAME",
        one_of(*LAWS),
        default="",
    )
    weights: Path | None = option(
        "compare with the policy of this gain K, critic (W or P) or network", "FILE", critic_path
    )
    policy: Path | None = option(
        "compare with the policy of this deployment file", "DEPLOYMENT.toml", input_file(".toml")
    )
    limits: Mapping[str, tuple[float, float]] = limits_option(
        "limits of a state, instead of the limits of the flight envelope"
    )

    def search(self) -> tuple[BestFlights, Game]:
        """Return the search for best flights to the trim, and the game of the linear model at
        this trim.
        """
        from hfa_flight.plan.problem import flight_problem
        from hfa_flight.plan.search import BestFlights

        aircraft = self.trim.aircraft
        point = self.end().point()
        game = self.cost.game(linearize(aircraft, point))
        game.refuse_cross_weights("the cost of hfa optimize")
        problem = flight_problem(aircraft, point, game.Q, game.R, limits=self.limits)
        count = 1 if self.starts is None else self.starts
        return BestFlights(problem, count), game

    def end(self) -> Trim:
        """Return the trim at which flights end: the given trim, changed by --to.

        Raises BadInputError if --to contains a parameter.
        """
        held = dict(self.to)
        for name in held:
            if name in self.model.parameters:
                raise BadInputError(
                    f"--to {name}: {name} is a parameter, which is constant in flight; give a state"
                )
        at = held.pop(self.model.schedule, self.trim.at)
        return replace(self.trim, at=at, hold={**self.trim.hold, **held})

    def begin(self) -> Mapping[str, float] | OperatingPoint:
        """Return the initial condition of a flight.

        With --to, the initial condition is the trim that the other options describe. Otherwise it
        is state -> deviation from the trim.
        """
        if self.to:
            return self.trim.point()
        return self.deviations

    def loops(self, search: BestFlights, game: Game) -> list[CompiledLoop]:
        """Return the loops of the policies to compare with the best flight.

        - the exact game policy, unless δ is infinite
        - the policy of --law
        - the policy of the critic in --weights
        - the policy of the deployment file --policy

        Raises NoSolutionError if the game has no solution. Raises BadInputError if a file is
        invalid.
        """
        from controller.critic.critic_file import critic_in
        from controller.critic.reading import Reading
        from controller.riccati.gare import unconfirmed_solution
        from hfa_flight.policies.deployment.policy import flown_deployment

        flights = search.flights
        loops = []
        if np.isfinite(game.delta):
            exact = unconfirmed_solution(game).K
            loops.append(flights.of_gain("exact game policy, saturated", exact))
        if self.law:
            planned = loaded(LAWS[self.law])(search.problem, game)
            loops.append(flights.of_policy(planned))
        if self.weights is not None:
            with prefix_errors(self.weights):
                critic = critic_in(self.weights, game, Reading())
            loops.append(flights.of_critic(f"critic of {self.weights}", critic))
        if self.policy is not None:
            policy = flown_deployment(self.policy, search.problem.point)
            named = replace(policy, name=f"policy of {self.policy}")
            loops.append(flights.of_policy(named))
        return loops


@command(OptimizeRequest)
def optimize(request: OptimizeRequest) -> int:
    """Search for the best flight of the nonlinear aircraft to its trim, and compare policies.

    The cost is the integral of x'Qx + u'Ru, in deviations from the trim. Collocation proposes
    flights within the limits. A simulation of each proposal yields the reported cost. A cheaper
    flight may exist. The policies are the linear optimum and the exact game policy, both saturated
    at the limits of the inputs, and those of --law, --weights and --policy. --starts N prints a
    table for many initial conditions. --to NAME=VALUE searches for flights from one trim to
    another. Exit code 1 if no flight was found, or if the simulation refutes the flight. With
    --starts, a flight must be found and the policies of --weights and --policy converge within the
    limits from every initial condition, or from the share of --need.
    """
    begins = (bool(request.deviations), request.starts is not None, bool(request.to))
    if begins.count(True) != 1:
        raise BadInputError(
            "the initial condition is missing or given twice; give either --start "
            "NAME=VALUE,..., --starts N or --to NAME=VALUE"
        )
    if request.starts is not None:
        request.refuse(
            ("output.picture",), "applies only to a single flight; remove this option or --starts"
        )
    if request.starts is None:
        request.refuse(("need",), "applies only to --starts; remove this option, or add --starts")
    search, game = request.search()
    loops = request.loops(search, game)
    if request.starts is not None:
        return _table(request, search, game, loops)
    return _one(request, search, loops)


def _one(request: OptimizeRequest, search: BestFlights, loops: list[CompiledLoop]) -> int:
    """Search for the best flight from one initial condition, and print its report."""
    from hfa_flight.plan.best_flight import BestFlight
    from hfa_flight.plan.search import AFTER

    start = search.problem.deviations(request.begin())
    best = BestFlight(search.problem, search.found(start))
    seconds = (1.0 + AFTER) * best.seconds
    others = tuple(search.flights.fly(loop, start, seconds) for loop in loops)
    best = replace(best, others=others)
    history: dict[str, Any] = {"time": best.time, "X": best.states, "U": best.inputs}
    request.show(best.report(), figure=best.figure, only_in_files={"flight": history})
    return 0


def _table(
    request: OptimizeRequest, search: BestFlights, game: Game, loops: list[CompiledLoop]
) -> int:
    """Search for the best flights from many initial conditions and print a table."""
    from hfa_flight.plan.initial_box import drawn_starts
    from hfa_flight.plan.initial_conditions import starts_table

    assert request.starts is not None  # the caller found --starts
    starts = drawn_starts(search.problem, request.starts, request.seed)
    table = starts_table(search, starts, loops, ProgressLine("optimize"))
    names = [loop.loop.policy.name for loop in loops]
    judged = names[int(np.isfinite(game.delta)) :]
    share = request.need.get(SHARE, ALL)
    table = replace(table, judged=judged, share=share)
    request.show(table.report())
    return 0 if table.ok else 1
