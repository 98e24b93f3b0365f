"""Flights of any model: without a law, with a delay, in its own disturbances, and the limit cycle that is left."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from own_models import NAVION
from scipy.integrate import solve_ivp

from controller import Actuators, CommandSteps, Game, MonteCarlo, Scenario, flight_envelope, fly, gain_law
from controller.flight.closed_loop import ClosedLoop, LinearPlant, NonlinearPlant
from controller.flight.envelope import limit_cycle
from controller.flight.monte_carlo import fly_members
from controller.flight.nonlinear_flight import NonlinearFlight
from controller.flight.simulation import CompiledLoop, Flight
from controller.policy.policies import open_loop
from controller.policy.signals import Harmonic, Signal
from hfa_support import BadInputError, Signal as Declared
from hfa_support.model import Model, record
from trim import find_operating_point, linearize
from trim.point.condition import usual_condition
from verification import solve_game


@pytest.fixture
def navion() -> Model:
    return NAVION


def flown(model: Model, scenario: Scenario, **steps: float) -> NonlinearFlight:
    """Without a law: each input stepped by so much from 1 s on."""
    commands = CommandSteps(tuple(steps), np.array([1.0]), np.array([list(steps.values())]))
    law = open_loop(commands, tuple(model.inputs), scenario.tick, scenario.ticks)
    point = find_operating_point(model, usual_condition(model))
    return fly(model, point, law, scenario, flight_envelope(model, point))


def test_a_step_without_a_law_is_what_another_integrator_says(navion: Model) -> None:
    result = flown(navion, Scenario(duration=3.0), elevator=0.02, rudder=0.01)
    x0, u0, step = np.array(result.point.states), np.array(result.point.inputs), np.array([0.0, 0.02, 0.0, 0.01])
    f = navion.functions(())
    ends = [x0]
    for span, u in (((0.0, 1.0), u0), ((1.0, 3.0), u0 + step)):
        rate = lambda _, x, u=u: np.array(f(x, u, navion.p)[0]).ravel()  # noqa: E731
        ends.append(solve_ivp(rate, span, ends[-1], rtol=1e-11, atol=1e-12).y[:, -1])
    np.testing.assert_allclose(result.states[-1], ends[-1], rtol=1e-8, atol=1e-10)
    assert np.abs(result.flight.states[-1]).max() > 0.05
    assert result.report().data["states"] == list(navion.states)
    with pytest.raises(BadInputError, match="there is no law, and no input 'flap'"):
        flown(navion, Scenario(), flap=1.0)


def test_plans_of_models_that_differ_in_their_equations_differ(navion: Model) -> None:
    def plan(factor: float) -> MonteCarlo:
        def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
            rates, outputs = NAVION.equations(x, u, p, w)
            return {**rates, "roll_rate": factor * rates["roll_rate"]}, outputs

        model = replace(NAVION, equations=equations)
        point = find_operating_point(model, usual_condition(model))
        law = open_loop(CommandSteps((), np.zeros(0), np.zeros((0, 0))), tuple(model.inputs), 0.01, 10)
        return MonteCarlo(2, 0, model, point, law, Scenario(duration=0.1), flight_envelope(model, point))

    assert plan(1.0) == plan(1.0)
    assert plan(1.0) != plan(2.0)


def test_disturbances_are_those_of_the_model() -> None:
    """x' = -x + u + w: a constant w and a wave, written out; a gust needs a disturbance `updraft`."""
    model = Model(
        "tank",
        states={"level": Declared("ft")},
        inputs={"pump": Declared()},
        disturbances={"rain": Declared()},
        equations=lambda x, u, p, w: ({"level": -x.level + u.pump + w.rain}, {}),
        trim={"level": 0.0},
        schedule="level",
    )
    rain = Signal(np.array([0.5]), np.zeros(1), (Harmonic(2.0, np.array([0.1]), np.zeros(1)),))
    result = flown(model, Scenario(duration=2.0, air={"rain": rain}))
    t = result.flight.times
    wave = 0.1 / 5 * (np.sin(2 * t) - 2 * np.cos(2 * t) + 2 * np.exp(-t))
    np.testing.assert_allclose(result.flight.states[:, 0], 0.5 * (1 - np.exp(-t)) + wave, atol=1e-9)
    assert result.predicted is not None
    np.testing.assert_allclose(result.predicted.states, result.flight.states, atol=1e-9)
    with pytest.raises(BadInputError, match="unknown disturbance 'snow'; choose from rain"):
        flown(model, Scenario(air={"snow": rain}))
    with pytest.raises(BadInputError, match="tank declares no disturbance updraft, which a gust is"):
        flown(model, Scenario(gust=SimpleNamespace()))  # type: ignore[arg-type]


