"""One member of a Monte Carlo: a draw of the scenario, simulated by the loop that all members share."""

from __future__ import annotations

from controller.flight.closed_loop import ClosedLoop
from controller.flight.integrator import COMPILE_FROM_STEPS
from controller.flight.scenario import Scenario, loop_of
from controller.flight.watched_loop import Summary, WatchedLoop
from controller.monte_carlo.monte_carlo_plan import MonteCarlo
from hfa_model.native.per_thread import cached_per_thread


@cached_per_thread(maxsize=4)
def member_loop(plan: MonteCarlo) -> WatchedLoop:
    """The loop of a plan, compiled at the first call in a thread."""
    scenario = plan.scenario
    return WatchedLoop(
        _loop(plan, plan.member(0)),
        plan.point,
        plan.envelope,
        step=scenario.step,
        steps_per_tick=scenario.steps_per_tick,
        stops=True,
        compile_code=plan.members * scenario.ticks * scenario.steps_per_tick >= COMPILE_FROM_STEPS,
    )


def fly_member(plan: MonteCarlo, member: int) -> tuple[Scenario, Summary]:
    """Draw and simulate one member."""
    scenario = plan.member(member)
    loop = _loop(plan, scenario)
    constants = loop.constants(plan.law.constants, plan.uncertain_plant.constants(plan.parameters_of(scenario)))
    start = loop.start(scenario.initial, plan.law.memory)
    return scenario, member_loop(plan).fly(start, constants, scenario.duration)


def _loop(plan: MonteCarlo, scenario: Scenario) -> ClosedLoop:
    return loop_of(plan.uncertain_plant, plan.law.policy, scenario, plan.point)
