"""Loops with controller states, uncertain actuators, and other aircraft.

Loops are proved up to the limit of stability, and left undecided beyond it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from known_models import exact_gain, model_at
from proof_cases import content, delayed_abscissa, family, forge, through_actuators

from controller.hfa_game import usual_game
from hfa import BadInputError, Model, Signal, linearize, solve
from hfa_aircraft.loading import load_model
from hfa_flight import ScheduledController
from hfa_flight.actuators import Actuator
from hfa_model import INPUTS, LINEAR_STATES, choice
from hfa_prove import Family, check_certificate, prove_schedule
from hfa_prove.check.linear_loop import closed_loop
from hfa_prove.enclosure.balls import doubles
from hfa_prove.fields import Rejected
from hfa_prove.report import checked_report
from hfa_prove.search.family import Box, TrimSearch
from hfa_prove.search.loops import loop_of_gains, loop_of_servo
from hfa_prove.search.uncertain_loop import common_lyapunov, decrease

SENSORS = (*LINEAR_STATES, "vertical_acceleration_short_period")


def filtered(gain: float = 1.0, lag: float = 0.002, direct: float = 0.0) -> ScheduledController:
    """Return a controller u = -K x_f + direct acceleration with filters x_f' = (y - x_f)/lag.

    K is the gain of the exact game, multiplied by `gain`.

    lag: time constant of the filters, s
    direct: gain from the acceleration to the first input
    """
    K = np.array([exact_gain(14.0), exact_gain(15.0)])
    n = len(SENSORS)
    m = len(INPUTS)
    D = np.zeros((2, m, n))
    D[:, 0, -1] = direct
    eye = np.tile(np.eye(n) / lag, (2, 1, 1))
    return ScheduledController(
        name="filtered",
        feedback="state",
        breakpoints=np.radians([14.0, 15.0]),
        A=-eye,
        B=eye,
        C=np.concatenate([-gain * K, np.zeros((2, m, 1))], axis=2),
        D=D,
        W=np.zeros((2, n, m)),
        states=tuple(f"{name}_filtered" for name in SENSORS),
        measurements=SENSORS,
        commands=(),
        inputs=INPUTS,
        trim_states=np.zeros((2, 7)),
        trim_inputs=np.zeros((2, 5)),
        dynamics="published",
        parameters="",
        model=choice.aircraft(),
    )


def fast(order: int = 1) -> dict[str, Actuator]:
    return {name: Actuator(order=order, bandwidth=300.0) for name in INPUTS}


@pytest.mark.parametrize("order", [1, 2])
def test_the_loop_equals_its_assembled_blocks(order: int) -> None:
    """The loop equals a loop assembled block by block, at an angle of the table."""
    controller = filtered()
    model = model_at(14.0)
    loop = loop_of_servo(controller, fast(order), family().model)
    m = len(INPUTS)
    n = len(SENSORS)
    w = 300.0
    d = 0.7
    zero = np.zeros
    acceleration = zero((1, 6))
    acceleration[0, 1] = 68.0 * model.A[1, 1]
    y_x = np.vstack([np.eye(6), acceleration])
    y_a = np.vstack([zero((6, m)), 68.0 * model.B[1:2]])
    A = controller.A[0]
    B = controller.B[0]
    C = controller.C[0]
    if order == 1:
        rows = [
            [model.A, model.B, zero((6, n))],
            [zero((m, 6)), -w * np.eye(m), w * C],
            [B @ y_x, B @ y_a, A],
        ]
    else:
        rows = [
            [model.A, model.B, zero((6, m)), zero((6, n))],
            [zero((m, 6)), zero((m, m)), w * np.eye(m), zero((m, n))],
            [zero((m, 6)), -w * np.eye(m), -2 * d * w * np.eye(m), w * C],
            [B @ y_x, B @ y_a, zero((n, m)), A],
        ]
    search = TrimSearch(family(), 14.0, 15.0, loop.controller.outputs(family().model))
    linear = search.linear_model(Box(14.0, 14.0 + 2.0**-30))
    found = closed_loop(linear, family().model, loop.controller, loop.actuators)
    expected = np.block(rows)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(doubles(found.parts[0]), expected, rtol=1e-6, atol=1e-6 * scale)


@pytest.mark.parametrize("apart", [pytest.param(0.0, marks=pytest.mark.slow), 200.0])
def test_a_loop_with_filters_is_proved(tmp_path: Any, apart: float) -> None:
    """A loop with filters and actuators is proved and verified for a moving dihedral.

    The modes of the filters may coincide. Three times the proved rate is refused.
    """
    speeds = np.diag(np.linspace(400.0, 400.0 + apart, len(SENSORS)))
    controller = replace(filtered(), A=-np.array([speeds, speeds]), B=np.array([speeds, speeds]))
    actuators = {
        name: Actuator(order=1, bandwidth=200.0 + 0.1 * apart * i) for i, name in enumerate(INPUTS)
    }
    loop = loop_of_servo(controller, actuators, family().model)
    proof = prove_schedule(family(), loop, 14.0, 14.0625, moving=True)
    assert proof.proved
    assert 0.2 < proof.data["decay_rate"] < 0.4
    assert proof.statement.scheduled_rate > 0.1
    found = check_certificate(forge(tmp_path / "certificate.json", content(proof))).statement
    assert found.loop == ((14.0, 14.0625, 0, 0),)
    assert found.decay_rate == proof.data["decay_rate"]
    faster = content(proof)
    faster["statement"]["scheduled_rate"] *= 3.0
    with pytest.raises(Rejected, match="not proved positive definite"):
        check_certificate(forge(tmp_path / "certificate.json", faster))


def test_too_long_a_lag_is_refuted() -> None:
    """A loop that a long filter lag destabilizes is refuted.

    A controller of an input without an actuator is refused.
    """
    model = family().model
    loop = loop_of_servo(filtered(lag=20.0), fast(), model)
    proof = prove_schedule(family(), loop, 14.0, 14.25)
    assert (proof.proved, len(proof.data["refuted"])) == (False, 1)
    with pytest.raises(BadInputError, match="throttle has no actuator"):
        loop_of_servo(filtered(), {}, model)


def test_direct_feedback_gives_the_expected_loop() -> None:
    """Direct feedback of the acceleration gives the expected entries of the closed loop."""
    model = model_at(14.0)
    loop = loop_of_servo(filtered(direct=1e-5), fast(), family().model)
    search = TrimSearch(family(), 14.0, 15.0, loop.controller.outputs(family().model))
    linear = search.linear_model(Box(14.0, 14.0 + 2.0**-30))
    found = doubles(closed_loop(linear, family().model, loop.controller, loop.actuators).parts[0])
    direct = 300.0 * 1e-5 * 68.0
    assert found[6, 1] == pytest.approx(direct * model.A[1, 1], rel=1e-5)
    expected = -300.0 * np.eye(5)
    expected[0] += direct * model.B[1]
    np.testing.assert_allclose(found[6:11, 6:11], expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("delay", "slowest"), [(0.02, 1.8), pytest.param(0.5, 1.8, marks=pytest.mark.slow), (0.0, 0.02)]
)
def test_a_loop_with_actuators_is_proved_or_open(delay: float, slowest: float) -> None:
    """A loop is proved with a delay of 0.02 s and left open with 0.5 s, as its eigenvalues require.

    With actuators of 0.02 rad/s the loop is left open, because the aircraft is unstable at 14 deg.
    """
    loop = through_actuators(14.0, 14.125, delay=delay, slowest=slowest)
    drawn = np.random
    model = model_at(14.0)
    stands = (delay, slowest) == (0.02, 1.8)
    worst = max(
        delayed_abscissa(loop, model.A, model.B, w, np.ones(5), share * delay, 14.0)
        for w in (slowest, 10.0)
        for share in (0.5, 1.0)
    )
    assert (worst < 0.0) == stands
    proof = prove_schedule(family(), loop, 14.0, 14.125)
    assert proof.proved == stands
    assert [run.most for run in proof.statement.loop] == ([0] if stands else [11])
    assert proof.report().title.startswith("Proved" if stands else "Left open")
    assert proof.data["actuators"]["delay"] == delay
    random = drawn.default_rng(0)
    for _ in range(20 * stands):
        arrives = random.uniform(0.5, 1.0, 5)
        seconds = random.uniform(0.0, delay)
        w = random.uniform(1.8, 10.0)
        assert delayed_abscissa(loop, model.A, model.B, w, arrives, seconds, 14.0) < 0.0


def test_one_lyapunov_function_serves_all_stable_points() -> None:
    """V = x² proves x' = -x + k (x + d), |d| <= |x|/2, for all k up to 0.5.

    For k up to 0.7, no Lyapunov function is found.
    """
    for most, exists in ((0.5, True), (0.7, False)):
        rows = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
        points = [(np.array([[-1.0 + k, 0.0, k]]), rows) for k in (0.0, most)]
        found = common_lyapunov(points)
        assert (found is not None) == exists
        if found is not None:
            for rates, _ in points:
                form = decrease(rates, rows, *found)[::2, ::2]  # without d, which has no effect
                assert np.linalg.eigvalsh(form)[0] > 0.0


def _with_drag(model: Model) -> Any:
    """Return the equations of a model with a little more drag."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        rates, outputs = model.equations(x, u, p, w)
        return {**rates, "speed": rates["speed"] - 1e-9 * x.speed}, outputs

    return equations


