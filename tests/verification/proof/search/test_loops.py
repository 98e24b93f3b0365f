"""Loops with memory, through actuators of intervals, and of other aircraft: proved, and left open
beyond the limit."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cli import hfa
from known_models import exact_gain, model_at
from proof_cases import content, delayed_abscissa, exact_table, family, forge, through_actuators

import hfa_model
from controller import ScheduledController
from controller.hfa_game import usual_game
from controller.servo.design import Actuator
from hfa_aircraft.loading import load_model
from hfa_model import INPUTS, LINEAR_STATES
from hfa_support import BadInputError, Model, Signal
from trim import linearize
from verification import Family, check_certificate, prove_schedule, solve_game
from verification.proof.arithmetic.balls import doubles
from verification.proof.checker import checker
from verification.proof.checker.checker import Rejected
from verification.proof.enclosures.trim_branch import PlaceBox, TrimBranch
from verification.proof.search.proof_report import checked_report, gaps, joined
from verification.proof.search.scheduled_loop import LoopTable, closed_loop, servo_table
from verification.proof.search.uncertain_loop import common_lyapunov

SENSORS = (*LINEAR_STATES, "vertical_acceleration_short_period")


def filtered(gain: float = 1.0, lag: float = 0.002, direct: float = 0.0) -> ScheduledController:
    """u = -K x_f, x_f' = (y - x_f)/lag, and a filtered acceleration that moves nothing; K of the
    exact game."""
    K, n, m = np.array([exact_gain(14.0), exact_gain(15.0)]), len(SENSORS), len(INPUTS)
    D = np.zeros((2, m, n))
    D[:, 0, -1] = direct
    eye = np.tile(np.eye(n) / lag, (2, 1, 1))
    return ScheduledController(
        name="filtered",
        feedback="state",
        places=np.radians([14.0, 15.0]),
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
        model=hfa_model.aircraft(),
    )


def fast(order: int = 1) -> dict[str, Actuator]:
    return {name: Actuator(order=order, bandwidth=300.0) for name in INPUTS}


@pytest.mark.parametrize("order", [1, 2])
def test_the_loop_is_that_of_its_parts(order: int) -> None:
    """Written out once more, block by block, at an angle of the table."""
    controller, model = filtered(), model_at(14.0)
    table, m, n = (
        servo_table(controller, fast(order), 68.0, family().model),
        len(INPUTS),
        len(SENSORS),
    )
    zero, w, d = np.zeros, 300.0, 0.7
    acceleration = zero((1, 6))
    acceleration[0, 1] = 68.0 * model.A[1, 1]
    y_x, y_a = np.vstack([np.eye(6), acceleration]), np.vstack([zero((6, m)), 68.0 * model.B[1:2]])
    A, B, C = controller.A[0], controller.B[0], controller.C[0]
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
    loop = closed_loop(table, TrimBranch(family()).forms(PlaceBox(14.0, 14.0 + 2.0**-30)))
    expected = np.block(rows)
    np.testing.assert_allclose(
        doubles(loop.parts[0]), expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max()
    )


@pytest.mark.parametrize("apart", [0.0, 200.0])
def test_a_loop_with_memory_may_move_as_fast_as_is_proved_and_verified(
    tmp_path: Any, apart: float
) -> None:
    """Filters and actuators of different speed, and of the same: modes that are equal, in their
    vectors too."""
    speeds = np.diag(np.linspace(400.0, 400.0 + apart, len(SENSORS)))
    controller = replace(filtered(), A=-np.array([speeds, speeds]), B=np.array([speeds, speeds]))
    actuators = {
        name: Actuator(order=1, bandwidth=200.0 + 0.1 * apart * i) for i, name in enumerate(INPUTS)
    }
    table = servo_table(controller, actuators, 68.0, family().model)
    proof = prove_schedule(family(), table, 14.0, 14.0625, moving=True)
    assert proof.proved
    assert 0.2 < proof.data["decay_rate"] < 0.4
    assert proof.statement["place_rate"] > 0.1
    found = check_certificate(forge(tmp_path / "certificate.json", content(proof)))
    assert [joined(found.covers[name]) for name in ("loop", "motion")] == [[(14.0, 14.0625, 0)]] * 2
    assert found.rate == proof.data["decay_rate"]
    faster = content(proof)
    faster["statement"]["place_rate"] *= 3.0
    with pytest.raises(Rejected, match="motion from 14"):
        check_certificate(forge(tmp_path / "certificate.json", faster))


def test_a_lag_that_is_too_long_is_refuted_and_what_a_proof_does_not_take_is_said() -> None:
    model = family().model
    proof = prove_schedule(
        family(), servo_table(filtered(lag=20.0), fast(), 68.0, model), 14.0, 14.25
    )
    assert (proof.proved, len(proof.data["refuted"])) == (False, 1)
    with pytest.raises(BadInputError, match="throttle has no actuator"):
        servo_table(filtered(), {}, 68.0, model)
    with pytest.raises(BadInputError, match="reaches the inputs at once"):
        servo_table(filtered(direct=1.0), fast(), 68.0, model)


@pytest.mark.parametrize(
    ("delay", "slowest"), [(0.02, 1.8), pytest.param(0.5, 1.8, marks=pytest.mark.slow), (0.0, 0.02)]
)
def test_a_loop_through_actuators_is_proved_and_beyond_the_true_limit_left_open(
    delay: float, slowest: float
) -> None:
    """By the delay equation's own eigenvalues the loop stands 0.02 s and not 0.5 s; actuators of
    0.02 rad/s leave the aircraft, which is unstable at 14 deg, to itself."""
    table, drawn = through_actuators(14.0, 14.125, delay=delay), np.random.default_rng(0)
    assert table.actuators is not None
    table = replace(table, actuators=replace(table.actuators, bandwidth=(slowest, 10.0)))
    model, stands = model_at(14.0), (delay, slowest) == (0.02, 1.8)
    late = [(w, share * delay) for w in (slowest, 10.0) for share in (0.5, 1.0)]
    worst = max(
        delayed_abscissa(table, model.A, model.B, w, np.ones(5), seconds) for w, seconds in late
    )
    assert (worst < 0.0) == stands
    proof = prove_schedule(family(), table, 14.0, 14.125)
    assert proof.proved == stands
    assert gaps(proof.covers["loop"], 14.0, 14.125) == [(14.0, 14.125)] * (not stands)
    assert proof.report().title.startswith("Proved" if stands else "Left open")
    assert proof.data["actuators"]["delay"] == delay
    for _ in range(20 * stands):
        arrives, seconds = drawn.uniform(0.5, 1.0, 5), drawn.uniform(0.0, delay)
        assert (
            delayed_abscissa(table, model.A, model.B, drawn.uniform(1.8, 10.0), arrives, seconds)
            < 0.0
        )


def test_one_lyapunov_function_serves_its_points_and_none_is_found_for_an_unstable_one() -> None:
    """x' = -x + k (x + d) with |d| <= |x|/2, k from 0 to 0.5: V = x² decreases; with k up to 0.7 it
    does not."""
    for most, exists in ((0.5, True), (0.7, False)):
        points = [
            (
                np.array([[-1.0 + k, 0.0, k]]),
                np.array([[0.0, 0.0, 0.0]]),
                np.array([[0.5, 0.0, 0.0]]),
            )
            for k in (0.0, most)
        ]
        found = common_lyapunov(points)
        assert (found is not None) == exists
        if found is not None:
            H, (_, x) = found
            for R, _, _ in points:
                form = -H * np.outer([1, 0, 0], R[0])
                form = form + form.T + np.diag([-x / 4, 1.0, x])
                assert np.linalg.eigvalsh(form)[0] > 0.0


def test_gains_over_the_speed_of_another_aircraft(tmp_path: Any) -> None:
    """The LQR's gains of the Navion, weights 1/nominal²: proved, verified with its file; refuted
    negated."""
    flights, gains = Family(load_model("examples/navion.py:NAVION")), []
    for speed in (160.0, 176.0):
        model = linearize(flights.model, flights.point(speed))
        gains.append(solve_game(usual_game(flights.model, model.A, model.B)).K)
    table = LoopTable.of_gains(np.array([160.0, 176.0]), np.array(gains), 8)
    proof = prove_schedule(flights, table, 160.0, 168.0, moving=True)
    assert proof.proved
    for box in proof.boxes["loop"]:
        for speed in box["range"]:
            model, ends = linearize(flights.model, flights.point(speed)), np.array(box["A"])
            share = (speed - 160.0) / 16.0
            loop = model.A - model.B @ (table.K[0] + share * (table.K[1] - table.K[0]))
            assert np.linalg.eigvals(loop).real.max() < -box["rate"]
            assert np.all((ends[..., 0] <= model.A) & (ends[..., 1] >= model.A))
    path = forge(tmp_path / "navion.json", content(proof))
    data = checked_report(check_certificate(path, model=flights.model)).data
    assert (data["proved"], data["one_branch"]) == (True, True)
    assert (data["scheduled"], data["scheduled_rate"] > 0.0) == ({"speed": [160.0, 168.0]}, True)
    with pytest.raises(BadInputError, match="name its file by --aircraft"):
        check_certificate(path)
    with pytest.raises(BadInputError, match="of another file"):
        check_certificate(path, model=replace(flights.model, source=("other.py:NAVION", "0" * 64)))
    assert prove_schedule(flights, replace(table, K=-table.K), 160.0, 161.0).data["refuted"]


def test_the_gtm_is_proved_and_verified_by_the_command(tmp_path: Any) -> None:
    own, saved = ("--aircraft", "examples/gtm.py:GTM"), str(tmp_path / "gtm.json")
    assert (
        "Proved: every speed from 40 to 42 m/s"
        in hfa("prove", "schedule", *own, "--at", "40:42", "-o", saved).out
    )
    assert hfa("prove", *own, "--check", saved).out.startswith(
        "Verified, proved: speed from 40 to 42 m/s"
    )


@pytest.mark.parametrize(
    ("kink", "proved"),
    [(ca.fabs, None), (lambda v: ca.fmax(v, 0), 1), (lambda v: ca.fmin(v, 1), 0)],
)
def test_a_kink_is_refused_by_name_unless_balls_decide_it(kink: Any, proved: int | None) -> None:
    """v' = u - p v + kink(v) at v = 1, the parameter p scheduled: proved away from the kink, and
    open at it."""
    model = Model(
        name="kinked",
        states={"v": Signal(nominal=1.0)},
        inputs={"u": Signal(nominal=1.0, start=1.0)},
        parameters={"p": Signal(nominal=1.0, start=1.0)},
        equations=lambda x, u, p, w: ({"v": u.u - p.p * x.v + kink(x.v)}, {}),
        trim={"v": 1.0},
        schedule="p",
    )
    flights, table = (
        Family(model),
        LoopTable.of_gains(np.array([1.0, 2.0]), np.array([[[1.5]], [[2.0]]]), 1),
    )
    if proved is None:
        with pytest.raises(
            BadInputError, match="kinked: its equations use fabs, which a proof does not take"
        ):
            flights.check(1.0, 2.0)
        with pytest.raises(
            BadInputError, match=r"its equations use lt, .* in place of a table or a switch"
        ):
            Family(load_model("examples/f16.py:F16")).check(400.0, 410.0)
        return
    flights.check(1.0, 2.0)
    high = 1.0 + 2.0**-15  # narrower boxes than half of this are not tried
    proof = prove_schedule(flights, table, 1.0, high)
    assert proof.proved == bool(proved)
    assert gaps(proof.covers["loop"], 1.0, high) == [(1.0, high)] * (1 - proved)


def test_trims_of_boxes_that_are_not_one_branch_are_told(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the second box seeks another root than the first one finds."""
    stated = content(prove_schedule(family(), exact_table(14.0, 14.0625), 14.0, 14.0625))
    path = forge(tmp_path / "certificate.json", stated)
    whole = check_certificate(path)
    assert whole.parted == []
    box = stated["boxes"]["modes"][0]
    apart, known = (
        json.loads(json.dumps(box)),
        checker.model_on(stated["statement"], box, whole.model),
    )
    apart["trim"]["throttle"][0] += 3 * apart["trim"]["throttle"][3]
    roots = {
        "loop": [checker.Root(box, known["root"])],
        "modes": [checker.Root(apart, known["root"])],
    }
    assert checker._parted(roots) == [14.0]
    assert checker._parted(roots | {"modes": roots["loop"]}) == []
    monkeypatch.setattr(checker, "_parted", lambda _: [14.0])
    assert checked_report(check_certificate(path)).data["proved"] is False
