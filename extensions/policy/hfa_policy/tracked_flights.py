"""Flights of a deployment that tracks a reference, with the exact feedforward and without."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from controller.hfa_game import plant_names, usual_game
from controller.riccati.gare import unconfirmed_solution
from controller.tracking import Tracking, tracked
from hfa_aircraft.waveform import Waveform, stacked
from hfa_flight.flight import Flight, fly
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.policy import policy_about, sampled_scenario
from hfa_flight.scenario import Scenario
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint


def tracked_flights(
    deployed: Deployed,
    point: OperatingPoint,
    linear: LinearModel,
    reference: Mapping[str, Waveform],
) -> tuple[Tracking, Flight, Flight]:
    """Return the tracking of a reference, and flights of a deployment with feedforward and without.

    At each sample, the reference is subtracted from the measured states, and the feedforward of the
    aircraft's default game is added to the commands, within the limits of the inputs.

    linear: linear model at the trim `point`
    """
    model = deployed.model
    game = usual_game(model, linear.A, linear.B, plant_names(linear))
    solution = unconfirmed_solution(game)
    commands = stacked(reference, linear.states)
    tracking = tracked(linear, game, solution.P, solution.K, commands)
    policy = replace(policy_about(deployed, point, "deployment"), reference=commands)
    scenario = replace(sampled_scenario(policy, Scenario(), point), reference=commands)
    flights = [
        fly(model, point, each, scenario=scenario, predict=False)
        for each in (replace(policy, feedforward=tracking.inputs), policy)
    ]
    flown, plain = flights
    return tracking, flown, plain