@pytest.mark.slow
def test_gains_of_the_navion_are_proved(tmp_path: Any) -> None:
    """LQR gains of the Navion, scheduled over speed, are proved stabilizing.

    The certificate is verified with the aircraft file, and refused without it. Negated gains are
    refuted. Q and R are diag(1/nominal²).
    """
    flights = Family(load_model("examples/navion.py:NAVION"))
    gains = []
    for speed in (160.0, 176.0):
        model = linearize(flights.model, flights.point(speed))
        gains.append(solve(usual_game(flights.model, model.A, model.B)).K)
    K = np.array(gains)
    loop = loop_of_gains(flights.model, [160.0, 176.0], K)
    proof = prove_schedule(flights, loop, 160.0, 168.0, moving=True)
    assert proof.proved
    for box in proof.data["boxes"]:
        for speed in box["scheduled"]["speed"]:
            model = linearize(flights.model, flights.point(speed))
            share = (speed - 160.0) / 16.0
            closed = model.A - model.B @ (K[0] + share * (K[1] - K[0]))
            assert np.linalg.eigvals(closed).real.max() < -proof.data["decay_rate"]
    path = forge(tmp_path / "navion.json", content(proof))
    data = checked_report(check_certificate(path, model=flights.model)).data
    assert (data["proved"], data["one_branch"]) == (True, True)
    assert (data["scheduled"], data["scheduled_rate"] > 0.0) == ({"speed": [160.0, 168.0]}, True)
    with pytest.raises(BadInputError, match="give the aircraft file with --aircraft"):
        check_certificate(path)
    source = replace(flights.model.source, text="other.py:NAVION", digest="0" * 64)
    assert check_certificate(path, model=replace(flights.model, source=source)).size > 0
    other = replace(flights.model, equations=_with_drag(flights.model))
    with pytest.raises(BadInputError, match="with other equations than those"):
        check_certificate(path, model=other)
    negated = loop_of_gains(flights.model, [160.0, 176.0], -K)
    assert prove_schedule(flights, negated, 160.0, 161.0).data["refuted"]


