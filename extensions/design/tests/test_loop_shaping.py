"""Loop shaping: gamma_min by three methods, robustness, model following and the servo design."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from known_models import model_at
from project import ROOT
from scipy.linalg import (
    solve_continuous_are,
    solve_continuous_lyapunov,
    solve_sylvester,
)
from servo_cases import A_Z

import hfa
from hfa import BadInputError, Model, NoSolutionError
from hfa_design import (
    Actuator,
    Design,
    check_margins,
    controller_at,
    design_controller,
    design_model,
    load_design,
    robust_check,
    robust_controller,
    servo_loop,
    servo_margins,
    servo_plant,
)
from hfa_flight import ScheduledController

INPUTS = ("throttle", "aileron_center", "aileron_outer", "elevator_center")


def random_plant(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((6, 6)), rng.standard_normal((6, 2)), rng.standard_normal((3, 6))


@pytest.mark.parametrize("seed", [1, 2])
def test_gamma_min_agrees_with_hankel_norm_and_slicot(seed: int) -> None:
    """gamma_min agrees with Glover and McFarlane's γ² = 1/(1 - ‖[N M]‖_H²) and with SLICOT's
    SB10AD.

    SB10AD searches the smallest gain of the equivalent four-block problem.
    """
    slycot = pytest.importorskip("slycot")
    A, B, C = random_plant(seed)
    n = len(A)
    m = B.shape[1]
    p = len(C)
    found = robust_controller(A, B, C, 1.1)
    Z = solve_continuous_are(A.T, C.T, B @ B.T, np.eye(p))
    stable = A - Z @ C.T @ C
    enters = np.hstack([B, -Z @ C.T])
    P = solve_continuous_lyapunov(stable, -enters @ enters.T)
    Q = solve_continuous_lyapunov(stable.T, -C.T @ C)
    hankel = np.linalg.eigvals(P @ Q).real.max()
    assert found.gamma_min == pytest.approx(1.0 / np.sqrt(1.0 - hankel), rel=1e-6)
    B1 = np.hstack([np.zeros((n, p)), B])
    C1 = np.vstack([np.zeros((m, n)), C])
    D = np.block(
        [
            [np.zeros((m, p)), np.zeros((m, m)), np.eye(m)],
            [np.eye(p), np.zeros((p, m)), np.zeros((p, m))],
            [np.eye(p), np.zeros((p, m)), np.zeros((p, m))],
        ]
    )
    least = slycot.sb10ad(
        n,
        p + 2 * m,
        m + 2 * p,
        m,
        p,
        10.0 * found.gamma_min,
        A,
        np.hstack([B1, B]),
        np.vstack([C1, C]),
        D,
        gtol=1e-9,
    )[0]
    assert least == pytest.approx(found.gamma_min, rel=1e-6)


def test_loop_robustness_is_gamma_and_errors_are_found() -> None:
    """The robustness norm of the loop agrees with slycot and is at most gamma.

    A planted factor on the observer gain makes the check fail.
    """
    slycot = pytest.importorskip("slycot")
    A, B, C = random_plant(3)
    found = robust_controller(A, B, C, 1.1)
    assert found.gamma == 1.1 * found.gamma_min
    check = robust_check(A, B, C, found)
    assert check.ok
    n = len(A)
    m = B.shape[1]
    p = len(C)
    closed = np.block([[A, -B @ found.F], [found.H @ C, A - B @ found.F - found.H @ C]])
    enters = np.block([[np.zeros((n, p)), B], [found.H, np.zeros((n, m))]])
    leaves = np.block([[np.zeros((m, n)), -found.F], [C, np.zeros((p, n))]])
    D = np.block([[np.zeros((m, p + m))], [np.eye(p), np.zeros((p, m))]])
    norm = slycot.ab13dd(
        "C", "I", "N", "D", 2 * n, p + m, m + p, closed, np.eye(2 * n), enters, leaves, D
    )[0]
    assert check.value == pytest.approx(norm, rel=1e-6)
    assert found.gamma_min <= norm <= found.gamma * (1.0 + 1e-9)
    assert not robust_check(A, B, C, found._replace(H=0.2 * found.H)).ok


def test_an_unobservable_unstable_mode_is_refused() -> None:
    """A plant with an unstable unobservable mode is refused."""
    with pytest.raises(NoSolutionError, match="no robust controller"):
        robust_controller(np.diag([1.0, -1.0]), np.ones((2, 1)), np.array([[0.0, 1.0]]), 1.1)


@cache
def servo(dynamics: str, degrees: tuple[float, ...] = ()) -> ScheduledController:
    """Return the controller of the design `servo`, at its own breakpoints or at given angles."""
    aircraft = hfa.aircraft(dynamics)
    design = load_design("servo", hfa.aircraft()).of(hfa.aircraft(dynamics))
    assert design.shaping is not None
    return design_controller(
        aircraft, design, np.radians(degrees) if degrees else np.array(design.shaping.breakpoints)
    )


@pytest.mark.parametrize("angles", [(20,), pytest.param(range(0, 21, 4), marks=pytest.mark.slow)])
@pytest.mark.parametrize("dynamics", ["published", pytest.param("newton", marks=pytest.mark.slow)])
def test_every_servo_loop_has_the_required_margins(dynamics: str, angles: Sequence[int]) -> None:
    """At angles from 0 to 20 deg, each loop of the servo has margins of at least 6 dB and 45 deg.

    All loops tolerate 20 ms of delay, also in all inputs at once.
    """
    table = check_margins(hfa.aircraft(dynamics), servo(dynamics), np.radians(angles), (2.0, 10.0))
    assert (len(table.rows), table.ok) == (4 * len(angles), True)
    assert len(table.single) == 4 * len(angles) * 7
    assert min(each.gain for each in table.single) >= 6.0
    assert min(each.phase for each in table.single) >= 45.0
    assert min(each.delay for row in table.rows for each in row.loops.values()) > 0.02
    of_first = [row for row in table.rows if row.scheduled_at == table.rows[0].scheduled_at]
    smallest = min(
        each.delay
        for row in of_first
        for name, each in row.loops.items()
        if name in servo(dynamics).inputs + servo(dynamics).measurements
    )
    _, by_value, *_ = table.report().parts
    assert by_value.rows[0][-1] == f"{1e3 * smallest:.0f}"


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_the_servo_tolerates_half_effectiveness_and_20_ms(dynamics: str) -> None:
    """The servo is stable with half the effectiveness and 20 ms of delay in every input.

    The delay is a Padé approximant of order 3, whose error is below 1e-6 up to 20 rad/s.
    """
    from control import pade, ss, tf

    aircraft = hfa.aircraft(dynamics)
    controller = servo(dynamics)
    delay = ss(tf(*pade(0.02, 3)))
    for degrees in (0.0, 11.0, 20.0):
        for order, bandwidth, share in (
            (o, w, e) for o in (1, 2) for w in (2.0, 10.0) for e in (0.5, 1.0)
        ):
            actuators = dict.fromkeys(INPUTS, Actuator(order, bandwidth, effectiveness=share))
            loop = servo_loop(
                servo_plant(aircraft, model_at(degrees, dynamics), controller, actuators),
                controller,
            )
            n = len(loop.A)
            each = np.eye(len(INPUTS))
            A = np.block(
                [
                    [loop.A, loop.B @ np.kron(each, delay.C)],
                    [np.zeros((12, n)), np.kron(each, delay.A)],
                ]
            )
            B = np.vstack([loop.B @ np.kron(each, delay.D), np.kron(each, delay.B)])
            C = np.hstack([loop.C, np.zeros((3, 12))])
            assert replace(loop, A=A, B=B, C=C).stability.is_stable


def test_margins_put_a_pole_on_the_axis(published_aircraft: Model) -> None:
    """If one input or sensor is changed by its gain or phase margin, a pole is on the imaginary
    axis.
    """
    controller = servo("published", (11.0,))
    actuators = dict.fromkeys(INPUTS, Actuator(2, 2.0))
    loop = servo_loop(
        servo_plant(published_aircraft, model_at(11.0), controller, actuators), controller
    )
    margins = servo_margins(loop, controller.inputs, controller.measurements)
    for k, name in enumerate(controller.inputs):
        gains = [10.0 ** (side * margins[name].gain / 20.0) for side in (1.0, -1.0)]
        found = [
            replace(loop, B=loop.B * np.where(np.arange(len(INPUTS)) == k, gain, 1.0)).stability
            for gain in gains
        ]
        assert min(abs(each.value) for each in found) < 1e-9
    assert np.isfinite([margins[name].crossover for name in controller.measurements]).any()
    for k, name in enumerate(controller.measurements):
        turned = np.ones(3, dtype=complex)
        w = margins[name].crossover
        turned[k] = np.exp(1j * np.radians(margins[name].phase))
        both = []
        for phase in (turned, turned.conj()):
            closed = np.block(
                [[loop.A + 0j, loop.B @ loop.Ck], [loop.Bk @ (phase[:, None] * loop.C), loop.Ak]]
            )
            both.append(np.linalg.svd(closed - 1j * w * np.eye(len(closed)), compute_uv=False)[-1])
        assert np.isnan(w) or min(both) < 1e-9
    # A common factor f puts a pole at jω where 1/f is an eigenvalue λ of the loop L(jω).
    eye, inner = np.eye(len(loop.A)), np.eye(len(loop.Ak))
    smallest = math.inf
    for s in 1j * np.geomspace(1e-2, 1e2, 600):
        into = loop.Bk @ loop.C @ np.linalg.solve(s * eye - loop.A, loop.B)
        loci = np.linalg.eigvals(loop.Ck @ np.linalg.solve(s * inner - loop.Ak, into))
        smallest = min(smallest, *(2.0 * np.abs((1.0 - loci) / (1.0 + loci))))
    assert margins["all inputs"].disk == pytest.approx(min(smallest, 2.0), rel=1e-2)


def test_states_with_model_actuators_equal_the_model(
    published_aircraft: Model,
) -> None:
    """With the actuators of the reference model, the aircraft's states equal those of this model.

    The states of the observer remain 0. In steady state, the outputs equal the commands.
    """
    design = load_design("servo", hfa.aircraft())
    model = model_at(11.0)
    controller = servo("published", (11.0,))
    found = controller_at(published_aircraft, model, design)
    assert design.shaping is not None
    actuators = dict.fromkeys(INPUTS, Actuator(1, design.shaping.following.bandwidth))
    plant = servo_plant(published_aircraft, model, controller, actuators)
    B = found.B
    n = len(plant.A)
    closed = np.block([[plant.A, plant.B @ found.C], [B[:, :3] @ plant.C, found.A]])
    told = np.vstack([np.zeros((n, 6)), B[:, 3:]])
    commands = np.array([0.02, -1.0, 0.0, 0.0, 0.02, -1.0])  # r, r', r_end
    rest = -np.linalg.solve(closed, told @ commands)
    np.testing.assert_allclose(plant.C[1:] @ rest[:n], commands[:2], atol=1e-9)
    # Once transients have decayed, the outputs are the filtered commands: with w' = S w of the
    # filter, the states are Pi w and closed Pi + told = Pi S.
    bandwidth, damping = controller.command_filter
    one = np.array(
        [[0, 1, 0], [-(bandwidth**2), -2 * damping * bandwidth, bandwidth**2], [0, 0, 0]]
    )
    S = np.kron(one, np.eye(2))
    Pi = solve_sylvester(closed, -S, -told)
    np.testing.assert_allclose(plant.C[1:] @ Pi[:n], np.eye(2, 6), atol=1e-8)
    rng = np.random.default_rng(0)
    state = np.zeros(len(closed))
    w = rng.standard_normal(6)
    for _ in range(50):
        state = state + 0.02 * (closed @ state + told @ w)
    own = state[n:]
    np.testing.assert_allclose(own[:n], state[:n], atol=1e-10 * np.abs(state).max())
    assert np.abs(own[n + len(INPUTS) :]).max() < 1e-9 * np.abs(state).max()


def test_a_loop_shaping_controller_has_its_filter() -> None:
    """A loop-shaping controller has the names, the command filter and the checks of its design."""
    controller = servo("published", (11.0,))
    assert (controller.measurements, controller.inputs) == (("pitch_rate", "dihedral", A_Z), INPUTS)
    assert controller.commands[:2] == ("dihedral_command", f"{A_Z}_command")
    assert controller.commands[-1] == f"{A_Z}_command_end"
    assert controller.command_filter == (0.5, 2.0)
    assert len(controller.states) == controller.A.shape[1] == 30
    assert all(check["ok"] for row in controller.about["angles"] for check in row["checks"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("gain = ", "gains = "),
            "unknown entry shaping.outputs.pitch_rate.gains; did you mean gain",
        ),
        (
            ("[shaping.inputs]\nthrottle", "[shaping.inputs]\nflap"),
            "unknown weighted input 'flap'",
        ),
        (
            ("filter = [0.5, 2.0]", "filter = [0.5]"),
            "filter does not have two entries",
        ),
        (
            ("dihedrals = [0, 3,", "dihedrals = [3, 3,"),
            "shaping.dihedrals is empty or does not increase",
        ),
        (
            ("pitch_rate = [", "pitch_rate = [1.0, "),
            "shaping.schedule.pitch_rate has 9 factors; give 8, one for each dihedral",
        ),
        (
            ("[shaping]\n", "[sensors]\npitch_rate = 1.0\n[shaping]\n"),
            "the entry sensors applies to a game and cannot be combined with [shaping]",
        ),
        (("[actuators.throttle]", "[actuators.flap]"), "unknown actuator 'flap'"),
    ],
)
def test_a_design_that_cannot_be_shaped_is_refused(
    change: tuple[str, str], message: str, tmp_path: Path
) -> None:
    """A faulty entry of a loop-shaping design is refused with its name."""
    text = (ROOT / "extensions/design/hfa_design/servo.toml").read_text(encoding="utf-8")
    path = tmp_path / "own.toml"
    path.write_text(text.replace(*change, 1), encoding="utf-8")
    with pytest.raises(BadInputError) as refused:
        load_design(str(path), hfa.aircraft())
    assert message in str(refused.value)


def test_a_shaped_design_has_no_game(published_aircraft: Model) -> None:
    """The game of a loop-shaping design is refused."""
    design: Design = load_design("servo", hfa.aircraft())
    with pytest.raises(
        BadInputError, match="is a loop-shaping design without a game; use `hfa design`"
    ):
        design_model(published_aircraft, model_at(11.0), design).game()