@pytest.mark.parametrize("delay", [1.0, 0.25])
def test_a_delay_is_a_delay(delay: float) -> None:
    """x' = -x(t - D), x(0) = 1, no command before 0; by the method of steps x = 1 + Σ_k (-1)^k (t - k D)_+^k / k!."""
    tick = 0.005
    scenario = Scenario(3.0, tick / 5, tick, np.ones(1), delay=delay)
    plant, law = LinearPlant(np.zeros((1, 1)), np.ones((1, 1))), gain_law("one", np.ones((1, 1)))
    flight = CompiledLoop(ClosedLoop(plant, law, scenario)).fly()
    t = flight.times
    np.testing.assert_allclose(flight.states[t < delay, 0], 1.0, atol=1e-12)
    exact = _by_steps(t, delay)
    np.testing.assert_allclose(flight.states[:, 0], exact, atol=2e-5)
    assert np.abs(exact - np.exp(-t)).max() > 0.05  # the delay shows
    np.testing.assert_allclose(flight.inputs[-1, 0], -np.interp(t[-1] - delay, t, exact), atol=1e-4)


def _by_steps(t: np.ndarray, delay: float) -> np.ndarray:
    terms = [(-1) ** k * np.maximum(t - k * delay, 0.0) ** k / math.factorial(k) for k in range(1, 16)]
    return np.asarray(1.0 + np.sum(terms, axis=0))


def test_what_still_oscillates_is_a_limit_cycle(navion: Model) -> None:
    """Planted: a sine that lasts, one that decays, one that something drives, one that is too small to be seen."""
    plant = NonlinearPlant(navion, find_operating_point(navion, usual_condition(navion)))
    law, t = gain_law("none", np.zeros((4, 8))), np.arange(0.0, 20.0, 0.01)
    columns = len(navion.states)
    zeros = np.zeros((len(t), columns))
    still = Flight(t, zeros, t[:, None], np.zeros((len(t), 4)), t[:, None], t[:, None], zeros, {})

    def found(signal: np.ndarray, **scenario: object) -> object:
        inputs = still.inputs.copy()
        inputs[:, 1] = signal
        given = Scenario(duration=20.0, **scenario)  # type: ignore[arg-type]
        return limit_cycle(ClosedLoop(plant, law, given.on(navion)), replace(still, inputs=inputs))

    lasting = 0.05 * np.sin(3.0 * t) + 0.02 * t
    cycle = found(lasting)
    assert cycle is not None
    assert (cycle.name, cycle.unit) == ("elevator", "rad")  # type: ignore[attr-defined]
    assert cycle.amplitude == pytest.approx(0.05, rel=0.05)  # type: ignore[attr-defined]
    assert cycle.frequency == pytest.approx(3.0, rel=0.1)  # type: ignore[attr-defined]
    assert found(lasting * np.exp(-0.1 * t)) is None
    assert found(1e-3 * lasting) is None
    wave = Signal(np.zeros(8), np.zeros(8), (Harmonic(3.0, np.ones(8), np.zeros(8)),))
    assert found(lasting, disturbance=wave) is None


def test_a_loop_that_its_delay_destabilizes_ends_in_a_limit_cycle(navion: Model) -> None:
    """Rate-limited surfaces bound what the delay makes grow: not within limits; without the delay it settles."""
    point = find_operating_point(navion, usual_condition(navion))
    model = linearize(navion, point)
    Q, R = (np.diag([navion.signals[n].nominal ** -2.0 for n in each]) for each in (model.states, model.inputs))
    law = gain_law("exact", solve_game(Game(model.A, model.B, np.eye(8), Q, R, math.inf)).K)
    values = record(tuple(navion.inputs))
    lowest, highest = (values(*(getattr(each, end) for each in navion.inputs.values())) for end in ("min", "max"))
    slow = Actuators(values(*[0.1] * 4), lowest, highest, values(math.inf, *[math.radians(60.0)] * 3))
    start = np.zeros(8)
    start[1] = math.radians(3.0)
    for delay, settles in ((0.0, True), (0.3, False)):
        scenario = Scenario(duration=20.0, step=0.01, initial=start, actuators=slow, delay=delay)
        result = fly(navion, point, law, scenario, flight_envelope(navion, point))
        assert result.departure is None
        assert (result.cycle is None, result.within_limits) == (settles, settles)
        assert result.report().data["held"] == settles
        assert ("limit cycle: pitch_rate goes on" in result.report().title) == (not settles)
        plan = MonteCarlo(1, 0, navion, point, law, scenario, flight_envelope(navion, point))
        assert fly_members(plan, 0, 1)["cycle"] == (
            -1 if settles else [*navion.inputs, *navion.states].index("pitch_rate")
        )
    with pytest.raises(BadInputError, match="make it a whole number of ticks"):
        Scenario(delay=0.015)