@pytest.mark.parametrize(
    ("kink", "proved"),
    [
        (ca.erf, None),
        (ca.fabs, 1),
        (lambda v: ca.fmax(v, 0), 1),
        (lambda v: ca.fmin(v, 1), 0),
        (ca.interpolant("t", "linear", [[-1.0, 0.5, 1.5]], [0.0, 0.0, 1.0]), 1),
        (ca.interpolant("t", "linear", [[-1.0, 1.0, 1.5]], [0.0, 0.0, 1.0]), 0),
    ],
)
def test_a_kink_at_the_trim_is_left_open(kink: Any, proved: int | None) -> None:
    """v' = u - p v + kink(v) is proved at v = 1 if the kink is elsewhere, and left open otherwise.

    p is the scheduling variable. An operation that balls do not support is refused by its name.
    """
    model = Model(
        name="kinked",
        states={"v": Signal(nominal=1.0)},
        inputs={"u": Signal(nominal=1.0, start=1.0)},
        parameters={"p": Signal(nominal=1.0, start=1.0)},
        equations=lambda x, u, p, w: ({"v": u.u - p.p * x.v + kink(x.v)}, {}),
        trim={"v": 1.0},
        schedule="p",
    )
    flights = Family(model)
    loop = loop_of_gains(model, [1.0, 2.0], np.array([[[1.5]], [[2.0]]]))
    if proved is None:
        with pytest.raises(BadInputError, match="kinked: the equations use erf, which a proof"):
            flights.check(1.0, 2.0)
        return
    flights.check(1.0, 2.0)
    high = 1.0 + 2.0**-15  # narrower boxes than half of this are not tried
    proof = prove_schedule(flights, loop, 1.0, high)
    assert proof.proved == bool(proved)
    assert proof.statement.loop[0].most == 1 - proved
