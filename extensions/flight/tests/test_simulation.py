"""The simulation: order of the method, fast modes, end of a flight, delays, disturbances and limit
cycles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from own_models import NAVION
from scipy.integrate import solve_ivp

from hfa import (
    BadInputError,
    Game,
    NoSolutionError,
    OperatingPoint,
    Signal as Declared,
    fly,
    linearize,
    solve,
    trim,
)
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.signals import record
from hfa_aircraft.waveform import Harmonic, Waveform
from hfa_flight import (
    ActuatorBank,
    CommandSteps,
    GainPolicy,
    MonteCarlo,
    OneMinusCosine,
    Scenario,
    flight_envelope,
)
from hfa_flight.closed_loop import ClosedLoop, LinearPlant, Plant
from hfa_flight.flight import Flight, fly_within
from hfa_flight.history import Deviations
from hfa_flight.limit_cycle import Decay, LimitCycle, limit_cycle, oscillation
from hfa_flight.policies.policy import OpenLoop, open_loop
from hfa_flight.samples.monte_carlo import fly_members
from hfa_flight.simulation import CompiledLoop
from hfa_model import STATES
from trim.point.condition import usual_condition

SPEED = STATES.index("speed")


class Falling(Plant):
    """Plant speed' = -1, alpha' = sqrt(0.0105 + speed), whose alpha is NaN after 0.0105 s."""

    def __init__(self, point: OperatingPoint) -> None:
        self.point = point

    def rate(self, x: Any, u: Any, d: Any, winds: Any, p: Any) -> Any:
        return ca.vertcat(-1.0, ca.sqrt(0.0105 + x[SPEED]), ca.SX.zeros(5))


@pytest.mark.parametrize(
    ("slowest", "state", "time", "end"),
    [(-1e9, "alpha", 0.011, 0.02), (-0.0045, "speed", 0.005, 0.01)],
    ids=["not a number", "beyond a limit"],
)
def test_a_flight_ends_with_its_tick(
    point: OperatingPoint, slowest: float, state: str, time: float, end: float
) -> None:
    """A flight with ticks of 10 ms ends at the end of the tick in which it leaves the envelope.

    The departure contains the first variable that is beyond its limit or not finite, and the time
    of this event.
    """
    limits = dict.fromkeys(STATES, (-1e9, 1e9))
    limits["speed"] = (point.states.speed + slowest, 1e9)
    envelope = Limits.of(point.model, STATES, limits)
    policy = GainPolicy("none", np.zeros((5, 6)))
    loop = ClosedLoop(Falling(point), policy, Scenario(0.05, initial=np.zeros(7)))
    result = fly_within(CompiledLoop(loop), envelope)
    assert result.departure is not None
    assert (result.departure.state, result.departure.time) == (state, pytest.approx(time))
    assert result.flight.states[-1, SPEED] == pytest.approx(-end)


# The loop of a pendulum with an observer that has a fast mode.


@dataclass(frozen=True, eq=False)
class Pendulum(LinearPlant):
    """Plant y1' = y2, y2' = -sin y1 - 0.3 y2 + u, with an observer y3 of y1 whose mode is at
    -fast.
    """

    fast: float = 4.0

    def rate(self, x: Any, u: Any, d: Any, winds: Any, p: Any) -> Any:
        return ca.vertcat(x[1], -ca.sin(x[0]) - 0.3 * x[1] + u, self.fast * (x[0] - x[2]))


def pendulum(
    fast: float, step: float, *, duration: float = 6.0, observed: float = 0.0
) -> CompiledLoop:
    """Return the closed loop of the pendulum with an input that jumps from 0.5 to -1 at 3.7 s."""
    plant = Pendulum(np.zeros((3, 3)), np.zeros((3, 1)), fast=fast)
    pushes = np.repeat([[0.5], [-1.0]], [37, 1], axis=0)
    law = OpenLoop("pushed", held=pushes, fastest=fast)
    return CompiledLoop(
        ClosedLoop(plant, law, Scenario(duration, step, 0.1, np.array([1.0, 0.0, observed])))
    )


def test_integration_is_of_fourth_order_across_jumps() -> None:
    """Halving the step reduces the error 12 to 20 times, although the input jumps at a tick."""
    found = [pendulum(4.0, 0.05 / parts).fly().states[::parts] for parts in (1, 2, 4)]
    coarse, fine = (np.abs(one - other).max() for one, other in pairwise(found))
    assert 12.0 < coarse / fine < 20.0


def test_a_fast_policy_mode_divides_integration_steps() -> None:
    """A mode of 1e5 1/s in the policy divides each integration step of 0.02 s.

    The observer follows, and the pendulum's motion equals that with a slow mode. A mode of 1e9 1/s
    is refused.
    """
    fast = 1e5
    flight = pendulum(fast, 0.02, observed=1.0).fly()
    np.testing.assert_allclose(flight.times, 0.02 * np.arange(301))
    plain = pendulum(4.0, 0.002).fly()
    np.testing.assert_allclose(flight.states[:, :2], plain.states[::10, :2], atol=1e-6)
    np.testing.assert_allclose(
        flight.states[:, 2], flight.states[:, 0] - flight.states[:, 1] / fast, atol=5e-5
    )
    with pytest.raises(
        BadInputError, match=r"a mode of 1e\+09 1/s, but a step of 0.02 s permits at most"
    ):
        pendulum(1e9, 0.02)


def test_error_of_diverging_loop_contains_only_its_time(capfd: pytest.CaptureFixture[str]) -> None:
    """The error of a loop that diverges reports the time, and nothing is printed."""

    class Blown(LinearPlant):
        def rate(self, x: Any, u: Any, d: Any, winds: Any, p: Any) -> Any:
            return x**2

    plant = Blown(np.zeros((1, 1)), np.zeros((1, 1)))
    law = GainPolicy("none", np.zeros((1, 1)))
    loop = CompiledLoop(ClosedLoop(plant, law, Scenario(200.0, 0.05, 0.1, np.ones(1))))
    with pytest.raises(NoSolutionError, match=r"simulation diverges at t = 1"):
        loop.fly()
    assert capfd.readouterr() == ("", "")


def stepped(model: Model, scenario: Scenario, **steps: float) -> Flight:
    """Return the flight without a policy in which each named input is stepped at 1 s.

    steps: name of an input -> size of its step
    """
    commands = CommandSteps(tuple(steps), np.array([1.0]), np.array([list(steps.values())]))
    law = open_loop(commands, tuple(model.inputs), scenario.tick, scenario.ticks)
    point = trim(model, usual_condition(model))
    return fly(model, point, law, scenario=scenario, envelope=flight_envelope(model, point))


def test_steps_without_policy_agree_with_scipy() -> None:
    """A flight with stepped inputs and no policy agrees with SciPy's integration within 1e-8.

    An unknown input is refused.
    """
    result = stepped(NAVION, Scenario(duration=3.0), elevator=0.02, rudder=0.01)
    x0 = np.array(result.point.states)
    u0 = np.array(result.point.inputs)
    step = np.array([0.0, 0.02, 0.0, 0.01])
    f = NAVION.functions(())
    ends = [x0]
    for span, u in (((0.0, 1.0), u0), ((1.0, 3.0), u0 + step)):
        rate = lambda _, x, u=u: np.array(f(x, u, NAVION.p)[0]).ravel()  # noqa: E731
        ends.append(solve_ivp(rate, span, ends[-1], rtol=1e-11, atol=1e-12).y[:, -1])
    np.testing.assert_allclose(result.states[-1], ends[-1], rtol=1e-8, atol=1e-10)
    assert np.abs(result.flight.states[-1]).max() > 0.05
    assert result.report().data["states"] == list(NAVION.states)
    with pytest.raises(BadInputError, match="unknown input 'flap'"):
        stepped(NAVION, Scenario(), flap=1.0)


def test_different_equations_make_plans_different() -> None:
    """Two Monte Carlo plans are different if their models differ only in the equations."""

    def plan(factor: float) -> MonteCarlo:
        def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
            rates, outputs = NAVION.equations(x, u, p, w)
            return {**rates, "roll_rate": factor * rates["roll_rate"]}, outputs

        model = replace(NAVION, equations=equations)
        point = trim(model, usual_condition(model))
        law = open_loop(
            CommandSteps((), np.zeros(0), np.zeros((0, 0))), tuple(model.inputs), 0.01, 10
        )
        return MonteCarlo(
            2, 0, model, point, law, Scenario(duration=0.1), flight_envelope(model, point)
        )

    assert plan(1.0) == plan(1.0)
    assert plan(1.0) != plan(2.0)


def test_constant_and_sinusoidal_disturbances_give_exact_solution() -> None:
    """A constant disturbance w plus a wave gives the exact solution of x' = -x + u + w.

    An unknown disturbance is refused, and so is a gust for a model without `updraft`.
    """
    model = Model(
        "tank",
        states={"level": Declared("ft")},
        inputs={"pump": Declared()},
        disturbances={"rain": Declared()},
        equations=lambda x, u, p, w: ({"level": -x.level + u.pump + w.rain}, {}),
        trim={"level": 0.0},
        schedule="level",
    )
    rain = Waveform(np.array([0.5]), np.zeros(1), (Harmonic(2.0, np.array([0.1]), np.zeros(1)),))
    result = stepped(model, Scenario(duration=2.0, air={"rain": rain}))
    t = result.flight.times
    wave = 0.1 / 5 * (np.sin(2 * t) - 2 * np.cos(2 * t) + 2 * np.exp(-t))
    np.testing.assert_allclose(result.flight.states[:, 0], 0.5 * (1 - np.exp(-t)) + wave, atol=1e-9)
    assert result.predicted is not None
    np.testing.assert_allclose(result.predicted.states, result.flight.states, atol=1e-9)
    with pytest.raises(BadInputError, match="unknown disturbance 'snow'; choose from rain"):
        stepped(model, Scenario(air={"snow": rain}))
    gust = OneMinusCosine(10.0, 1.0, 10.0)
    with pytest.raises(
        BadInputError,
        match="tank declares no disturbance updraft, which a gust requires; declare this disturbance",
    ):
        stepped(model, Scenario(gust=gust))


@pytest.mark.parametrize("delay", [1.0, 0.25])
def test_a_delayed_loop_equals_the_analytical_solution(delay: float) -> None:
    """x' = -x(t - D) with x(0) = 1 and no command before D has the solution of the method of steps.

    x = 1 + Σ_k (-1)^k (t - k D)_+^k / k!
    """
    tick = 0.005
    scenario = Scenario(3.0, tick / 5, tick, np.ones(1), delay=delay)
    plant = LinearPlant(np.zeros((1, 1)), np.ones((1, 1)))
    law = GainPolicy("one", np.ones((1, 1)))
    flight = CompiledLoop(ClosedLoop(plant, law, scenario)).fly()
    t = flight.times
    np.testing.assert_allclose(flight.states[t < delay, 0], 1.0, atol=1e-12)
    terms = [
        (-1) ** k * np.maximum(t - k * delay, 0.0) ** k / math.factorial(k) for k in range(1, 16)
    ]
    exact = 1.0 + np.sum(terms, axis=0)
    np.testing.assert_allclose(flight.states[:, 0], exact, atol=2e-5)
    assert np.abs(exact - np.exp(-t)).max() > 0.05  # the delay has a visible effect
    np.testing.assert_allclose(flight.inputs[-1, 0], -np.interp(t[-1] - delay, t, exact), atol=1e-4)


def test_a_slow_decay_is_no_limit_cycle() -> None:
    """A decay of 0.5 % a second is reported with the time to half, not as a limit cycle.

    A growing oscillation and an approach to a constant amplitude are limit cycles.
    """
    t = np.arange(0.0, 20.0005, 0.001)
    wave = np.sin(5.477 * t + 0.7)[:, None]
    none = np.zeros((len(t), 1))
    cart = Model(
        "cart", {"a": Declared()}, {"u": Declared()}, lambda x, u, p, w: ({"a": u.u - x.a}, {})
    )

    def found(size: np.ndarray) -> LimitCycle | Decay | None:
        x = 0.3 * size[:, None] * wave + 0.02
        return oscillation(cart, Deviations(t, x, x, none, none, x, {}), 0.0)

    decay = found(np.exp(-0.005 * t))
    assert isinstance(decay, Decay)
    assert decay.time_to_half == pytest.approx(np.log(2.0) / 0.005, rel=5e-3)
    assert decay.frequency == pytest.approx(5.477, rel=1e-3)
    assert isinstance(found(1.0 + 0.5 * np.exp(-0.4 * t)), LimitCycle)
    assert isinstance(found(np.exp(0.005 * t)), LimitCycle)
    # Four crossings in a quarter, and ten samples in a period.
    t, wave = t[:10001], wave[:10001]
    none = none[:10001]
    assert isinstance(found(np.exp(-0.0055 * t)), Decay)
    t, wave, none = t[::115], wave[::115], none[::115]
    cycle = found(np.ones(len(t)))
    assert isinstance(cycle, LimitCycle)
    assert cycle.amplitude == pytest.approx(0.3, rel=3e-3)


def test_a_persistent_sine_is_a_limit_cycle() -> None:
    """A persistent sine is a limit cycle.

    A sine that decays, is excited to the end, or is too small is not a limit cycle.
    """
    t = np.arange(0.0, 20.0, 0.01)
    columns = len(NAVION.states)
    zeros = np.zeros((len(t), columns))
    still = Deviations(t, zeros, t[:, None], np.zeros((len(t), 4)), t[:, None], zeros, {})

    def found(signal: np.ndarray, **scenario: object) -> Any:
        inputs = still.inputs.copy()
        inputs[:, 1] = signal
        given = Scenario(duration=20.0, **scenario)  # type: ignore[arg-type]
        until = given.on(NAVION).driven_until
        return limit_cycle(NAVION, replace(still, inputs=inputs), until)

    lasting = 0.05 * np.sin(3.0 * t) + 0.02 * t
    cycle = found(lasting)
    assert cycle is not None
    assert (cycle.name, cycle.unit) == ("elevator", "rad")
    assert cycle.amplitude == pytest.approx(0.05, rel=2e-3)
    assert cycle.frequency == pytest.approx(3.0, rel=2e-3)
    assert found(lasting * np.exp(-0.1 * t)) is None
    assert found(np.where(t % 1.0 < 0.5, 0.0, -0.0)) is None
    assert found(1e-3 * lasting) is None
    wave = Waveform(np.zeros(8), np.zeros(8), (Harmonic(3.0, np.ones(8), np.zeros(8)),))
    assert found(lasting, disturbance=wave) is None


def test_a_delayed_loop_ends_in_limit_cycle() -> None:
    """With a delay of 0.3 s, the loop ends in a limit cycle inside the envelope.

    Without delay, the loop settles.
    """
    point = trim(NAVION, usual_condition(NAVION))
    model = linearize(NAVION, point)
    Q, R = (
        np.diag([NAVION.signals[n].nominal ** -2.0 for n in each])
        for each in (model.states, model.inputs)
    )
    law = GainPolicy("exact", solve(Game(model.A, model.B, np.eye(8), Q, R, math.inf)).K)
    values = record(tuple(NAVION.inputs))
    lowest, highest = (
        values(*(getattr(each, end) for each in NAVION.inputs.values())) for end in ("min", "max")
    )
    slow = ActuatorBank(
        values(*[0.1] * 4), lowest, highest, values(math.inf, *[math.radians(60.0)] * 3)
    )
    start = np.zeros(8)
    start[1] = math.radians(3.0)
    for delay, settles in ((0.0, True), (0.3, False)):
        scenario = Scenario(duration=20.0, step=0.01, initial=start, actuators=slow, delay=delay)
        result = fly(NAVION, point, law, scenario=scenario, envelope=flight_envelope(NAVION, point))
        assert result.departure is None
        assert (result.cycle is None, result.ok) == (settles, settles)
        assert result.report().data["held"] == settles
        assert ("limit cycle: pitch_rate ±" in result.report().title) == (not settles)
        plan = MonteCarlo(1, 0, NAVION, point, law, scenario, flight_envelope(NAVION, point))
        place = -1 if settles else [*NAVION.inputs, *NAVION.states].index("pitch_rate")
        assert fly_members(plan, 0, 1)["cycle"] == place


def test_limit_cycles_are_found_without_a_policy() -> None:
    """The limit cycle of Van der Pol's oscillator (μ = 0.5) is found with a period of 6.381 s."""
    oscillator = Model(
        name="van der Pol",
        states={"x": Declared("m", min=-10.0, max=10.0), "v": Declared("m/s", min=-10.0, max=10.0)},
        inputs={"force": Declared("N", min=-5.0, max=5.0)},
        equations=lambda x, u, p, w: (
            {"x": x.v, "v": 0.5 * (1.0 - x.x**2) * x.v - x.x + u.force},
            {},
        ),
        trim={"x": 0.0, "v": 0.0},
    )
    point = trim(oscillator)
    scenario = Scenario(duration=60.0, step=0.01, initial=np.array([0.5, 0.0]))
    policy = OpenLoop("none", held=np.zeros((scenario.ticks, 1)))
    flight = fly(
        oscillator, point, policy, scenario=scenario, envelope=flight_envelope(oscillator, point)
    )
    assert flight.cycle is not None
    assert not flight.ok
    assert flight.cycle.frequency == pytest.approx(2.0 * math.pi / 6.3807, rel=1e-3)


SLOW_SPRING = 0.64
#: Gains without and with an unstable rate loop of `slow_oscillator`.
STEADY, GROWING = [[0.0, 0.0]], [[0.0, -0.8]]


def slow_oscillator() -> Model:
    """Return an oscillator of 0.8 rad/s with a damper that grows with the deflection."""
    return Model(
        name="slow oscillator",
        states={"x": Declared("m", min=-10.0, max=10.0), "v": Declared("m/s", min=-10.0, max=10.0)},
        inputs={"force": Declared("N", min=-9.0, max=9.0)},
        equations=lambda x, u, p, w: (
            {"x": x.v, "v": -0.4 * (1.0 + x.x**2) * x.v - SLOW_SPRING * x.x + u.force},
            {},
        ),
        trim={"x": 0.0, "v": 0.0},
    )


@pytest.mark.filterwarnings("ignore:the linear loop is unstable")
def test_slow_limit_cycles_are_recognized_by_default() -> None:
    """Without a given duration, an unstable linear loop flies until its limit cycle is recognized.

    A stable loop flies for 20 s. A flight that is too short names the slowest oscillation that it
    recognizes.
    """
    oscillator = slow_oscillator()
    point = trim(oscillator)
    long = fly(oscillator, point, np.array(GROWING), initial={"x": 0.1})
    assert long.flown > 20.0
    assert long.cycle is not None
    assert long.cycle.frequency == pytest.approx(math.sqrt(SLOW_SPRING), rel=0.1)
    short = fly(oscillator, point, np.array(GROWING), 20.0, initial={"x": 0.1})
    assert short.flown == 20.0
    assert f"slower than {16 * math.pi / 20:.2g} rad/s" in short.report().text()
    assert fly(oscillator, point, np.array(STEADY), initial={"x": 0.1}).flown == 20.0


def test_an_unsaturated_gain_is_named() -> None:
    """A gain that exceeds the control limits is named as not saturated."""
    oscillator = slow_oscillator()
    point = trim(oscillator)
    for gain, exceeds in ((50.0, True), (0.1, False)):
        flight = fly(oscillator, point, np.array([[gain, 1.0]]), 5.0, initial={"x": 1.0})
        assert bool(flight.exceeded) == exceeds
        assert ("not saturated" in flight.report().text()) == exceeds
